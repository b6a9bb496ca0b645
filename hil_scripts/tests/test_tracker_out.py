"""The telemetry of star trackers with other people's clients: python3 hil_scripts/tests/test_tracker_out.py

Needs canopen, python-can, pyserial, spacepackets, xxhash (requirements_flight_computer.txt, requirements_interop.txt),
a C compiler, and nc.

A head turns by a degree; the attitude that each client receives is compared with the truth of the frame of its time tag, in
the recording. A tracker without errors shows what the protocol costs: its resolution. The latency is what packets say of
themselves, and exact on the virtual clock. Every comparison has a control: a tracker that is off by 30 arcsec fails it.
"""

import ast
import contextlib
import json
import math
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import tty
import unittest
from pathlib import Path

import can
import canopen
import serial
import xxhash
from spacepackets.ecss import PusTc, PusTm

from support import ARCSEC, BINARY, PATIENCE_S, ROOT, InAFolder, Running, about_y, bench_text, free_port, output, product, rows_of, starloop, summary_of, until
from starloop.client import Starloop, attitude_sample

EDS = ROOT / "src/telemetry/canopen/starloop_tracker.eds"
SLEW = """
[flight_computer.slew]
axis = [0.0, -1.0, 0.0]
angle_deg = 1.0
start_s = 1.0
duration_s = 3.0
[sink]
kind = "recorder"
fits = false
"""
PERFECT = """source = "model"
[tracker_out.model]
fov_spatial_arcsec = [0.0, 0.0, 0.0]
pixel_spatial_arcsec = [0.0, 0.0, 0.0]
noise_arcsec = [0.0, 0.0, 0.0]
"""
OFF = "bias_arcsec = [30.0, 0.0, 0.0]\n"
EXPOSURE_MS = 100.0
READOUT_MS = 20.0
DELAY_MS = 50.0
LATENCY_NS = round((EXPOSURE_MS / 2 + READOUT_MS + DELAY_MS) * 1e6)
"""From the middle of the exposure to the packet: the small tracker's exposure and readout, and delay_ms."""
# Steps of a quaternion's component on the wire. The truth has 15 digits.
DOUBLE, SINGLE, NOS3 = 1e-14, 6e-8, 1 / 32767
CUC_NS = 60
NOISE_ARCSEC = (1.0, 1.0, 6.0)
TAI_1958_S = 378691200


def text(outs, more=SLEW, duration_s=5):
    """A bench with these [[tracker_out]] tables."""
    bench = bench_text("trackers").replace("frame_rate_hz", f"duration_s = {duration_s}\nframe_rate_hz")
    return bench + more + "".join(f"[[tracker_out]]\n{out}\n" for out in outs)


def truths(folder):
    """Frames of a recording: number, TAI ns of mid-exposure, w x y z."""
    return [(int(row["frame"]), int(row["mid_exposure_tai_ns"]), [float(row[f"q{part}"]) for part in "wxyz"]) for row in rows_of(folder)]


def off_by(q, truth):
    """Largest difference of a component; q and -q are the same."""
    return min(max(abs(sign * a - b) for a, b in zip(q, truth)) for sign in (1, -1))


def conjugate(q):
    return [q[0], -q[1], -q[2], -q[3]]


class Run(Running):
    """A run on the real clock; as a context it ends with it."""

    def __init__(self, folder, outs, duration_s=12, more=SLEW):
        self.folder = Path(folder)
        bench = self.folder / "bench.toml"
        bench.write_text(text(outs, more, duration_s))
        self.out = self.folder / "run"
        super().__init__(BINARY, "run", bench, "--out", self.out)

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.ended()

    def line(self, begin):
        """Waits for a line of the run that begins so, and returns the rest of it."""
        return self.wait_for(f"^{re.escape(begin)}(.*)")[1]

    def end(self):
        """Waits for the end; returns the counts of the first tracker."""
        self.ended()
        return self.row()

    def row(self, number=0):
        return next(row for row in summary_of(self.out)["sinks"] if row["place"] == f"tracker_out[{number}]")


class Slip:
    """SLIP frames with XXH32, written from RFC 1055 and the driver's address, seed and byte order."""

    def __init__(self):
        self.bytes, self.frames, self.bad = bytearray(), [], 0

    @staticmethod
    def encode(content):
        frame = content + xxhash.xxh32(content, seed=1425).intdigest().to_bytes(4, "little")
        return b"\xc0" + frame.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc") + b"\xc0"

    def feed(self, data):
        self.bytes += data
        *whole, rest = bytes(self.bytes).split(b"\xc0")
        self.bytes = bytearray(rest)
        for frame in filter(None, whole):
            frame = frame.replace(b"\xdb\xdc", b"\xc0").replace(b"\xdb\xdd", b"\xdb")
            content, digest = frame[:-4], frame[-4:]
            if xxhash.xxh32(content, seed=1425).intdigest() == int.from_bytes(digest, "little"):
                self.frames.append(content)
            else:
                self.bad += 1
        return self


def solution(frame):
    """Unix us, q w x y z in starloop's sense, valid, of a Sagitta solution."""
    assert frame[:4] in (b"\x21\x84\x18\x00", b"\x21\x82\x18\x00"), frame[:4].hex()
    return int.from_bytes(frame[8:16], "little"), conjugate(struct.unpack("<4f", frame[16:32])), frame[77]


def housekeeping(packet):
    """TAI ns of the tag and of the packet, w x y z, valid, frame, of TM(3,25)."""
    tm = PusTm.unpack(packet, timestamp_len=8)
    assert (tm.service, tm.message_subtype) == (3, 25)
    def tai_ns(code):
        assert code[0] == 0x1F
        return (int.from_bytes(code[1:5], "big") - TAI_1958_S) * 10**9 + (int.from_bytes(code[5:8], "big") * 10**9 >> 24)
    data = tm.source_data
    sent = tai_ns(bytes(tm.timestamp))
    frame, = struct.unpack(">I", data[12:16])
    return tai_ns(data[2:10]), sent, list(struct.unpack(">4d", data[18:50])), data[11], frame


class VirtualClock(InAFolder):
    """Every protocol into a file: attitudes of all frames, exact latencies, the same bytes each time."""

    def run_to(self, folder, outs, *settings, more=SLEW):
        bench = Path(folder) / "bench.toml"
        bench.write_text(text(outs, more))
        out = Path(folder) / "run"
        starloop("run", bench, "--clock", "virtual", "--out", out, *settings, status=0)
        return out

    @staticmethod
    def lines(path):
        """Instant, identifier or None, bytes, of a file of telemetry."""
        for line in path.read_text().splitlines():
            _utc, ns, identifier, data = line.split()
            yield int(ns), None if identifier == "-" else int(identifier, 16), bytes.fromhex(data)

    def worst(self, protocol, path, truth):
        """Frames seen, largest error of a component, latencies, of a file."""
        by_tag, frames, worst, latencies = {tag: q for _, tag, q in truth}, 0, 0.0, set()
        slip, parts = Slip(), {}
        for at, identifier, data in self.lines(path):
            tag = None
            if protocol == "json":
                got = json.loads(data)
                tag, q = got["tai_ns"], got["q_wxyz"]
                self.assertEqual(got["sent_tai_ns"], at)
            elif protocol == "ccsds" and data[7:9] == b"\x03\x19":
                tag, sent, q, valid, frame = housekeeping(data)
                self.assertTrue(valid and 0 <= at - sent < CUC_NS and 0 <= truth[frame][1] - tag < CUC_NS)
                tag = truth[frame][1]
            elif protocol == "sagitta" and slip.feed(data).frames and slip.frames[-1][2] == 24:
                us, q, _ = solution(slip.frames.pop())
                tag = next(tag for tag in by_tag if (tag - 37 * 10**9) // 1000 == us)
            elif protocol == "canopen" and identifier in (0x1E0, 0x2E0, 0x3E0, 0x4E0):
                parts[identifier] = data
                if identifier != 0x4E0:
                    continue
                frame, = struct.unpack("<6xH", data)
                tag = truth[frame][1]
                self.assertEqual(struct.unpack("<4xI", parts[0x1E0])[0], (tag // 10**6 - 37000) % 86400000)
                q = struct.unpack("<ff", parts[0x2E0]) + struct.unpack("<ff", parts[0x3E0])
            if tag is not None:
                frames += 1
                worst = max(worst, off_by(q, by_tag[tag]))
                latencies.add(at - tag)
        return frames, worst, latencies

    def test_every_protocol_has_the_attitude_of_its_frame_at_the_stated_latency(self):
        protocols = {"json": DOUBLE, "ccsds": DOUBLE, "sagitta": SINGLE, "canopen": SINGLE}
        for bias, is_right in ("", True), (OFF, False):
            outs = []
            for protocol in protocols:
                start = "starts_operational = true\n" if protocol == "canopen" else ""
                outs.append(f'protocol = "{protocol}"\nlink = "file"\npath = "{protocol}.txt"\n{start}{PERFECT}{bias}')
            with self.subTest(bias=bias), tempfile.TemporaryDirectory() as folder:
                out = self.run_to(folder, outs)
                truth = truths(out)
                for protocol, resolution in protocols.items():
                    frames, worst, latencies = self.worst(protocol, out / f"{protocol}.txt", truth)
                    self.assertEqual((frames, latencies), (50, {LATENCY_NS}), protocol)
                    self.assertEqual(worst <= resolution, is_right, f"{protocol}: {worst}")

    def test_the_tracker_on_pixels_is_within_its_noise_and_a_run_repeats(self):
        out_keys = 'link = "file"\npath = "t.txt"'
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two, tempfile.TemporaryDirectory() as three:
            first = self.run_to(one, [out_keys])
            by_tag, errors = {tag: q for _, tag, q in truths(first)}, []
            reports = [json.loads(data) for _, _, data in self.lines(first / "t.txt")]
            for got in reports:
                w, *xyz = product(got["q_wxyz"], conjugate(by_tag[got["tai_ns"]]))
                errors.append([2 * math.copysign(1, w) * part / ARCSEC for part in xyz])
            rms = [math.sqrt(sum(error[axis] ** 2 for error in errors) / len(errors)) for axis in range(3)]
            # Noise of 0.2 and 1.6 arcsec as the tracker expects it, and the errors of places on their pixels.
            self.assertTrue(all(value < most for value, most in zip(rms, NOISE_ARCSEC)), rms)
            self.assertGreater(math.hypot(rms[0], 30.0), NOISE_ARCSEC[0], "control: 30 arcsec off")
            self.assertTrue(all(0.1 < got["sigma_arcsec"][0] < 0.5 for got in reports))
            again = self.run_to(two, [out_keys])
            self.assertEqual((first / "t.txt").read_bytes(), (again / "t.txt").read_bytes())
            other = self.run_to(three, [out_keys], "--noise-seed", "9")
            self.assertNotEqual((first / "t.txt").read_bytes(), (other / "t.txt").read_bytes(), "control: other noise")

    def test_rates_of_the_head_of_the_packets_and_late_time_tags(self):
        outs = [f'link = "file"\npath = "frames.txt"\n{PERFECT}', f'link = "file"\npath = "beats.txt"\nrate_hz = 8.0\n{PERFECT}',
                f'link = "file"\npath = "late.txt"\ntag_error_ms = 7.0\n{PERFECT}']
        out = self.run_to(self.folder, outs)
        frames, beats, late = ([(at, json.loads(data)) for at, _, data in self.lines(out / f"{name}.txt")]
                               for name in ("frames", "beats", "late"))
        true = [[float(row[f"rate_{axis}_deg_s"]) for axis in "xyz"] for row in rows_of(out)]
        self.assertIsNone(frames[0][1]["rate_deg_s"], "one attitude has no rate")
        for number in range(1, 50):
            rate = frames[number][1]["rate_deg_s"]
            between = [(a + b) / 2 for a, b in zip(true[number - 1], true[number])]
            self.assertLess(max(abs(a - b) for a, b in zip(rate, between)), 5e-3, number)
        fastest = max(range(50), key=lambda number: abs(true[number][1]))
        self.assertGreater(abs(frames[fastest][1]["rate_deg_s"][1] + true[fastest][1]), 0.5, "control: the other sign")
        # The beats begin with the first exposure; those before the first report send nothing.
        zero = frames[0][1]["tai_ns"] - round(EXPOSURE_MS / 2 * 1e6)
        self.assertTrue(all((at - zero) % 125_000_000 == 0 for at, _ in beats))
        ready = [(tag + LATENCY_NS, number) for number, (_, tag, _) in enumerate(truths(out))]
        for at, report in beats:
            self.assertEqual(report["frame"], max(number for due, number in ready if due <= at))
        tags = [(report["tai_ns"], report["q_wxyz"]) for _, report in late]
        self.assertEqual(tags, [(report["tai_ns"] + 7_000_000, report["q_wxyz"]) for _, report in frames])

    def test_three_heads_have_a_tracker_each(self):
        heads = "".join(f"[[head]]\nsensor_from_body = {q}\n" for q in
                        ([1.0, 0.0, 0.0, 0.0], [0.9238795325112867, 0.0, 0.3826834323650898, 0.0], [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]))
        outs = [f'head = {head}\nlink = "file"\npath = "head{head}.txt"\n{PERFECT}' for head in range(3)]
        out = self.run_to(self.folder, outs, more=SLEW + heads)
        truth = [truths(out / f"head{head}") for head in range(3)]
        for head in range(3):
            for other in range(3):
                _, worst, _ = self.worst("json", out / f"head{head}.txt", truth[other])
                self.assertEqual(worst <= DOUBLE, head == other, (head, other, worst))

    def test_faults_begin_and_end_and_are_counted(self):
        def fault(kind, more=""):
            return f'link = "file"\npath = "{kind}.txt"\n{PERFECT}[[tracker_out.fault]]\nkind = "{kind}"\nat_s = 2.0\nfor_s = 1.0\n{more}'
        more = {"drop": "", "corrupt": "", "freeze": "", "invalid": "", "bias": "bias_arcsec = [0.0, 60.0, 0.0]", "late": "late_ms = 33.0"}
        out = self.run_to(self.folder, [fault(kind, keys) for kind, keys in more.items()])
        rows = {row["place"]: row for row in summary_of(out)["sinks"]}
        truth = {tag: q for _, tag, q in truths(out)}
        zero = min(truth) - round(EXPOSURE_MS / 2 * 1e6)
        for number, kind in enumerate(more):
            with self.subTest(kind=kind):
                self.assertEqual(rows[f"tracker_out[{number}]"]["counts"]["faults"], 10)
                got = list(self.lines(out / f"{kind}.txt"))
                self.assertEqual(len(got), 40 if kind == "drop" else 50)
                spoiled = 0
                for at, _, data in got:
                    try:
                        report = json.loads(data)
                        right = report["valid"] and off_by(report["q_wxyz"], truth[report["tai_ns"]]) <= DOUBLE
                        late = at - report["tai_ns"] - LATENCY_NS
                    except (ValueError, KeyError, TypeError):
                        right, late = False, 0
                    is_in = zero + 2 * 10**9 <= at - (33 * 10**6 if kind == "late" and late else 0) < zero + 3 * 10**9
                    is_spoiled = not right or late != 0
                    spoiled += is_spoiled
                    self.assertTrue(is_in or not is_spoiled, (kind, at - zero))
                # A flipped bit may leave JSON that says nearly the same; a frozen head at its end may be where it was.
                self.assertGreaterEqual(spoiled, {"drop": 0, "corrupt": 5}.get(kind, 10), kind)

    def test_lines_that_have_no_virtual_time_are_refused(self):
        bench = self.written("bench.toml", text([f'protocol = "nos3"\nlink = "pty"\npath = "{self.folder}/st"']))
        done = starloop("run", bench, "--clock", "virtual", "--out", self.out)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("[[tracker_out]]", done.stderr)
        self.assertIn("--clock real", done.stderr)


class PlantOutside(InAFolder):
    def test_a_plant_that_is_stepped_from_outside_has_a_tracker_too(self):
        """Attitudes of a client, which the bench does not know, come back out of the telemetry."""
        rate = 0.01
        bench, out = self.folder / "bench.toml", self.folder / "run"
        shipped = (ROOT / "configs/benches/lockstep.toml").read_text().replace("../cameras", str(ROOT / "configs/cameras"))
        bench.write_text(f'{shipped}[[tracker_out]]\nlink = "file"\npath = "t.txt"\n{PERFECT}')
        with Starloop.start(BINARY, bench, settings={"timing.duration_s": 1.0}, arguments=["--out", str(out)]) as loop:
            times = [round(0.01 * k - 0.1, 9) for k in range(130)]
            loop.attitude([attitude_sample(t_s, about_y(rate * t_s), [0.0, rate, 0.0]) for t_s in times])
            loop.step(until_s=1.0)
            loop.finish()
        reports = [json.loads(data) for _, _, data in VirtualClock.lines(out / "t.txt")]
        self.assertEqual(len(reports), 10)
        first = reports[0]["tai_ns"]
        for number, got in enumerate(reports):
            t_s = (got["tai_ns"] - first) * 1e-9 + EXPOSURE_MS / 2 * 1e-3
            self.assertLessEqual(off_by(got["q_wxyz"], about_y(rate * t_s)), 1e-10, number)
            self.assertGreater(off_by(got["q_wxyz"], about_y(rate * (t_s + 0.01))), 1e-10, "control: 10 ms later")


def canopen_network(stack, port):
    """The CAN bus behind a pseudo terminal, until `stack` ends."""
    network = canopen.Network()
    stack.callback(network.disconnect)
    network.connect(interface="slcan", channel=str(port), bitrate=500000, sleep_after_open=0.1)
    return network


class Clients(InAFolder):
    """Each protocol on the real clock with a client that is not ours."""

    def check(self, got, truth, resolution):
        """Pairs of (TAI ns or None, w x y z): right to the resolution, and the head has turned while they came."""
        by_tag = {tag: q for _, tag, q in truth}
        self.assertGreater(len(got), 20)
        for tag, q in got:
            error = off_by(q, by_tag[tag])
            self.assertLessEqual(error, resolution)
        # Half of a degree: the slew was seen.
        self.assertGreater(off_by(got[0][1], got[-1][1]), 0.004)
        self.assertGreater(off_by(got[0][1], by_tag[got[-1][0]]), resolution, "control: another frame's truth")

    def test_json_over_udp_and_commands(self):
        with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.bind(("127.0.0.1", 0))
            client.settimeout(PATIENCE_S)
            out = f'link = "udp"\nsend_to = {client.getsockname()[1]}\n{PERFECT}'
            with Run(folder, [out]) as run:
                got = []
                while len(got) < 45:
                    data, address = client.recvfrom(4096)
                    got.append(json.loads(data))
                def asked(**command):
                    client.sendto(json.dumps(command).encode(), address)
                    return next(reply for reply in iter(lambda: json.loads(client.recv(4096)), None) if "reply" in reply)
                self.assertTrue(asked(command="ping")["ok"])
                self.assertTrue(asked(command="standby")["ok"])
                resting = until("standby", lambda: (report := json.loads(client.recv(4096))).get("mode") == "standby" and report)
                self.assertIsNone(resting["q_wxyz"])
                self.assertTrue(asked(command="operate")["ok"])
                until("operation", lambda: json.loads(client.recv(4096)).get("valid"))
                self.assertTrue(asked(command="exposure", exposure_ms=60.0)["ok"])
                until("the exposure", lambda: json.loads(client.recv(4096)).get("exposure_ms") == 60.0)
                self.assertFalse(asked(command="exposure", exposure_ms=1e9)["ok"])
                self.assertFalse(asked(command="dance")["ok"])
                run.stop()
            self.check([(report["tai_ns"], report["q_wxyz"]) for report in got], truths(run.out), DOUBLE)
            # Never before it is ready; afterwards as late as the machine is busy.
            self.assertTrue(all(report["sent_tai_ns"] - report["tai_ns"] >= LATENCY_NS for report in got))
            counts = run.row()["counts"]
            self.assertEqual((counts["commands"], counts["commands_refused"]), (4, 2))

    def test_json_to_netcat(self):
        nc = shutil.which("nc")
        if nc is None:
            self.skipTest("no nc: apt-get install netcat-openbsd")
        with Run(self.folder, [f'link = "tcp"\nlisten = 0\n{PERFECT}']) as run:
            host, port = run.line("tracker_out[0]: json on tcp ").rsplit(":", 1)
            client = subprocess.Popen([nc, host, port], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            client.stdin.write('{"command": "ping"}\n')
            client.stdin.flush()
            lines = [json.loads(client.stdout.readline()) for _ in range(45)]
            client.kill()
            client.communicate()
            run.stop()
        replies = [line for line in lines if "reply" in line]
        self.assertEqual([reply["ok"] for reply in replies], [True])
        got = [(line["tai_ns"], line["q_wxyz"]) for line in lines if "q_wxyz" in line]
        self.check(got, truths(run.out), DOUBLE)

    def test_nos3_with_a_c_program(self):
        program, port = self.folder / "nos3_tracker", self.folder / "st"
        source = ROOT / "hil_scripts/tests/nos3_tracker.c"
        build = ["cc", "-std=c11", "-D_DEFAULT_SOURCE", "-Wall", "-Wextra", "-Werror", "-o", program, source]
        subprocess.run(build, check=True)
        outs = [f'protocol = "nos3"\nlink = "pty"\npath = "{port}"\n{PERFECT}']
        def ask(*words):
            return output(program, port, *words).splitlines()
        def asked(*words, wanted="echo"):
            """A busy machine may miss 50 ms: asks again."""
            return until(f"{wanted} of {words}", lambda: ask(*words) == [wanted])
        with Run(self.folder, outs, duration_s=20) as run:
            run.line("tracker_out[0]: nos3 on pty ")
            lines = ask("data", 250, 20)
            counters = [int(line) for line in ask("housekeeping", 4, 1) if line != "timeout"]
            self.assertEqual(ask("broken", 0, 0), ["timeout"], "control: a wrong end has no echo")
            asked("command", 0, 0)
            asked("command", 3, 1)
            until("not valid in standby", lambda: ask("data", 1, 100)[0].endswith(" 0"))
            asked("command", 3, 2)
            until("valid again", lambda: ask("data", 1, 100)[0].endswith(" 1"))
            run.stop()
        truth = truths(run.out)
        got = [line.split() for line in lines if line != "timeout" and line.endswith(" 1")]
        got = [conjugate([float(part) for part in [words[3], *words[:3]]]) for words in got]
        self.assertGreater(len(got), 100)
        # The tracker has no time tag: each attitude is that of a frame, never of an earlier one than before.
        place, frames = 0, []
        for q in got:
            while off_by(q, truth[place][2]) > NOS3:
                place += 1
                self.assertLess(place, len(truth), f"{q} is the attitude of no frame from {frames[-1:]} on")
            frames.append(place)
        self.assertGreater(off_by(got[0], got[-1]), 0.004, "the slew was seen")
        self.assertGreater(off_by(got[0], truth[frames[-1]][2]), NOS3, "control: another frame's truth")
        self.assertTrue(counters and all(b - a == 2 for a, b in zip(counters, counters[1:])), counters)

    def test_canopen_over_slcan(self):
        port = self.folder / "can"
        out = f'protocol = "canopen"\nlink = "slcan_pty"\npath = "{port}"\nheartbeat_ms = 200\n{PERFECT}'
        with contextlib.ExitStack() as stack:
            run = stack.enter_context(Run(self.folder, [out], duration_s=40, more=SLEW.replace("start_s = 1.0", "start_s = 6.0")))
            run.line("tracker_out[0]: canopen on slcan ")
            network = canopen_network(stack, port)
            node = network.add_node(96, str(EDS))
            node.nmt.wait_for_heartbeat(PATIENCE_S)
            self.assertEqual(node.nmt.state, "PRE-OPERATIONAL")
            node.sdo.RESPONSE_TIMEOUT = 5.0
            node.tpdo.read()
            got, parts, whole = [], {}, threading.Event()
            def take(pdo):
                parts.update({variable.name: variable.raw for variable in pdo})
                if pdo is node.tpdo[4] and "Attitude.Real part" in parts:
                    got.append(dict(parts))
                    if len(got) >= 80:
                        whole.set()
            for number in 1, 2, 3, 4:
                node.tpdo[number].add_callback(take)
            node.nmt.state = "OPERATIONAL"
            self.assertTrue(whole.wait(PATIENCE_S), f"{len(got)} attitudes")
            node.nmt.wait_for_heartbeat(PATIENCE_S)
            self.assertEqual(node.nmt.state, "OPERATIONAL")
            node.sdo["Producer heartbeat time"].raw = 100
            self.assertEqual(node.sdo["Producer heartbeat time"].raw, 100)
            node.sdo["State"].raw = 2
            until("standby", lambda: node.sdo["Attitude"]["Known"].raw == 0)
            node.sdo["State"].raw = 4
            until("operation", lambda: node.sdo["Attitude"]["Known"].raw == 1)
            node.sdo["Exposure, us"].raw = 60000
            for index, value in ("Exposure, us", 4 * 10**9), ("State", 9):
                with self.assertRaises(canopen.SdoAbortedError) as refused:
                    node.sdo[index].raw = value
                self.assertEqual(refused.exception.code, 0x06090030)
            stack.close()
        truth = truths(run.out)
        pairs = []
        for report in got[:80]:
            frame, tag, _ = truth[report["Frame, low 16 bits"]]
            self.assertEqual(report["Attitude.Milliseconds of the UTC day at mid-exposure"], (tag // 10**6 - 37000) % 86400000)
            self.assertEqual((report["State"], report["Attitude.Known"]), (4, 1))
            pairs.append((tag, [report["Attitude.Real part"], *(report[f"Attitude.{part}"] for part in "ijk")]))
        self.check(pairs, truth, SINGLE)

    def test_canopen_with_the_map_of_oresat(self):
        """A client with the file of the run; beside it the bytes at the identifiers of node 44 in OreSat1's own files."""
        port = self.folder / "can"
        out = f'protocol = "canopen"\nlink = "slcan_pty"\npath = "{port}"\nnode_id = 44\npdo_map = "oresat"\n{PERFECT}'
        with contextlib.ExitStack() as stack:
            run = stack.enter_context(Run(self.folder, [out], duration_s=25, more=SLEW.replace("start_s = 1.0", "start_s = 6.0")))
            run.line("tracker_out[0]: canopen on slcan ")
            network = canopen_network(stack, port)
            node = network.add_node(44, str(until("the EDS file", lambda: next(run.out.glob("*_oresat.eds"), None))))
            node.sdo.RESPONSE_TIMEOUT = 5.0
            node.tpdo.read()
            self.assertEqual([node.tpdo[number].cob_id for number in (3, 4, 5)], [0x3AC, 0x4AC, 0x1AD])
            got, parts, raw, whole = [], {}, {}, threading.Event()
            def take(pdo):
                parts.update({variable.name: variable.raw for variable in pdo})
                if pdo is node.tpdo[5] and "Attitude.Real part" in parts:
                    got.append(dict(parts))
                    if len(got) >= 90:
                        whole.set()
            for number in 3, 4, 5:
                node.tpdo[number].add_callback(take)
                network.subscribe(node.tpdo[number].cob_id, lambda identifier, data, _stamp: raw.update({identifier: bytes(data)}))
            node.nmt.state = "OPERATIONAL"
            self.assertTrue(whole.wait(PATIENCE_S), f"{len(got)} attitudes")
            stack.close()
        status, known, _ms = struct.unpack("<BBI", raw[0x3AC])
        self.assertEqual((status, known), (4, 1))
        self.assertEqual([len(raw[identifier]) for identifier in (0x4AC, 0x1AD)], [8, 8])
        truth = truths(run.out)
        by_ms = {(tag // 10**6 - 37000) % 86400000: tag for _, tag, _ in truth}
        time = "Attitude.Milliseconds of the UTC day at mid-exposure"
        self.check([(by_ms[report[time]], [report["Attitude.Real part"], *(report[f"Attitude.{part}"] for part in "ijk")])
                    for report in got], truth, SINGLE)

    def test_the_runs_own_bus_has_the_tracker_beside_the_simulators_messages(self):
        """Node 96 on the bus that the flight computer's messages are on, for a client of the bus's gateway."""
        port = self.folder / "bus"
        out = f'protocol = "canopen"\nlink = "bus"\nstarts_operational = true\n{PERFECT}'
        link = f'[link]\nkind = "simulated"\nwire = "can_classic"\nslcan_pty = "{port}"\n'
        with contextlib.ExitStack() as stack:
            run = stack.enter_context(Run(self.folder, [out], more=SLEW + link))
            run.line("tracker_out[0]: canopen on ")
            bus = stack.enter_context(can.Bus(interface="slcan", channel=str(port), bitrate=500000, sleep_after_open=0.1))
            got, parts, others = [], {}, set()
            while len(got) < 45:
                message = bus.recv(PATIENCE_S)
                parts[message.arbitration_id] = bytes(message.data)
                others.add(message.arbitration_id)
                if message.arbitration_id == 0x4E0 and 0x1E0 in parts:
                    q = struct.unpack("<ff", parts[0x2E0]) + struct.unpack("<ff", parts[0x3E0])
                    got.append((struct.unpack("<6xH", parts[0x4E0])[0], q))
        truth = truths(run.out)
        self.assertTrue({0x180, 0x210, 0x250} <= others, "EXPOSURE and attitudes")
        self.check([(truth[frame][1], q) for frame, q in got], truth, SINGLE)

    def test_sagitta_over_a_serial_port(self):
        """The port is one end of a pair of terminals that this test holds."""
        ours, theirs = os.openpty()
        self.addCleanup(os.close, ours)
        self.addCleanup(os.close, theirs)
        tty.setraw(theirs)
        out = f'protocol = "sagitta"\nlink = "serial"\npath = "{os.ttyname(theirs)}"\n{PERFECT}'
        with Run(self.folder, [out], duration_s=12) as run:
            slip, solutions, answers = Slip(), [], []
            def read():
                slip.feed(os.read(ours, 512))
                solutions.extend(frame for frame in slip.frames if frame[1:3] == b"\x84\x18")
                answers.extend(frame for frame in slip.frames if frame[1] == 129)
                slip.frames.clear()
            while len(solutions) < 45:
                read()
            # 0xFF on the way in: the port marks damaged bytes with it.
            os.write(ours, Slip.encode(b"\x21\x01\xff") + Slip.encode(b"\x21\x01\x12"))
            until("both answers", lambda: read() or len(answers) == 2)
            self.assertEqual([answer[2:4] for answer in answers], [b"\xff\x02", b"\x12\x00"])
            run.stop()
        truth = truths(run.out)
        by_us = {(tag - 37 * 10**9) // 1000: tag for _, tag, _ in truth}
        self.check([(by_us[us], q) for us, q, _ in map(solution, solutions)], truth, SINGLE)

    def test_sagitta_over_a_pseudo_terminal(self):
        port = self.folder / "st"
        out = f'protocol = "sagitta"\nlink = "pty"\npath = "{port}"\n{PERFECT}'
        with Run(self.folder, [out], duration_s=15) as run:
            run.line("tracker_out[0]: sagitta on pty ")
            slip, solutions = Slip(), []
            with serial.Serial(str(port), 115200, timeout=0.05) as line:
                def until_frame(kind, number):
                    def found():
                        slip.feed(line.read(512))
                        solutions.extend(frame for frame in slip.frames if frame[1:3] == b"\x84\x18")
                        found = [frame for frame in slip.frames if frame[1:3] == bytes([kind, number])]
                        slip.frames.clear()
                        return found
                    return until(f"frame {kind} {number}", found)[-1]
                while len(solutions) < 45:
                    until_frame(132, 24)
                self.assertEqual(len(until_frame(132, 27)) + 4, 32, "temperatures")
                line.write(Slip.encode(b"\x21\x02\x18"))
                self.assertEqual(solution(until_frame(130, 24))[2], 1)
                broken = bytearray(Slip.encode(b"\x21\x03\x01\x01"))
                self.assertEqual(broken.hex(), "c021030101" + "9c349a61" + "c0", "the published frame")
                broken[2] ^= 1
                line.write(bytes(broken))
                line.write(Slip.encode(b"\x21\x00\x12" + bytes([27] + 15 * [0])))
                self.assertEqual(until_frame(128, 18)[3], 0)
                line.write(Slip.encode(b"\x21\x03\x01\x01"))
                self.assertEqual(until_frame(131, 1), b"\x21\x83\x01\x00")
                line.write(Slip.encode(b"\x21\x01\x09"))
                camera = bytearray(until_frame(129, 9)[4:])
                camera[5:9] = struct.pack("<f", 0.06)
                line.write(Slip.encode(b"\x21\x00\x09" + bytes(camera)))
                self.assertEqual(until_frame(128, 9)[3], 0)
                camera[5:9] = struct.pack("<f", 1e6)
                line.write(Slip.encode(b"\x21\x00\x09" + bytes(camera)))
                self.assertNotEqual(until_frame(128, 9)[3], 0, "control: no such exposure")
            self.assertEqual(slip.bad, 0)
            run.stop()
        truth = truths(run.out)
        by_us = {(tag - 37 * 10**9) // 1000: tag for _, tag, _ in truth}
        self.check([(by_us[us], q) for us, q, valid in map(solution, solutions) if valid], truth, SINGLE)
        self.assertEqual(run.row()["counts"]["commands_refused"], 2)

    def test_space_packets_over_udp_and_tcp(self):
        with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.bind(("127.0.0.1", 0))
            client.settimeout(PATIENCE_S)
            udp = f'protocol = "ccsds"\nlink = "udp"\nsend_to = {client.getsockname()[1]}\n{PERFECT}'
            tcp = f'protocol = "ccsds"\napid = 101\nlink = "tcp"\nlisten = 0\n{PERFECT}'
            with Run(folder, [udp, tcp], duration_s=15) as run:
                host, port = run.line("tracker_out[1]: ccsds on tcp ").rsplit(":", 1)
                with socket.create_connection((host, int(port))) as stream:
                    stream.settimeout(PATIENCE_S)
                    packets = [client.recvfrom(4096) for _ in range(45)]
                    address = packets[0][1]
                    client.sendto(PusTc(service=17, message_subtype=1, apid=100, source_id=7).pack(), address)
                    services = []
                    while services.count((1, 7)) < 1:
                        tm = PusTm.unpack(client.recv(4096), timestamp_len=8)
                        services.append((tm.service, tm.message_subtype))
                    self.assertEqual([service for service in services if service[0] != 3], [(1, 1), (17, 2), (1, 7)])
                    wrong = bytearray(PusTc(service=17, message_subtype=1, apid=100).pack())
                    wrong[-1] ^= 1
                    client.sendto(bytes(wrong), address)
                    # The next request is answered, so the bad one was read.
                    client.sendto(PusTc(service=17, message_subtype=1, apid=100).pack(), address)
                    until("the answer after it", lambda: client.recv(4096)[7:9] == b"\x11\x02")
                    reader = stream.makefile("rb")
                    def packet():
                        head = reader.read(6)
                        return head + reader.read(struct.unpack(">H", head[4:6])[0] + 1)
                    stream.sendall(PusTc(service=8, message_subtype=1, apid=101, app_data=b"\x02" + struct.pack(">I", 60000)).pack())
                    over_tcp = []
                    while not over_tcp or over_tcp[-1][7:9] != b"\x01\x07":
                        over_tcp.append(packet())
                    stream.sendall(PusTc(service=99, message_subtype=1, apid=101).pack())
                    until("the refusal", lambda: packet()[7:9] == b"\x01\x02")
                run.stop()
            truth = truths(run.out)
            for data in [data for data, _ in packets], over_tcp:
                got = [housekeeping(one) for one in data if one[7:9] == b"\x03\x19"]
                by_frame = {frame: tag for frame, tag, _ in truth}
                self.assertTrue(all(0 <= by_frame[frame] - tag < CUC_NS for tag, *_, frame in got))
                self.assertTrue(all(sent - tag > LATENCY_NS - CUC_NS - 30 * 10**6 for tag, sent, *_ in got))
            got = [housekeeping(one) for one, _ in packets if one[7:9] == b"\x03\x19"]
            self.check([(by_frame[frame], q) for _, _, q, valid, frame in got if valid], truth, DOUBLE)
            self.assertEqual(run.row()["counts"]["commands_refused"], 1, "a wrong CRC")

    def test_a_client_that_is_not_there_costs_packets_which_are_counted(self):
        run = Run(self.folder, [f'link = "tcp"\nlisten = 0\n{PERFECT}'], duration_s=2)
        row = run.end()
        self.assertEqual(run.process.returncode, 0, "a client may come later: no failure of the run")
        run.stop()
        self.assertEqual((row["counts"].get("packets", 0), row["counts"]["packets_unread"]), (0, 20))
        self.assertIsNone(row["first_error"])
        events = summary_of(run.out)["event_counts"]
        self.assertEqual(events["telemetry_lost"], 20)


class Guide(InAFolder):
    """The clients of tracker_telemetry.md, as they are written but for paths and ports."""

    PAGE = (ROOT / "src/guide/tracker_telemetry.md").read_text()
    CLIENTS = dict(re.findall(r'<!-- client: protocol = "(\w+)".*? -->\n\n```python\n(.*?)```', PAGE, re.S))
    STEPS = {"canopen": SINGLE, "ccsds": DOUBLE, "nos3": NOS3}

    def printed(self, protocol, keys, place):
        """Returns what a client prints, and the truths of the run."""
        text = self.CLIENTS[protocol].replace("src/telemetry/canopen/starloop_tracker.eds", str(EDS))
        for written, used in place.items():
            self.assertIn(written, text)
            text = text.replace(written, str(used))
        with Run(self.folder, [f'protocol = "{protocol}"\n{keys}\n{PERFECT}'], duration_s=20) as run:
            run.line("tracker_out[0]: ")
            # A tracker without a time tag answers before it has seen its first frame.
            said = lambda: output(sys.executable, "-c", text, timeout=PATIENCE_S)
            last = until("an attitude", lambda: not (last := said()).endswith(" 0\n") and last)
            run.stop()
        return last, [q for _, _, q in truths(run.out)]

    def check(self, q, truth, step):
        self.assertLessEqual(min(off_by(q, true) for true in truth), step)
        self.assertGreater(min(off_by(conjugate(q), true) for true in truth), step, "control: the other sense")

    def test_every_protocol_of_the_page_has_its_client_here(self):
        self.assertEqual(sorted(self.CLIENTS), sorted(self.STEPS))

    def test_canopen(self):
        port = self.folder / "can"
        said, truth = self.printed("canopen", f'link = "slcan_pty"\npath = "{port}"', {"/tmp/star_tracker": port})
        name, *pdos = said.splitlines()
        self.assertEqual(name, "starloop star tracker")
        parts = {key.rsplit(".")[-1]: value for pdo in pdos for key, value in ast.literal_eval(pdo).items()}
        self.check([parts[part] for part in ("Real part", "i", "j", "k")], truth, SINGLE)

    def test_space_packets(self):
        port = free_port(socket.SOCK_DGRAM)
        said, truth = self.printed("ccsds", f'link = "udp"\nsend_to = {port}', {"9002": port})
        self.check(ast.literal_eval(said), truth, DOUBLE)

    def test_nos3(self):
        port = self.folder / "st"
        said, truth = self.printed("nos3", f'link = "pty"\npath = "{port}"', {"/tmp/star_tracker": port})
        q, is_valid = said.rsplit(" ", 1)
        self.assertEqual(int(is_valid), 1)
        *vector, scalar = ast.literal_eval(q)
        self.check(conjugate([scalar, *vector]), truth, NOS3)


class KernelCan(unittest.TestCase):
    def test_canopen_over_an_interface_of_the_kernel(self):
        """On a machine without CAN in its kernel, in user-mode Linux, as test_vcan.py does; STARLOOP_NO_VCAN=1 skips it."""
        if not Path("/sys/class/net/vcan1").exists():
            if os.environ.get("STARLOOP_NO_VCAN") == "1":
                self.skipTest("STARLOOP_NO_VCAN=1")
            command = [ROOT / "hil_scripts/tests/uml_vcan.sh", sys.executable, __file__, "KernelCan"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=3 * PATIENCE_S)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            return
        with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
            out = f'protocol = "canopen"\nlink = "socketcan"\ninterface = "vcan1"\nnode_id = 100\n{PERFECT}'
            run = stack.enter_context(Run(folder, [out], duration_s=20))
            run.line("tracker_out[0]: canopen on socketcan vcan1")
            network = canopen.Network()
            network.connect(interface="socketcan", channel="vcan1")
            stack.callback(network.disconnect)
            node = network.add_node(100, str(EDS))
            node.sdo.RESPONSE_TIMEOUT = 5.0
            # Another node's start, and a request of another node, reach the filters only.
            network.send_message(0x000, [1, 99])
            network.send_message(0x663, [0x40, 0x00, 0x40, 0, 0, 0, 0, 0])
            self.assertEqual(node.sdo["State"].raw, 4)
            got, parts, whole = [], {}, threading.Event()
            def take(message_id, data, _stamp):
                parts[message_id] = bytes(data)
                if message_id == 0x4E4 and 0x1E4 in parts:
                    q = struct.unpack("<ff", parts[0x2E4]) + struct.unpack("<ff", parts[0x3E4])
                    got.append((struct.unpack("<6xH", parts[0x4E4])[0], q))
                    if len(got) >= 45:
                        whole.set()
            for identifier in 0x1E4, 0x2E4, 0x3E4, 0x4E4:
                network.subscribe(identifier, take)
            node.nmt.state = "OPERATIONAL"
            self.assertTrue(whole.wait(PATIENCE_S), f"{len(got)} attitudes")
            run.stop()
            truth = {frame: q for frame, _, q in truths(run.out)}
            for frame, q in got[:45]:
                self.assertLessEqual(off_by(q, truth[frame]), SINGLE)
            self.assertGreater(off_by(got[0][1], truth[got[44][0]]), SINGLE, "control: another frame's truth")


if __name__ == "__main__":
    unittest.main(verbosity=2)
