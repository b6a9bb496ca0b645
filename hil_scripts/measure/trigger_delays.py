#!/usr/bin/env python3
"""From a command to the start of the exposure, on the real clock: a table by where the trigger comes from.

  hil_scripts/measure/trigger_delays.py                       triggers by a line, the control socket, the bus and a network camera's client
  hil_scripts/measure/trigger_delays.py --triggers 200 --without-aravis

`starloop run` draws a slew of 1 deg/s with a trigger line, a gateway, the control socket and a network camera. Each trigger is
dated by this program just before it is sent; when its exposure started is what the frame says. The bench clock is CLOCK_REALTIME
less a constant, which is found from the line: its stamps are this program's own. Each frame's attitude is compared with the turn
at the middle of its exposure.

The line is a named pipe into which this program writes events of the kernel's form (struct gpio_v2_line_event).
STARLOOP_BINARY names the program (default target/release/starloop).
"""

import argparse
import csv
import json
import math
import os
import platform
import re
import struct
import subprocess
import tempfile
import time
from pathlib import Path

from page import PROGRAM, ROOT, SYSTEM_PYTHON, fits_of
from page import table as table_of
from running import PATIENCE_S, Running, until
from starloop.client import Starloop
from starloop.wire import CanTransport

ARCSEC = math.pi / 180.0 / 3600.0
RATE_DEG_S = 1.0
EXPOSURE_S = 0.02
#: From one trigger to the next at least: exposure and readout, and time to draw.
PAUSE_S = 0.1
LINE = 3

BENCH = """name = "triggers"
camera = "{root}/configs/cameras/small_tracker.toml"
seed = 1
[timing]
frame_rate_hz = 10.0
duration_s = {duration_s}
[link]
kind = "simulated"
wire = "can_fd"
slcan_tcp = 0
[flight_computer]
kind = "simulated"
attitude_hz = 100.0
ra_deg = 84.05
dec_deg = -1.2
[flight_computer.motion]
kind = "constant_rate"
rate_deg_s = [0.0, {rate_deg_s}, 0.0]
[[trigger_line]]
chip = "{chip}"
line = {line}
{more}
[sink]
kind = "recorder"
{sinks}
"""


class Line:
    """A trigger line that this program drives: events of the kernel's form (struct gpio_v2_line_event) in a named pipe."""

    def __init__(self, path, offset=LINE):
        self.path, self.offset, self.seqno = path, offset, 0
        os.mkfifo(path, 0o600)
        self.pipe = os.open(path, os.O_RDWR)

    def edge(self, is_rising, lost=0, at_ns=None):
        """Sends an edge now, after so many lost ones; its stamp is CLOCK_REALTIME in ns."""
        self.seqno += 1 + lost
        at_ns = time.clock_gettime_ns(time.CLOCK_REALTIME) if at_ns is None else at_ns
        event = struct.pack("=Q10I", at_ns, 1 if is_rising else 2, self.offset, self.seqno, self.seqno, *[0] * 6)
        os.write(self.pipe, event)
        return at_ns

    def pulse(self, width_s=0.001):
        """Stamps of its edges."""
        rise = self.edge(True)
        time.sleep(width_s)
        return rise, self.edge(False)

    def close(self):
        os.close(self.pipe)


class Bench(Running):
    """A run with a trigger line and the control socket, until the end of a `with` block; its frames are then in `rows`."""

    def __init__(self, duration_s=600.0, more="", sinks="", chip=None):
        self.folder = tempfile.TemporaryDirectory()
        folder = Path(self.folder.name)
        self.line = Line(folder / "line")
        text = BENCH.format(root=ROOT, duration_s=duration_s, rate_deg_s=RATE_DEG_S, chip=chip or self.line.path, line=LINE,
                            more=more, sinks=sinks)
        (folder / "bench.toml").write_text(text)
        self.out = folder / "run"
        super().__init__(PROGRAM, "run", folder / "bench.toml", "--clock", "real", "--out", self.out, "--backend", "cpu",
                         "--control", "127.0.0.1:0")
        token = self.wait_for("control: token ([0-9a-f]+)")[1]
        self.loop = Starloop.connect(*self.address("control: listening on "), token=token)

    def address(self, words):
        """Host and port that the program prints behind some words."""
        host, port = self.wait_for(re.escape(words) + r"(\S+)")[1].rsplit(":", 1)
        return host, int(port)

    def wait_for_attitudes(self):
        """Until frames can show stars."""
        until("attitudes", lambda: self.loop.state()["now_s"] >= 0.5, every_s=0.05)

    def wait_for_frames(self, count):
        """Until so many are drawn: a frame counts as delivered when its buffer comes back for the next one."""
        drawn = lambda: self.loop.state()["frames"]["rendered"]
        until(lambda: f"{count} frames, got {drawn()}", lambda: drawn() >= count, every_s=0.02)

    def finish(self):
        """The report of the run."""
        report = self.loop.finish()
        self.ended()
        return report

    def rows(self):
        with open(self.out / "frames.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        for row in rows:
            row["started_by"] = fits_of(self.out / f"frame_{int(row['frame']):06d}.fits")[0]["STARTBY"]
        return rows

    def __exit__(self, *_):
        self.loop.close()
        self.process.terminate()
        try:
            self.ended()
        finally:
            super().__exit__()
            self.line.close()
            self.folder.cleanup()


def start_ns(row):
    """Start of a frame's exposure, bench clock."""
    return int(row["mid_exposure_tai_ns"]) - round(float(row["exposure_s"]) * 5e8)


# --- triggers: instants before and after the call, CLOCK_REALTIME in ns ----------------------------------------------------


def dated(call):
    before = time.clock_gettime_ns(time.CLOCK_REALTIME)
    call()
    return before, time.clock_gettime_ns(time.CLOCK_REALTIME)


def by_line(bench, count):
    shots = []
    for _ in range(count):
        stamp, _ = bench.line.pulse()
        shots.append((stamp, stamp))
        time.sleep(PAUSE_S)
    return shots


def by_control(bench, count):
    shots = []
    for _ in range(count):
        shots.append(dated(bench.loop.camera_trigger))
        time.sleep(PAUSE_S)
    return shots


class FlightComputer:
    """A second sender beside the simulated flight computer: it commands the camera."""

    def __init__(self, host, port):
        self.transport = CanTransport("slcan", f"socket://{host}:{port}", True)
        self.token = 100

    def ask(self, opcode, **fields):
        """The instants before the command was sent, and after it was answered."""
        self.token += 1
        while self.transport.receive(0.0):
            pass
        before = time.clock_gettime_ns(time.CLOCK_REALTIME)
        self.transport.send("CMD", {"Opcode": opcode, "Token": self.token, **fields})
        until = time.monotonic() + 5.0
        while time.monotonic() < until:
            received = self.transport.receive(0.2)
            if received and received[0] == "RSP" and received[1]["Token"] == self.token:
                after = time.clock_gettime_ns(time.CLOCK_REALTIME)
                assert received[1]["Code"] == 0, self.transport.codec.refusal(received[1]["Code"])
                return before, after
        raise TimeoutError(f"no answer to opcode {opcode}")


def by_bus(bench, count):
    computer = FlightComputer(*bench.address("gateway: slcan (TCP) at "))
    shots = []
    for _ in range(count):
        shots.append(computer.ask(8, CameraTriggerHead=0, CameraTriggerTime=0))
        time.sleep(PAUSE_S)
    computer.transport.close()
    return shots


def by_network_camera(bench, count):
    """Aravis, in the system's Python: `test_camera_genicam.py` has the client."""
    host, _ = bench.address("network camera: GVCP at ")
    request = json.dumps({"address": host, "what": "trigger", "triggers": count, "delay_us": 0.0})
    script = str(ROOT / "hil_scripts/tests/test_camera_genicam.py")
    done = subprocess.run([SYSTEM_PYTHON, script, "--client", request], capture_output=True, text=True, timeout=10 * PATIENCE_S)
    assert done.returncode == 0, done.stderr + "".join(bench.said)[-2000:]
    shots = json.loads(done.stdout.splitlines()[-1])[:-1]
    return [(shot["before"], shot["after"]) for shot in shots]


#: Source as the frames name it, what it is, and how it is made.
SOURCES = [
    ("line", "line (named pipe)", by_line),
    ("control", "control socket", by_control),
    ("bus", "bus, slcan gateway", by_bus),
    ("software", "network camera, software trigger", by_network_camera),
]


def measure(count, with_aravis=True):
    """By source: shots and the frames that they started; and the distance of the clocks, ns."""
    address = f"127.{2 + os.getpid() // 250 % 250}.{1 + os.getpid() % 250}.77"
    sinks = f'[[extra_sink]]\nkind = "network_camera"\naddress = "{address}"' if with_aravis else ""
    shots = {}
    with Bench(sinks=sinks) as bench:
        bench.loop.camera(exposure_us=EXPOSURE_S * 1e6)
        bench.wait_for_attitudes()
        for name, _, trigger in SOURCES:
            if name != "software" or with_aravis:
                shots[name] = trigger(bench, count)
        bench.wait_for_frames(sum(len(of_source) for of_source in shots.values()))
        report = bench.finish()
        rows = bench.rows()
    frames = {name: [row for row in rows if row["started_by"] == name] for name in shots}
    # The line's stamps are this program's own: the clocks' distance is what its exposures say.
    offsets = sorted(start_ns(row) - stamp for row, (stamp, _) in zip(frames["line"], shots["line"]))
    return shots, frames, offsets[len(offsets) // 2], report


def attitude_errors_arcsec(rows):
    """How far each frame's attitude is from the turn since the first one, by the middles of their exposures."""
    wxyz = lambda row: [float(row[key]) for key in ("qw", "qx", "qy", "qz")]
    first, errors = rows[0], []
    for row in rows[1:]:
        dot = abs(sum(a * b for a, b in zip(wxyz(first), wxyz(row))))
        cross = math.sqrt(max(0.0, 1.0 - dot * dot))
        turned = 2.0 * math.atan2(cross, dot) / ARCSEC
        elapsed_s = (int(row["mid_exposure_tai_ns"]) - int(first["mid_exposure_tai_ns"])) * 1e-9
        errors.append(abs(turned - RATE_DEG_S * 3600.0 * elapsed_s))
    return errors


def quantile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, math.ceil(share * len(values)) - 1)]


def delays_us(shots, rows, offset_ns):
    return [(start_ns(row) - offset_ns - before) * 1e-3 for row, (before, _) in zip(rows, shots)]


def table(shots, frames, offset_ns):
    lines = []
    for name, words, _ in SOURCES:
        if name in shots:
            delays = delays_us(shots[name], frames[name], offset_ns)
            if name == "line":
                delays = [abs(delay) for delay in delays]
            figures = (quantile(delays, 0.5), quantile(delays, 0.99), max(delays))
            lines.append([words, str(len(delays)), *(f"{figure:.1f}" for figure in figures)])
    return "\n".join(table_of(["trigger", "exposures", "p50, us", "p99, us", "largest, us"], lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--triggers", type=int, default=100, help="triggers of each source (default 100)")
    parser.add_argument("--without-aravis", action="store_true", help="leave out the network camera's client")
    given = parser.parse_args()
    shots, frames, offset_ns, report = measure(given.triggers, not given.without_aravis)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Linux {platform.release()}; command sent to start of exposure\n")
    print(table(shots, frames, offset_ns))
    errors = attitude_errors_arcsec(sorted(sum(frames.values(), []), key=start_ns))
    print(f"\nattitude at mid-exposure of a turn of {RATE_DEG_S} deg/s: largest error {max(errors):.2f} arcsec")
    print(f"stage trigger of the report: {json.dumps(report['stages'].get('trigger'))}")


if __name__ == "__main__":
    main()
