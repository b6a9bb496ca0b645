"""Any simulator as the plant, over UDP, TCP and 42's lines: python3 hil_scripts/tests/test_plain_links.py

Needs astropy (requirements.txt). Every sender draws the same slew: the attitudes in the headers of the frames are
compared with it. The bench plays a time of its own: when an attitude was sent follows from its angle, and must differ
from the time of its frame by the same for all frames.
"""

import json
import math
import socket
import struct
import tempfile
import threading
import time
import unittest
from datetime import datetime, timezone
from pathlib import Path

from astropy.io import fits

from support import ARCSEC, BINARY, ROOT, InAFolder, Running, product, starloop, summary_of, until

# A small camera: the attitude is what counts.
SETTINGS = ["camera=../cameras/small_tracker.toml", "timing.duration_s=120", "link.listen=0"]
PATIENCE_S = 60.0
HZ = 50.0
FRAMES = 12
RATE_RAD_S = math.radians(0.5)
AXIS = (0.6, 0.0, -0.8)
START_S = time.time()
# About other axes than that of the slew nothing turns; headers have ten digits.
ACROSS_ARCSEC = 0.01
# Time that a busy machine may take from reading its clock to sending: the first frames are drawn while this is estimated.
LATE_S = 0.05


def turned(angle):
    """Body from ICRF of a body turned by this angle about its axis, as starloop has it: x is negative."""
    half = 0.5 * angle
    return (math.cos(half), *(-math.sin(half) * part for part in AXIS))


def slew(unix_s):
    """Attitude w x y z and rate at a time: the slew that every sender sends."""
    first = (0.8, 0.36, 0.48, 0.0)
    return product(turned(RATE_RAD_S * (unix_s - START_S)), first), tuple(RATE_RAD_S * part for part in AXIS)


def turn(got, first):
    """Rotation from one attitude to another: about the axis of the slew, rad, and the rest, arcsec."""
    w, *xyz = product(got, (first[0], *(-part for part in first[1:])))
    along = -2.0 * math.atan2(sum(part * a for part, a in zip(xyz, AXIS)), w)
    across = math.sqrt(sum((part - a * sum(p * b for p, b in zip(xyz, AXIS))) ** 2 for part, a in zip(xyz, AXIS)))
    return along, 2.0 * across / ARCSEC


class Stimulator(Running):
    """`starloop run` of configs/benches/udp.toml with other settings, until frames enough are there."""

    def __init__(self, folder, *settings, kind="udp"):
        assert not any(setting.startswith("link.connect") for setting in settings), "a client has a file of its own"
        words = [word for setting in [*SETTINGS, f"link.kind={kind}", *settings] for word in ("--set", setting)]
        self.begin(folder, ROOT / "configs/benches/udp.toml", kind, *words)

    def begin(self, folder, bench, kind, *words):
        """Starts the run, and waits for the address of its link, where it has one."""
        self.run = Path(folder) / "run"
        super().__init__(BINARY, "run", bench, "--out", self.run, *words)
        if kind:
            found = self.wait_for(rf"^link: {kind} at (.*):(\d+)\n")
            self.address = (found[1], int(found[2]))

    def frames(self, wanted):
        """Headers of the first frames with stars, as soon as there are so many."""
        enough = lambda: found if len(found := self.headers()) >= wanted else None
        return until(lambda: f"{wanted} frames: {''.join(self.said)}", enough, PATIENCE_S, every_s=0.2)

    def headers(self):
        """Headers of whole frames whose attitude was measured or predicted."""
        found = []
        for path in sorted(self.run.glob("frame_*.fits")):
            try:
                header = fits.getheader(path)
            except (OSError, ValueError):
                continue
            if header.get("QW") is not None and header["ORIGIN"] in ("measured", "interpolated", "predicted"):
                found.append(header)
        return found

    def stop(self):
        """The summary of the run."""
        super().stop()
        return summary_of(self.run)


class Sender:
    """Sends what `message` makes of the time, HZ times a second, until it is closed."""

    def __init__(self, send, message):
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.run, args=(send, message))
        self.thread.start()

    def run(self, send, message):
        while not self.over.wait(1.0 / HZ):
            try:
                send(message(time.time()))
            except OSError:
                return

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()


def udp_to(address):
    """A socket of its own that sends to an address."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.connect(address)
    return out


def packed(unix_s, order="<"):
    """Eight doubles."""
    q, w = slew(unix_s)
    return struct.pack(order + "8d", unix_s, *q, *w)


def as_json(unix_s):
    """Names and vectors."""
    q, w = slew(unix_s)
    return json.dumps({"t": unix_s, "q": q, "w": w}).encode()


def as_text(unix_s):
    """Scalar last, the other sense, degrees per second, milliseconds: what a plant of someone else may send."""
    (w, x, y, z), rate = slew(unix_s)
    numbers = [unix_s * 1e3, -x, -y, -z, w, *(math.degrees(part) for part in rate)]
    return ", ".join(repr(number) for number in numbers).encode() + b"\n"


def as_42(unix_s):
    """A message of 42: lines, scalar last, the other sense."""
    (w, x, y, z), rate = slew(unix_s)
    at = datetime.fromtimestamp(unix_s, timezone.utc)
    second = at.second + round((unix_s - math.floor(unix_s)) * 1e9) * 1e-9
    number = lambda numbers: " ".join(f"{part:18.15e}" for part in numbers)
    return (f"TIME {at:%Y-%j-%H:%M}:{second:012.9f}\nSC[0].qn = [{number((-x, -y, -z, w))}]\n"
            f"SC[0].wn = [{number(rate)}]\nSC[0].svb = [1 0 0]\n[ENDMSG]\n").encode()


def as_42_before_2024(unix_s):
    """The same as 42 wrote it before 2024: without brackets, the quaternion of the first body, another end."""
    text = as_42(unix_s).replace(b"SC[0].qn", b"SC[0].B[0].qn").replace(b"SC[0].wn", b"SC[0].B[0].wn")
    return text.replace(b"= [", b"= ").replace(b"]\n", b"\n").replace(b"[ENDMSG\n", b"[EOF]\n")


class PlainLinks(InAFolder):
    def check(self, headers, begin_s=START_S, least=FRAMES):
        """Every frame has an attitude of the slew; when each was sent less when it was drawn, s, from the first on."""
        self.assertGreaterEqual(len(headers), least)
        first, begin_ns = slew(begin_s)[0], headers[0]["MID_NS"]
        begin_along, offsets = None, []
        for header in headers:
            along, across = turn(tuple(header[key] for key in ("QW", "QX", "QY", "QZ")), first)
            self.assertLess(across, ACROSS_ARCSEC, f"frame {header['FRAME']}")
            begin_along = along if begin_along is None else begin_along
            turned_rad = math.remainder(along - begin_along, 2.0 * math.pi)
            offsets.append(turned_rad / RATE_RAD_S - (header["MID_NS"] - begin_ns) * 1e-9)
        return offsets

    def check_steady(self, headers, begin_s=START_S):
        """All frames show the slew at its own rate."""
        offsets = self.check(headers, begin_s)
        self.assertLess(max(offsets) - min(offsets), LATE_S)

    def draw(self, message, *settings):
        """A run whose attitudes are `message`, over UDP."""
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder, *settings) as starloop:
            out = udp_to(starloop.address)
            with out, Sender(out.send, message):
                headers = starloop.frames(FRAMES)
            self.check_steady(headers)
            return starloop.stop()

    def test_refused_lines_of_42_are_quoted_with_the_keys_to_check(self):
        for message, quote, reason in (
            (lambda t: as_42(t).replace(b"SC[0]", b"SC[1]"), '"SC[1].qn = [', '" (plain_incomplete)'),
            (lambda t: b"hello world\n", '"hello world', 'world" (plain_unread_line)'),
        ):
            with self.subTest(quote), tempfile.TemporaryDirectory() as folder, Lines42Bench(folder, "listen = 0") as starloop:
                out = socket.create_connection(starloop.address)
                with out, Sender(out.sendall, message):
                    time.sleep(2.0)
                reasons = {reason["kind"]: reason["text"] for reason in starloop.stop()["reasons"]}
                self.assertIn(quote, reasons["no_attitude"])
                self.assertIn(reason, reasons["no_attitude"])
                self.assertIn("spacecraft_number", reasons["no_attitude"])
                self.assertNotIn("id_bits", reasons["no_attitude"])

    def test_packed_doubles_over_udp_in_ten_lines(self):
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder) as starloop:
            over = threading.Event()

            def ten_lines():
                out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                with out:
                    while not over.wait(0.02):
                        t = time.time()
                        q, w = slew(t)
                        out.sendto(struct.pack("<8d", t, *q, *w), starloop.address)

            sender = threading.Thread(target=ten_lines)
            sender.start()
            try:
                self.check_steady(starloop.frames(FRAMES))
            finally:
                over.set()
                sender.join()
            summary = starloop.stop()
        self.assertEqual([reason for reason in summary["link"]["rejects"] if reason.startswith("plain_")], [])
        self.assertNotIn("packets_foreign", summary["link"]["counters"])

    def test_json_draws_the_same_slew(self):
        self.draw(as_json, "link.encoding=json")

    def test_text_in_other_conventions_draws_the_same_slew(self):
        layout = 'link.layout=["t", "q_x", "q_y", "q_z", "q_w", "w_x", "w_y", "w_z"]'
        units = ["link.quaternion=conjugate", "link.rate_unit=deg_s", "link.time_unit=ms"]
        self.draw(as_text, "link.encoding=text", layout, *units)

    def test_big_endian_bench_draws_the_same_slew(self):
        self.draw(lambda t: packed(t, ">"), "link.encoding=f64_be")

    def test_sender_without_a_clock_draws_the_same_slew(self):
        summary = self.draw(lambda t: struct.pack("<8d", 0.0, *slew(t)[0], *slew(t)[1]))
        self.assertEqual(summary["link"]["counters"]["clock_pairs"], 0)
        self.draw(packed, "link.time=arrival")

    def test_clock_of_any_epoch_is_estimated(self):
        shifted = lambda t: struct.pack("<8d", t - START_S + 1e5, *slew(t)[0], *slew(t)[1])
        summary = self.draw(shifted)
        self.assertGreater(summary["link"]["counters"]["clock_pairs"], FRAMES)

    def test_records_over_tcp_draw_the_same_slew(self):
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder, kind="tcp") as starloop:
            out = socket.create_connection(starloop.address)
            # In pieces, as a stream may come.
            with out, Sender(lambda data: (out.sendall(data[:13]), out.sendall(data[13:])), packed):
                self.check_steady(starloop.frames(FRAMES))

    def test_lines_of_42_from_a_client_are_acknowledged(self):
        with Lines42Bench(self.folder, "listen = 0") as starloop:
            out = socket.create_connection(starloop.address)
            out.settimeout(PATIENCE_S)
            with out, Sender(lambda message: exchange(out, message), as_42):
                self.check_steady(starloop.frames(FRAMES))
            summary = starloop.stop()
        self.assertEqual([reason for reason in summary["link"]["rejects"] if reason.startswith("plain_")], [])

    def test_recorded_text_of_42_is_replayed_by_a_server_that_waits_for_its_answers(self):
        recorded = [as_42(START_S - 1e7 + i / HZ) for i in range(3000)]
        with tempfile.TemporaryDirectory() as folder, Replay(recorded) as replay:
            with Lines42Bench(folder, f"connect = {replay.port}", needs_note=False) as starloop:
                headers = starloop.frames(FRAMES)
                summary = starloop.stop()
            # On a busy machine the replay may stall and then hurry: what that brings is refused by its time.
            plain = {reason: count for reason, count in summary["link"]["rejects"].items() if reason.startswith("plain_")}
            self.assertEqual(plain, {})
        self.assertEqual(replay.broken, [], "every answer was Ack and a zero")
        self.assertGreater(replay.answered, FRAMES)
        # Recorded long ago: the first message is the beginning of the slew that frames show.
        self.check_steady(headers, begin_s=START_S - 1e7)

    def drive(self, folder, messages, *settings, seconds=20, words=()):
        """A run on the virtual clock that a stand-in of 42 drives: the process, and headers of its frames."""
        with Replay(messages, paced=False) as replay:
            settings = ["camera=../cameras/small_tracker.toml", f"link.connect={replay.port}", *settings]
            ran = starloop("run", ROOT / "configs/benches/forty_two.toml", "--clock", "virtual", "--duration", seconds,
                           "--out", Path(folder) / "run", *words, *(part for setting in settings for part in ("--set", setting)),
                           timeout=PATIENCE_S * 5)
        self.assertEqual(replay.broken, [], "every answer was Ack and a zero")
        headers = [fits.getheader(path) for path in sorted((Path(folder) / "run").glob("frame_*.fits"))]
        return ran, headers, replay

    def test_42_drives_the_virtual_clock_by_its_own_handshake(self):
        begin_s = 1_742_385_600.0  # 2025-078-12:00:00
        for form in (as_42, as_42_before_2024):
            with self.subTest(form.__name__), tempfile.TemporaryDirectory() as folder:
                messages = [form(begin_s + i / 10) for i in range(1, 400)]
                ran, headers, replay = self.drive(folder, messages)
                self.assertEqual(ran.returncode, 0, ran.stderr)
                self.assertRegex(ran.stdout, r"^ok: 200 of 200 frames, 0 lost; ")
                self.assertLess(replay.answered, 230, "the run ends by itself")
                # 42's date is that of the frames, and each attitude is that of its own instant.
                self.assertTrue(headers[0]["DATE-OBS"].startswith("2025-03-19T12:00:01"), headers[0]["DATE-OBS"])
                offsets = self.check(headers, begin_s + 1.1, least=200)
                self.assertLess(max(offsets) - min(offsets), 1e-4)

    def test_the_capture_of_a_run_that_42_drove_is_drawn_again_bit_by_bit(self):
        messages = [as_42(1_742_385_600.0 + i / 10) for i in range(1, 200)]
        with tempfile.TemporaryDirectory() as folder:
            capture = Path(folder) / "capture"
            ran, _, _ = self.drive(folder, messages, seconds=5, words=("--capture", capture))
            self.assertEqual(ran.returncode, 0, ran.stderr)
            again = starloop("replay", capture, "--json")
            self.assertEqual(again.returncode, 0, again.stderr)
            facts = json.loads(again.stdout)
            self.assertEqual((facts["compared"], facts["differing"], facts["uncompared"]), (50, 0, 0))
            samples = capture / "samples.csv"
            lines = samples.read_text().splitlines(keepends=True)
            samples.write_text("".join(lines[:-20]))
            self.assertNotEqual(starloop("replay", capture).returncode, 0, "control: samples are missing")

    def test_42_that_stops_or_sends_other_lines_is_no_ok(self):
        begin_s = 1_742_385_600.0
        with tempfile.TemporaryDirectory() as folder:
            ran, headers, _ = self.drive(folder, [as_42(begin_s + i / 10) for i in range(1, 60)])
            self.assertNotEqual(ran.returncode, 0)
            self.assertRegex(ran.stdout, r"^INCOMPLETE: \d+ of 200 frames")
            self.assertGreater(len(headers), 30, "what was drawn by then is kept")
        with tempfile.TemporaryDirectory() as folder:
            other = [as_42(begin_s + i / 10).replace(b"SC[0]", b"SC[1]") for i in range(1, 60)]
            ran, _, _ = self.drive(folder, other)
            self.assertNotEqual(ran.returncode, 0)
            self.assertIn("link.spacecraft_number", ran.stderr)
        with tempfile.TemporaryDirectory() as folder:
            # One message of many has no attitude: it is answered, counted, and the run goes on.
            messages = [as_42(begin_s + i / 10) for i in range(1, 400)]
            messages[50] = messages[50].replace(b"SC[0].qn", b"SC[0].other")
            ran, headers, _ = self.drive(folder, messages)
            self.assertEqual(len(headers), 200)
            self.assertEqual(summary_of(Path(folder) / "run")["event_counts"]["sample_refused"], 1)

    def test_big_endian_bytes_on_a_little_endian_bench_are_refused_and_counted(self):
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder) as starloop:
            out = udp_to(starloop.address)
            with out, Sender(out.send, lambda t: packed(t, ">")):
                time.sleep(2.0)
            self.assertEqual(starloop.headers(), [], "no frame has stars")
            summary = starloop.stop()
        rejects = summary["link"]["rejects"]
        refused = rejects.get("plain_quaternion_norm", 0) + rejects.get("plain_not_finite", 0)
        self.assertGreater(refused, 10, rejects)
        self.assertGreater(summary["event_counts"]["input_refused"], 0)
        self.assertEqual(summary["link"]["counters"]["attitudes_accepted"], 0)

    def test_second_sender_is_refused_and_counted(self):
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder) as starloop:
            first, second = udp_to(starloop.address), udp_to(starloop.address)
            wrong = lambda t: struct.pack("<8d", t, 1, 0, 0, 0, 0, 0, 0)
            with first, second, Sender(first.send, packed):
                starloop.frames(2)
                with Sender(second.send, wrong):
                    self.check_steady(starloop.frames(FRAMES))
            summary = starloop.stop()
        self.assertGreater(summary["link"]["counters"]["packets_foreign"], 5)
        self.assertGreater(summary["event_counts"]["input_refused"], 0)

    def test_sender_that_jumps_is_an_event_and_its_attitudes_are_those_it_sends_now(self):
        jump = {"s": 0.0}
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder) as starloop:
            out = udp_to(starloop.address)
            with out, Sender(out.send, lambda t: packed(t + jump["s"])):
                before = len(starloop.frames(FRAMES))
                jump["s"] = -100.0
                # Frames from before may still be on their way to the disk.
                limit = time.monotonic() + PATIENCE_S
                offsets = [0.0]
                while offsets[-1] > -50.0 and time.monotonic() < limit:
                    before = len(starloop.frames(before + 1))
                    offsets = self.check(starloop.headers())
            summary = starloop.stop()
        self.assertGreater(summary["event_counts"]["clock_stepped"], 0)
        self.assertAlmostEqual(offsets[-1] - offsets[0], -100.0, delta=0.5)

    def test_sender_that_stops_or_hangs_is_an_event_and_draws_nothing_old_as_new(self):
        hung = {"message": None}
        with tempfile.TemporaryDirectory() as folder, Stimulator(folder) as starloop:
            out = udp_to(starloop.address)
            with out, Sender(out.send, lambda t: hung["message"] or packed(t)):
                starloop.frames(FRAMES)
                hung["message"] = packed(time.time())
                time.sleep(3.0)
            self.check_steady(starloop.headers())
            summary = starloop.stop()
        self.assertGreater(summary["event_counts"]["sample_refused"], 10, "repeated")
        stopped = ("attitude_held", "blank", "attitude_missing", "attitude_stopped")
        self.assertGreater(sum(summary["event_counts"].get(kind, 0) for kind in stopped), 5, summary["event_counts"])
        self.assertEqual(summary["event_counts"].get("clock_stepped", 0), 0)

    def test_simulated_flight_computer_over_every_plain_carrier(self):
        for link in ('kind = "simulated"\nwire = "plain"', 'kind = "udp"\nlisten = 0\nencoding = "json"',
                     'kind = "tcp"\nlisten = 0'):
            with self.subTest(link=link), tempfile.TemporaryDirectory() as folder:
                bench = Path(folder) / "bench.toml"
                bench.write_text(f'name = "plain"\ncamera = "{ROOT}/configs/cameras/small_tracker.toml"\nseed = 1\n'
                                 f"[timing]\nframe_rate_hz = 10.0\nduration_s = 2.0\n[link]\n{link}\n"
                                 '[sink]\nkind = "recorder"\ndirectory = "out"\n')
                clock = "virtual" if "simulated" in link else "real"
                done = starloop("run", bench, "--clock", clock, "--out", Path(folder) / "run", timeout=PATIENCE_S)
                summary = summary_of(Path(folder) / "run")
                self.assertGreater(summary["link"]["counters"]["attitudes_accepted"], 50, done.stderr)
                # On the real clock a busy machine may make marks late, and outliers of those after them.
                rejects = summary["link"]["rejects"]
                plain = {reason: count for reason, count in rejects.items() if reason.startswith("plain_")}
                self.assertEqual(rejects if clock == "virtual" else plain, {})

    def test_real_socket_on_the_virtual_clock_is_refused(self):
        done = starloop("run", ROOT / "configs/benches/udp.toml", "--clock", "virtual", "--sink", "null")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("--clock virtual: got a bench with", done.stderr)


class Lines42Bench(Stimulator):
    """A bench that reads 42's lines."""

    def __init__(self, folder, link, needs_note=True):
        bench = Path(folder) / "bench.toml"
        bench.write_text(f'name = "lines_42"\ncamera = "{ROOT}/configs/cameras/small_tracker.toml"\nseed = 1\n'
                         "[timing]\nframe_rate_hz = 10.0\nduration_s = 120.0\n"
                         f'[link]\nkind = "tcp"\nencoding = "42"\n{link}\n'
                         '[flight_computer]\nkind = "external"\nattitude_hz = 50.0\n'
                         '[sink]\nkind = "recorder"\ndirectory = "out"\n')
        self.begin(folder, bench, "tcp" if needs_note else None)


def exchange(connection, message):
    """Writes a message as 42 does, and waits for its answer; what was wrong with it."""
    connection.sendall(message)
    answer = b""
    while len(answer) < 4:
        data = connection.recv(4 - len(answer))
        if not data:
            raise OSError("closed")
        answer += data
    if answer != b"Ack\0":
        raise AssertionError(answer)


class Replay:
    """42's side as a server: plays recorded messages, one per step, and waits for each answer."""

    def __init__(self, messages, paced=True):
        self.messages, self.paced, self.broken, self.answered = messages, paced, [], 0
        self.over = threading.Event()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(0.2)
        self.port = self.listener.getsockname()[1]
        self.thread = threading.Thread(target=self.run)

    def run(self):
        connection = None
        while connection is None and not self.over.is_set():
            try:
                connection, _ = self.listener.accept()
            except TimeoutError:
                pass
        if connection is None:
            return
        connection.settimeout(PATIENCE_S)
        begin = time.monotonic()
        with connection:
            for step, message in enumerate(self.messages):
                if self.paced and self.over.wait(max(0.0, begin + step / HZ - time.monotonic())):
                    return
                try:
                    exchange(connection, message)
                    self.answered += 1
                    if step == 0:
                        # The bench was not ready before: a replay that caught up would run faster than its own clock.
                        begin = time.monotonic()
                except AssertionError as answer:
                    self.broken.append(str(answer))
                except OSError:
                    return

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()
        self.listener.close()


if __name__ == "__main__":
    unittest.main()
