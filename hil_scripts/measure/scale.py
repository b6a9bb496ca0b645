#!/usr/bin/env python3
"""What a frame costs against stars, pixels, path, heads and exposure: python3 hil_scripts/measure/scale.py [--part NAME] [--guide]

Each part is measured by `starloop render --timing` (medians of repeated drawings in one process) or by a short run on the real
clock, takes less than a minute, and is kept in target/scale/scale.json; --part measures one of them, so that a machine can be kept
quiet for one at a time. Exponents are slopes in log-log scale with their standard errors, on both sides of the place where two
lines fit best. --guide writes all kept parts into src/guide/scale.md. --tiny draws a few small scenes, for a test.
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess
import tempfile
import time

import numpy as np

from page import PROGRAM, ROOT, machine, put_between
from running import until
from scale_report import STAGES, guide_text
from starloop.client import Starloop, toml_value

PAGE = ROOT / "src/guide/scale.md"
MARKS = ("<!-- tables of scale.py -->", "<!-- end of the tables -->")
CAMERA = """
name = "scale"
[detector]
width_px = {size}
height_px = {size}
bits = 12
read_noise_e_rms = 10.0
[optics]
focal_length_mm = {focal_mm}
aperture_mm = 30.0
[psf]
model = "gaussian"
sigma_px = 0.8
[radiometry]
limiting_mag = 8.5
[exposure]
exposure_s = {exposure_s}
readout_s = 0.02
"""


def run(words):
    """Runs the program; returns its output, seconds and the largest memory that it took, bytes."""
    begun = time.monotonic()
    process = subprocess.Popen([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said, complaint = process.stdout.read(), process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{words}: exit {process.returncode}\n{complaint}")
    return said, time.monotonic() - begun, used.ru_maxrss * 1024


class Renderer:
    """`starloop render --timing` in a folder."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)

    def scene(self, stars, size, rows=1, exposure_s=0.1):
        """Draws random places and a random path of so many rows; returns milliseconds per stage, seconds and memory."""
        dice = np.random.default_rng([stars, size, rows])
        places = np.column_stack([dice.uniform(-0.5, size - 0.5, (stars, 2)), 1e4 * 10.0 ** (-3.0 * dice.uniform(0.0, 1.0, stars))])
        np.savetxt(self.folder / "stars.csv", places, "%.9g", ",", header="x_px,y_px,electrons", comments="")
        words = ["--ra", 0, "--dec", 0, "--sources", self.folder / "stars.csv"]
        if rows > 1:
            path = np.column_stack([dice.normal(0.0, 1.0, (rows, 2)).clip(-3.0, 3.0), np.zeros(rows)])
            np.savetxt(self.folder / "path.csv", path, "%.9g", ",", header="dx_px,dy_px,roll_arcsec", comments="")
            words += ["--los-samples", self.folder / "path.csv"]
        return self.draw(size, exposure_s, words)

    def draw(self, size, exposure_s, words):
        camera = self.folder / "camera.toml"
        camera.write_text(CAMERA.format(size=size, exposure_s=exposure_s, focal_mm=0.01 * size / 2 / np.tan(np.radians(10.0))))
        said, seconds, memory = run([PROGRAM, "render", "--camera", camera, *words, "--backend", "cpu", "--timing", "--out", self.folder / "image.fits"])
        found = json.loads(said.splitlines()[0])
        found.update({"process_s": seconds, "memory_bytes": memory})
        return found


def by_stars(renderer, tiny):
    counts = (100, 1000, 3000) if tiny else (100, 300, 1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    return [(count, renderer.scene(count, 256 if tiny else 2048)) for count in counts]


def by_pixels(renderer, tiny):
    sides = (64, 128, 256) if tiny else (512, 724, 1024, 1448, 2048, 2896, 4096)
    return [(side * side, renderer.scene(200 if tiny else 2000, side)) for side in sides]


def by_path(renderer, tiny):
    counts = (1, 11, 101) if tiny else (1, 3, 11, 31, 101, 301, 1001, 3001, 10_001, 20_001)
    return [(count, renderer.scene(50 if tiny else 500, 256 if tiny else 1024, count)) for count in counts]


def by_exposure(renderer, tiny):
    """The stars of the built-in catalog in Orion, at 1 degree per second: 51 px/s at 1024 px."""
    times_s = (0.01, 0.1) if tiny else (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    words = ["--ra", 83.8, "--dec", -1.2, "--rate", "0,1,0"]
    return [(time_s, renderer.draw(256 if tiny else 1024, time_s, words)) for time_s in times_s]


def by_heads(renderer, tiny):
    """Heads of one run on the real clock: medians of each stage over all frames, times the number of heads."""
    del renderer
    rows = []
    for heads in (1, 2) if tiny else (1, 2, 3):
        turned = [[0.92387953, 0.0, 0.38268343, 0.0], [0.92387953, 0.38268343, 0.0, 0.0]]
        settings = {"extra_head": [{"sensor_from_body": turn} for turn in turned[: heads - 1]], "timing.frame_rate_hz": 5.0,
                    "timing.duration_s": 2.0 if tiny else 12.0, "camera.radiometry.limiting_mag": 8.5, "render.backend": "cpu"}  # fmt: skip
        words = [PROGRAM, "run", ROOT / "configs/benches/loopback.toml", "--sink", "null", "--json"]
        for key, value in settings.items():
            words += ["--set", f"{key}={toml_value(value)}"]
        report = json.loads(run(words)[0])
        found = {f"{stage}_ms": heads * report["stages"][stage]["p50_ms"] for stage in STAGES}
        rows.append((heads, {**found, "total_ms": sum(found.values()), "method": "", "stars": report["stars"]["median"]}))
    return rows


def largest(renderer, tiny):
    """A sensor of 4096 x 4096 with a million stars, still and along a path."""
    stars, size = (2000, 512) if tiny else (1_000_000, 4096)
    return [(rows, renderer.scene(stars, size, rows)) for rows in (1, 101)]


def windows(renderer, tiny):
    """A run on the real clock at 500 Hz that reads out windows: 0.5 ms of exposure, 1.4 ms for the readout of their 16 rows."""
    del renderer
    seconds, rate_hz = (2.0, 500.0) if tiny else (20.0, 500.0)
    regions = [[100 + 200 * k, 500, 24, 16] for k in range(5)]
    settings = {"timing.duration_s": seconds, "timing.frame_rate_hz": 10.0, "camera.exposure.exposure_s": 0.0005,
                "camera.exposure.readout_s": 0.088, "render.backend": "cpu", "budget.ring_frames": 20_000,
                "flight_computer.slew.start_s": 0.5, "flight_computer.slew.duration_s": seconds + 30.0}  # fmt: skip
    bench = ROOT / "configs/benches/loopback.toml"
    with Starloop.start(PROGRAM, bench, clock="real", settings=settings, arguments=["--sink", "null"]) as loop:
        loop.camera(regions=regions, frame_rate_hz=rate_hz)
        until("its end", lambda: loop.state()["finished"], seconds + 30.0, every_s=0.2)
        report = loop.finish()
    return [(rate_hz, {"frames": report["frames"], "stages": report["stages"], "events": report["event_counts"], "windows": len(regions),
                       "pixels": sum(width * height for _, _, width, height in regions), "seconds": seconds})]  # fmt: skip


PARTS = {"stars": by_stars, "pixels": by_pixels, "path": by_path, "heads": by_heads, "exposure": by_exposure,
         "largest": largest, "windows": windows}  # fmt: skip


def measure(name, tiny):
    """Returns a part with the machine's load before it."""
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        rows = PARTS[name](Renderer(folder), tiny)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"rows": rows, "load_before": load, "cpu_s": used.ru_utime + used.ru_stime, "machine": machine(),
            "measured_utc": time.strftime("%Y-%m-%d %H:%M", time.gmtime())}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=PARTS, action="append", default=[], help="measure this part only; may be repeated")
    parser.add_argument("--guide", action="store_true", help="write the kept parts into the guide")
    parser.add_argument("--kept", action="store_true", help="measure nothing")
    parser.add_argument("--tiny", action="store_true", help="small scenes, a few seconds")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "target/scale")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    kept = chosen.out / "scale.json"
    parts = json.loads(kept.read_text()) if kept.exists() else {}
    for name in [] if chosen.kept else chosen.part or PARTS:
        parts[name] = measure(name, chosen.tiny)
        kept.write_text(json.dumps(parts))
        print(f"{name}: {len(parts[name]['rows'])} points, load before {parts[name]['load_before']:.1f}", flush=True)
    text = guide_text(parts)
    (chosen.out / "scale.md").write_text(text)
    print(text)
    if chosen.guide:
        put_between(PAGE, MARKS, text)


if __name__ == "__main__":
    main()
