"""Broken benches are never ok, and their repaired twins are: python3 hil_scripts/tests/test_broken_benches.py

Each bench is flown as its user would: none ends with status 0, the first line that is printed names the cause, and the
same bench without the mistake is `ok`. Frames are few and have time, so that a busy machine does not make them late.
"""

import math
import re
import signal
import socket
import struct
import threading
import time
import unittest

from support import BINARY, CAMERA, ROOT, InAFolder, Running, free_port, starloop
from starloop.client import Starloop

CAMERA_TEXT = CAMERA.read_text()
DURATION_S = 6.0
DEGREES = 180.0 / math.pi
RATE_RAD_S = 0.01
PATIENCE_S = 60.0
#: A word that is allowed for a repaired bench on a machine that is too busy for it.
BUSY = "LATE"

BENCH = """
name = "bench"
camera = "camera.toml"
[timing]
frame_rate_hz = 2.0
duration_s = {duration}
start_utc = "2026-03-01T00:00:00Z"
[sink]
kind = "null"
"""

OUTSIDE = BENCH + """
[link]
kind = "{kind}"
listen = {port}
encoding = "f64_le"
layout = ["t", "q_w", "q_x", "q_y", "q_z", "w_x", "w_y", "w_z"]
quaternion = "starloop"
rate_unit = "rad_s"
time_unit = "s"
time = "arrival"
[flight_computer]
kind = "external"
attitude_hz = 50.0
[expect]
blank_frames_at_start_at_most = 4
"""

#: Keys of the camera in another unit: the wrong value, and a word that the first line has.
UNITS = {
    "pixel_pitch_um": (0.0053, "mm"),
    "focal_length_mm": (0.025, "m"),
    "aperture_mm": (0.018, "m"),
    "exposure_s": (100.0, "ms"),
    "quantum_efficiency": (55.0, "percent"),
    "limiting_mag": (-6.0, "sign"),
}

ELEMENTS = """\
1 25544U 98067A   {epoch}  .00002182  00000-0  45000-4 0  999
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391    1
"""


def with_checksums(elements):
    """Elements with their last digits."""
    lines = []
    for line in elements.splitlines():
        line = line.ljust(68)[:68]
        total = sum(int(c) if c.isdigit() else c == "-" for c in line)
        lines.append(line + str(total % 10))
    return "\n".join(lines) + "\n"


def orbit(scale):
    """A table of a circular orbit; `scale` is 1 for km."""
    rows = ["utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"]
    radius, rate = 7000.0, math.sqrt(398600.4418 / 7000.0 ** 3)
    for second in range(-60, 80, 10):
        angle = rate * second
        place = [radius * math.cos(angle), radius * math.sin(angle), 0.0]
        speed = [-radius * rate * math.sin(angle), radius * rate * math.cos(angle), 0.0]
        stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(1772323200 + second))
        rows.append(",".join([stamp, *(f"{scale * x:.9f}" for x in place), *(f"{scale * v:.9f}" for v in speed)]))
    return "\n".join(rows) + "\n"


def record(age_s, rate_factor=1.0):
    """One attitude of a slow turn about x, with its rate."""
    half = 0.5 * RATE_RAD_S * age_s
    return struct.pack("<8d", 0.0, math.cos(half), -math.sin(half), 0.0, 0.0, RATE_RAD_S * rate_factor, 0.0, 0.0)


class Sender(threading.Thread):
    """Sends 50 attitudes a second until it is stopped; silent in `pause`, from and to seconds after its start."""

    def __init__(self, send, pause=(math.inf, math.inf), rate_factor=1.0):
        super().__init__(daemon=True)
        self.send, self.pause, self.rate_factor, self.over = send, pause, rate_factor, threading.Event()

    def run(self):
        begun = time.monotonic()
        while not self.over.wait(0.02):
            age_s = time.monotonic() - begun
            if not self.pause[0] <= age_s < self.pause[1]:
                try:
                    self.send(record(age_s, self.rate_factor))
                except OSError:
                    return


class BrokenBenches(InAFolder):
    def setUp(self):
        super().setUp()
        self.written("camera.toml", CAMERA_TEXT)

    def judge(self, first_line, status, *words):
        """A broken bench: its first line names the cause."""
        self.assertNotEqual(status, 0, first_line)
        self.assertFalse(first_line.startswith("ok"), first_line)
        for word in words:
            self.assertIn(word, first_line)

    def is_ok(self, first_line, status):
        """A repaired bench."""
        if first_line.startswith(BUSY):
            print(f"UNJUDGED: {first_line}")
            return
        self.assertEqual(status, 0, first_line)
        self.assertTrue(first_line.startswith("ok: "), first_line)

    def flown(self, text, *options):
        """First line and status on the virtual clock."""
        done = starloop("run", self.written("bench.toml", text), "--clock", "virtual", *options, timeout=PATIENCE_S)
        errors = [line for line in done.stderr.splitlines() if line.startswith("starloop: ") or done.returncode == 0]
        return (done.stdout.splitlines() or errors or [done.stderr])[0], done.returncode

    def outside(self, kind="udp", act=lambda program, port: None, send=True, **sender):
        """First line and status of a bench on the real clock, to which somebody sends."""
        socket_kind = socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM
        port = free_port(socket_kind)
        path = self.written("bench.toml", OUTSIDE.format(kind=kind, port=port, duration=DURATION_S))
        with Running(BINARY, "run", path) as program, socket.socket(socket.AF_INET, socket_kind) as connection:
            program.wait_for(f"^link: {kind} at")
            connection.connect(("127.0.0.1", port))
            thread = Sender(connection.sendall, **sender) if send else None
            if thread:
                thread.start()
            act(program.process, connection)
            text = program.ended(PATIENCE_S)
            if thread:
                thread.over.set()
        return (text.splitlines() or program.said)[0], program.process.returncode

    def test_whole_benches_are_ok(self):
        self.is_ok(*self.flown(BENCH.format(duration=DURATION_S)))
        self.is_ok(*self.outside())
        self.is_ok(*self.outside("tcp"))

    def test_no_attitude(self):
        self.judge(*self.outside(send=False), "INCOMPLETE: 0 of 12 frames", "no attitude arrived", "encoding")

    def test_flight_computer_that_is_dead_for_three_seconds(self):
        self.judge(*self.outside(pause=(2.0, 5.0)), "INCOMPLETE", "attitude")

    def test_pulled_cable(self):
        def pull(_program, connection):
            time.sleep(2.5)
            connection.shutdown(socket.SHUT_RDWR)
        self.judge(*self.outside("tcp", act=pull), "INCOMPLETE", "link tcp", "lost")

    def test_rates_in_degrees(self):
        self.judge(*self.outside(rate_factor=DEGREES), "INCOMPLETE", "rates")

    def test_program_that_is_stopped_for_two_seconds(self):
        def stop(program, _connection):
            time.sleep(2.0)
            program.send_signal(signal.SIGSTOP)
            time.sleep(2.0)
            program.send_signal(signal.SIGCONT)
        first_line, status = self.outside(act=stop)
        self.judge(first_line, status)
        self.assertRegex(first_line, r"dropped|late")

    def test_wrong_units(self):
        for key, (value, unit) in UNITS.items():
            with self.subTest(key=key):
                broken, count = re.subn(rf"(?m)^({key}\s*=).*$", rf"\1 {value}", CAMERA_TEXT)
                self.assertEqual(count, 1, f"the camera has no {key}")
                (self.folder / "camera.toml").write_text(broken)
                self.judge(*self.flown(BENCH.format(duration=2.0)), key)

    def test_orbit_in_metres(self):
        text = BENCH.format(duration=2.0) + '[observer]\nkind = "file"\nfile = "orbit.csv"\n'
        (self.folder / "orbit.csv").write_text(orbit(1000.0))
        self.judge(*self.flown(text), "orbit.csv")
        (self.folder / "orbit.csv").write_text(orbit(1.0))
        self.is_ok(*self.flown(text))

    def test_old_elements(self):
        text = BENCH.format(duration=2.0) + '[observer]\nkind = "file"\nfile = "station.tle"\n'
        (self.folder / "station.tle").write_text(with_checksums(ELEMENTS.format(epoch="10060.50000000")))
        self.judge(*self.flown(text), "elements")
        (self.folder / "station.tle").write_text(with_checksums(ELEMENTS.format(epoch="26059.50000000")))
        self.is_ok(*self.flown(text))

    def test_camera_that_is_slowed_down(self):
        lockstep = str(ROOT / "configs/benches/closed_loop_small.toml")
        for rate_hz in [0.01, None]:
            with Starloop.start(BINARY, lockstep, settings={"timing.duration_s": 30.0}) as loop:
                loop.step(until_s=2.0)
                if rate_hz:
                    loop.camera(frame_rate_hz=rate_hz)
                loop.step(until_s=30.0)
                report = loop.finish()
            first_line = f"{report['verdict']}: {'; '.join(reason['text'] for reason in report['reasons'])}"
            if rate_hz:
                self.judge(first_line, report.get("exit_status", 1), "INCOMPLETE", "a client set the frame rate to 0.01 Hz")
            else:
                self.is_ok(first_line, 0)


if __name__ == "__main__":
    unittest.main()
