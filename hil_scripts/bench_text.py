"""The small bench that several tests run, and how they wait for something: from bench_text import bench_text, until

The bench shows the north of Orion with a small tracker at 10 Hz; sinks are added behind it.
"""

import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CAMERA = ROOT / "configs/cameras/small_tracker.toml"
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
