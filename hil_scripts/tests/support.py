"""Shared by the tests: paths, the program, folders, benches. Import it before anything of hil_scripts/starloop and measure.

STARLOOP_BINARY names the program (default target/release/starloop). The small bench that several tests run shows the north of
Orion with a small tracker at 10 Hz; sinks are added behind it.
"""

import csv
import json
import math
import os
import socket
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "hil_scripts"
sys.path[1:1] = [str(SCRIPTS), str(SCRIPTS / "measure")]

from running import PATIENCE_S, Running, until  # noqa: E402, F401 - found by the line above

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
PROGRAM = Path(os.environ.get("STARLOOP_BINARY", TARGET / "release/starloop")).resolve()
BINARY = str(PROGRAM)
CAMERA = ROOT / "configs/cameras/small_tracker.toml"
SYSTEM_PYTHON = "/usr/bin/python3"
"""The Python that has gi: the system's, not that of a virtual environment."""
ARCSEC = math.pi / 180.0 / 3600.0
BENCH = """
name = "{name}"
camera = "{camera}"
[timing]
frame_rate_hz = 10.0
deadline_policy = "late"
start_utc = "2026-03-01T00:00:00Z"
[flight_computer]
ra_deg = 82.05
dec_deg = -1.2
"""


def bench_text(name, camera=CAMERA):
    """The bench without a sink."""
    return BENCH.format(name=name, camera=camera)


# --- folders and tables -----------------------------------------------------------------------------------------------


def folder_for(case):
    """Returns an empty folder that goes with a test, or with a class of tests."""
    kept = tempfile.TemporaryDirectory(prefix="starloop_")
    (case.addClassCleanup if isinstance(case, type) else case.addCleanup)(kept.cleanup)
    return Path(kept.name)


class InAFolder(unittest.TestCase):
    """Each test has an empty folder, and the name of one in it for a run."""

    def setUp(self):
        self.folder = folder_for(self)
        self.out = self.folder / "run"

    def written(self, name, text):
        """Writes a file in the folder; returns its path."""
        path = self.folder / name
        path.write_text(text)
        return path


def rows_of(path):
    """Returns the rows of a table without its comments; of a folder, those of its frames."""
    path = Path(path, "frames.csv") if Path(path).is_dir() else Path(path)
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


def summary_of(folder):
    """Returns the report that a run leaves in its folder."""
    return json.loads(Path(folder, "summary.json").read_text())


def product(a, b):
    """Returns the Hamilton product of two quaternions w, x, y, z."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw)  # fmt: skip


def about_y(angle_rad):
    """Returns the attitude of a body that has turned about its y axis: passive, w x y z."""
    return [math.cos(0.5 * angle_rad), 0.0, -math.sin(0.5 * angle_rad), 0.0]


# --- the program ------------------------------------------------------------------------------------------------------


def ran(*words, status=None, **options):
    """Runs a program to its end. Where statuses are given, one or more, another is an error with what was said."""
    done = subprocess.run([str(word) for word in words], **{"capture_output": True, "text": True, "timeout": 600.0, **options})
    if status is not None and done.returncode not in (status if isinstance(status, tuple) else (status,)):
        raise AssertionError(f"{words}: status {done.returncode}\n{done.stdout}{done.stderr}")
    return done


def starloop(*words, **options):
    return ran(BINARY, *words, **options)


def output(*words, **options):
    return ran(*words, status=0, **options).stdout


def free_port(kind=socket.SOCK_STREAM):
    """Returns a port that was free."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


ADDRESSES = (f"127.{2 + os.getpid() // 250 % 250}.{1 + os.getpid() % 250}.{last}" for last in range(1, 250))
"""Addresses of this run: several runs on one machine do not meet."""
