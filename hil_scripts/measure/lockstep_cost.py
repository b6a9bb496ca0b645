"""Measures the cost of lockstep: the same frames with a plant inside and with a plant outside, side by side.

    python3 hil_scripts/measure/lockstep_cost.py --binary target/release/starloop

Both runs draw the same frames of 1024 x 1024 pixels with about 2,000 stars of a slow turn on the virtual clock. Inside: `plant.kind
= "file"`, no socket. Outside: the same attitudes over the control socket, in batches of a second, and a step for each frame, after
which its facts are asked for. The runs alternate; the table has the fastest and the median of each, by the clock and in processor
time (of the program and its client), which says more on a busy machine. Nothing is asserted.
"""

import argparse
import math
import os
import resource
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

from page import PROGRAM, ROOT
from starloop.client import Starloop, attitude_sample

RATE_RAD_S = 0.002
SAMPLE_S = 0.01

BENCH = """camera = "{camera}"
{plant}
[timing]
frame_rate_hz = 10.0
duration_s = {duration}
[render]
backend = "cpu"
"""


def turned(t_s):
    """Attitude of a body that turns about y from a crowded field on."""
    half = 0.5 * (1.0 + RATE_RAD_S * t_s)
    return [math.cos(half), 0.0, -math.sin(half), 0.0]


def instants(duration_s):
    return [round(-0.2 + SAMPLE_S * k, 9) for k in range(round((duration_s + 0.4) / SAMPLE_S))]


def camera_text(limiting_mag):
    """The tracker of 1024 x 1024 pixels with a field of 40 degrees, and stars down to another magnitude."""
    text = (ROOT / "configs/cameras/star_tracker_20deg.toml").read_text()
    changed = {"limiting_mag": limiting_mag, "focal_length_mm": 25.32}
    lines = [next((f"{key} = {value}" for key, value in changed.items() if line.startswith(key)), line) for line in text.splitlines()]
    return "\n".join(lines)


def processor_s():
    """Processor time so far, of this process and of programs that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def fly_inside(binary, bench):
    """Seconds of a run without a socket, by the clock and in processor time."""
    begin, used = time.perf_counter(), processor_s()
    subprocess.run([binary, "run", bench, "--clock", "virtual", "--quiet", "--sink", "null"], check=True, capture_output=True)
    return time.perf_counter() - begin, processor_s() - used


def fly_outside(binary, bench, duration_s):
    """Seconds of the same run in lockstep, by the clock and in processor time, and the stars of its last frame."""
    begin, used = time.perf_counter(), processor_s()
    rows = [attitude_sample(t_s, turned(t_s), (0.0, RATE_RAD_S, 0.0)) for t_s in instants(duration_s)]
    with Starloop.start(binary, bench, arguments=["--sink", "null"]) as loop:
        for frame in range(1, round(10 * duration_s) + 1):
            if frame % 10 == 1:
                count = sum(row[0] <= 0.1 * frame + 1.0 for row in rows)
                loop.attitude(rows[:count])
                del rows[:count]
            loop.step(until_s=round(0.1 * frame, 9))
            if frame > 2:
                stars = loop.frame_facts()["meta"]["stars"]
        loop.finish()
    return time.perf_counter() - begin, processor_s() - used, stars


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", default=PROGRAM)
    parser.add_argument("--duration", type=float, default=20.0, help="seconds of simulated time")
    parser.add_argument("--repeat", type=int, default=5, help="runs of each")
    parser.add_argument("--limiting-mag", type=float, default=8.0, help="faintest star")
    options = parser.parse_args()
    binary = str(Path(options.binary).resolve())
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "camera.toml").write_text(camera_text(options.limiting_mag))
        history = "\n".join(f"{t_s!r} " + " ".join(repr(part) for part in turned(t_s)) for t_s in instants(options.duration))
        (folder / "attitude.csv").write_text(history + "\n")
        plants = {"inside": 'plant = { kind = "file", attitude = "attitude.csv" }', "outside": 'plant = { kind = "outside" }'}
        for name, plant in plants.items():
            text = BENCH.format(camera="camera.toml", plant=plant, duration=options.duration)
            (folder / f"{name}.toml").write_text(text)
        took = {"inside": [], "outside": []}
        for _ in range(options.repeat):
            took["inside"].append(fly_inside(binary, str(folder / "inside.toml")))
            *seconds, stars = fly_outside(binary, str(folder / "outside.toml"), options.duration)
            took["outside"].append(seconds)
    print(f"{round(10 * options.duration)} frames of 1024 x 1024, {stars} stars in the last one, {os.cpu_count()} cores")
    columns = ["clock, fastest s", "clock, median s", "processor, fastest s", "processor, median s"]
    print(f"{'plant':>20} " + " ".join(f"{column:>20}" for column in columns))
    rows = {name: [best(part) for part in zip(*runs) for best in (min, statistics.median)] for name, runs in took.items()}
    for name, label in (("inside", "inside, no socket"), ("outside", "outside, lockstep")):
        print(f"{label:>20} " + " ".join(f"{number:20.2f}" for number in rows[name]))
    costs = [100.0 * (outside / inside - 1.0) for inside, outside in zip(rows["inside"], rows["outside"])]
    print(f"{'lockstep costs':>20} " + " ".join(f"{cost:+18.1f} %" for cost in costs))


if __name__ == "__main__":
    main()
