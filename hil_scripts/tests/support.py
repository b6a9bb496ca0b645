"""What the tests share: paths, the program, benches, waiting. Import it before anything of hil_scripts/starloop and measure.

STARLOOP_BINARY names the program (default target/release/starloop). The small bench that several tests run shows the north of
Orion with a small tracker at 10 Hz; sinks are added behind it.
"""

import math
import os
import sys
import time
from pathlib import Path

sys.dont_write_bytecode = True

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "hil_scripts"
sys.path[1:1] = [str(SCRIPTS), str(SCRIPTS / "measure")]
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
PROGRAM = Path(os.environ.get("STARLOOP_BINARY", TARGET / "release/starloop")).resolve()
BINARY = str(PROGRAM)
CAMERA = ROOT / "configs/cameras/small_tracker.toml"
SYSTEM_PYTHON = "/usr/bin/python3"
"""The Python that has gi: the system's, not that of a virtual environment."""
ARCSEC = math.pi / 180.0 / 3600.0
PATIENCE_S = 120.0
"""Nothing takes so long; a test that waits longer fails."""
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


def until(what, is_so, patience_s=PATIENCE_S):
    """Asks until the answer is true; returns the answer."""
    end = time.monotonic() + patience_s
    while not (answer := is_so()):
        if time.monotonic() > end:
            raise AssertionError(f"not within {patience_s} s: {what}")
        time.sleep(0.01)
    return answer
