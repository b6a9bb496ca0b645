"""Reports about star trackers: python3 hil_scripts/tests/test_tracker_report.py

The built-in tracker and cedar-solve, a tracker of other people, fly a short plan. Known errors that are added to a log
come back within their confidence intervals; a wrong sign and swapped axes are found. cedar-solve has an environment of
its own below target (STARLOOP_CEDAR_ENVIRONMENT names another one), made from PyPI when it is missing. Standard library
only.
"""

import csv
import functools
import hashlib
import json
import math
import os
import random
import re
import shutil
import struct
import subprocess
import sys
import unittest
import venv
import xml.etree.ElementTree
import zlib
from pathlib import Path

import support
from support import ARCSEC, ROOT, TARGET, InAFolder, folder_for, product, rows_of
from starloop.compare_reports import compare, count_p_value, show
from starloop.statistical_tracker import AXES, Pair, Report, noise_of_motion, with_absolute_paths

PLAN = ROOT / "configs/test_plans/ecss_star_tracker_short.toml"
CEDAR = ROOT / "hil_scripts/tests/cedar_tracker.py"
CEDAR_SOLVE = "cedar-solve==0.5.1"
ENVIRONMENT = Path(os.environ.get("STARLOOP_CEDAR_ENVIRONMENT", TARGET / "cedar_environment"))
QUATERNION_OF_FRAMES = ("qw", "qx", "qy", "qz")
MOST_BYTES = 2_000_000
CAMERAS = {
    "small_tracker": 0.9,
    "star_tracker_20deg": 0.9,
    "star_tracker_20deg_20hz": 0.9,
    "cubesat_tracker": 0.9,
    "chain_tracker": 0.9,
    "crowded_field_10deg": 0.9,
}
"""Shipped cameras whose field cedar-solve's database has (10 to 30 degrees), and the share of frames that it must solve."""
TOO_NARROW = ["wide_field_telescope", "detection_limit_15mag", "detection_limit_22mag", "imx265_35mm"]
"""Those that it has not: below 10 degrees."""


starloop = functools.partial(support.starloop, status=(0, 4), timeout=900)


def turned(quaternion, turn_rad):
    """The attitude of a frame that has turned by a small vector in its own axes."""
    small = (1.0, *(-0.5 * angle for angle in turn_rad))
    norm = math.sqrt(sum(part * part for part in small))
    return product(tuple(part / norm for part in small), quaternion)


def change_log(case, change):
    """Rewrites the log of a case: `change` takes the row's quaternion and the frame's row, and returns another one."""
    frames = {row["frame"]: row for row in rows_of(case / "frames.csv")}
    path = case / "tracker_log.csv"
    rows = rows_of(path)
    for row in rows:
        if row["q_w"]:
            before = tuple(float(row[name]) for name in ("q_w", "q_x", "q_y", "q_z"))
            after = change(before, row, frames[row["frame"]])
            row.update(zip(("q_w", "q_x", "q_y", "q_z"), (f"{part:.15f}" for part in after)))
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def cedar_python():
    """Returns the Python of the environment with cedar-solve, and makes it where there is none."""
    return python_with(ENVIRONMENT, CEDAR_SOLVE, "tetra3, numpy, scipy")


def python_with(environment, package, modules):
    """Returns the Python of an environment with a package of PyPI that has these modules, and makes it where there is none."""
    python = environment / "bin/python"
    check = [str(python), "-c", f"import {modules}"]
    if not python.exists() or subprocess.run(check, capture_output=True).returncode != 0:
        shutil.rmtree(environment, ignore_errors=True)
        venv.create(environment, with_pip=True)
        install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", package]
        subprocess.run(install, check=True, timeout=900)
    return python


class Flown:
    """A plan that has been flown, and its report."""

    def __init__(self, folder):
        self.folder = Path(folder)

    @property
    def report(self):
        return json.loads((self.folder / "report.json").read_text())

    def copy(self, name):
        other = self.folder.parent / name
        shutil.rmtree(other, ignore_errors=True)
        shutil.copytree(self.folder, other)
        return Flown(other)

    def cases(self):
        return [self.folder / name for name in json.loads((self.folder / "plan.json").read_text())["cases"]]

    def changed(self, name, change):
        """A copy whose logs have been changed, reported again."""
        other = self.copy(name)
        for case in other.cases():
            change_log(case, change)
        starloop("report", other.folder)
        return other

    def metric(self, identifier, case=None):
        found = [m for m in self.report["metrics"] if m["id"] == identifier and m["case"] == case]
        assert len(found) == 1, (identifier, case, [m["id"] for m in self.report["metrics"]])
        return found[0]


class Reports(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.flown = Flown(cls.folder / "built_in")
        cls.done = starloop("fly", PLAN, "--out", cls.flown.folder, "--quiet")

    def assert_holds(self, metric, truth, is_held=True):
        held = metric["low"] <= truth <= metric["high"]
        self.assertEqual(held, is_held, f"{metric['id']}: {truth} and {metric['low']} .. {metric['high']}")

    def assert_shifted(self, other, identifier, by):
        """A metric of a changed log is that of the log before, shifted, within its interval."""
        self.assert_holds(other.metric(identifier), self.flown.metric(identifier)["value"] + by)

    def test_the_built_in_tracker_meets_the_short_plan(self):
        self.assertEqual(self.done.returncode, 0, self.done.stdout)
        self.assertTrue(self.done.stdout.startswith("PASSED: built-in tracker"), self.done.stdout)
        report = self.flown.report
        self.assertEqual(report["schema"], "starloop.report/1")
        self.assertTrue(report["is_met"])
        wanted = """bias.x bias.directional bias.rotational fov_spatial_error.x pixel_spatial_error.x temporal_noise.x
            noise_equivalent_angle.x absolute_measurement_error.directional measurement_date_error aberration_residual drift.x
            mean_drift_error.x thermo_elastic_error.x thermo_elastic_error.directional output_bandwidth sun_exclusion_angle
            moon_exclusion_angle earth_exclusion_angle acquisition_probability acquisition_confidence acquisition_time.median tracking_probability
            false_solution_probability"""
        for identifier in wanted.split():
            self.assertTrue(math.isfinite(self.flown.metric(identifier)["value"]), identifier)
        for name in ("slew 1", "stray light 2000000", "protons 300", "warmer 40", "acceleration 0.5"):
            self.flown.metric("tracking_probability", name)
        flooded = self.flown.metric("recovery_time", "stray light 2000000")
        self.assertGreater(flooded["value"], 5.0, "no attitude in six seconds of light")

    def test_files_of_the_report(self):
        html = (self.flown.folder / "report.html").read_text()
        self.assertLess(len(html.encode()), MOST_BYTES)
        self.assertIn("PASSED", html.split("<h2>")[0])
        self.assertFalse(re.search(r"<(script|link|img|iframe)|src=|url\(", html), "it needs no other file")
        for inside in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
            xml.etree.ElementTree.fromstring(inside)
        self.assertGreaterEqual(html.count("<svg"), 10)
        suite = xml.etree.ElementTree.parse(self.flown.folder / "report.xml").getroot().find("testsuite")
        self.assertEqual(suite.get("tests"), "9")
        self.assertEqual(suite.get("failures"), "0")
        files = {row["path"]: row["sha256"] for row in self.flown.report["provenance"]["files"]}
        self.assertIn("lost_in_space/tracker_log.csv", files)
        log = (self.flown.folder / "lost_in_space/tracker_log.csv").read_bytes()
        self.assertEqual(files["lost_in_space/tracker_log.csv"], hashlib.sha256(log).hexdigest())

    def test_a_plan_repeats_bit_for_bit(self):
        other = self.folder / "again"
        starloop("fly", PLAN, "--out", other, "--quiet", "--case", "slew", "--case", "protons")
        names = json.loads((other / "plan.json").read_text())["cases"]
        self.assertEqual(len(names), 8)
        for name in names:
            for file in ("frames.csv", "tracker_log.csv"):
                self.assertEqual((other / name / file).read_bytes(), (self.flown.folder / name / file).read_bytes())
        self.assertNotEqual((other / names[0] / "frames.csv").read_bytes(), (other / names[1] / "frames.csv").read_bytes())

    def test_an_added_bias_comes_back(self):
        bias = (25.0, -40.0, 300.0)
        turn = tuple(angle * ARCSEC for angle in bias)
        other = self.flown.changed("biased", lambda q, row, frame: turned(q, turn))
        for identifier, by in zip(("bias.x", "bias.y", "bias.rotational"), bias):
            self.assert_shifted(other, identifier, by)
        # The controls: the other sign, and the axes swapped.
        self.assert_holds(other.metric("bias.x"), -25.0, is_held=False)
        self.assert_holds(other.metric("bias.x"), -40.0, is_held=False)
        self.assertFalse(other.report["is_met"], "a limit of 10 arcsec")

    def test_added_noise_comes_back(self):
        dice = random.Random(5)
        sigma = (30.0, 45.0, 400.0)
        noisy = self.flown.changed(
            "noisy", lambda q, row, frame: turned(q, [dice.gauss(0, s * ARCSEC) for s in sigma])
        )
        for axis, added in zip(("x", "y", "rotational"), sigma):
            before = self.flown.metric(f"temporal_noise.{axis}")["value"]
            self.assert_holds(noisy.metric(f"temporal_noise.{axis}"), math.hypot(before, added))
        self.assert_holds(noisy.metric("temporal_noise.x"), 45.0, is_held=False)

    def test_a_late_time_tag_comes_back(self):
        def late(q, row, frame):
            row["tai_ns"] = str(int(row["tai_ns"]) + 20_000_000)
            return q

        other = self.flown.changed("late", late)
        self.assert_shifted(other, "measurement_date_error", 20.0)
        self.assertAlmostEqual(other.metric("time_tag_error")["value"], 20.0, places=6)
        self.assert_holds(other.metric("measurement_date_error"), -20.0, is_held=False)

    def test_an_attitude_of_an_earlier_time_is_a_date_error_too(self):
        def lagging(q, row, frame):
            rate = [math.radians(float(frame[f"rate_{axis}_deg_s"])) for axis in "xyz"]
            return turned(q, [-0.02 * part for part in rate])

        other = self.flown.changed("lagging", lagging)
        self.assert_shifted(other, "measurement_date_error", 20.0)
        self.assertAlmostEqual(other.metric("time_tag_error")["value"], 0.0, places=6)

    def test_added_drift_comes_back(self):
        per_hour = (600.0, -300.0, 9000.0)
        case = self.flown.folder / "drift"
        zero = int(rows_of(case / "frames.csv")[0]["mid_exposure_tai_ns"])

        def drifting(q, row, frame):
            hours = (int(frame["mid_exposure_tai_ns"]) - zero) * 1e-9 / 3600
            return turned(q, [rate * hours * ARCSEC for rate in per_hour])

        other = self.flown.changed("drifting", drifting)
        for axis, rate in zip(("x", "y", "rotational"), per_hour):
            self.assert_shifted(other, f"drift.{axis}", rate)
        self.assert_holds(other.metric("drift.x"), -600.0, is_held=False)

    def test_a_wrong_sign_and_swapped_axes_fail(self):
        conjugate = self.flown.changed("conjugate", lambda q, row, frame: (q[0], -q[1], -q[2], -q[3]))
        swapped = self.flown.changed("swapped", lambda q, row, frame: (q[0], q[2], q[1], q[3]))
        for other in (conjugate, swapped):
            self.assertFalse(other.report["is_met"])
            self.assertGreater(other.metric("false_solutions")["value"], 1000)
            self.assertEqual(other.metric("acquisition_probability")["value"], 0.0)
        # Said in the log, the sense is right again.
        for case in conjugate.cases():
            log = case / "tracker_log.csv"
            log.write_text("# sense: icrf_from_sensor\n" + log.read_text())
        starloop("report", conjugate.folder, status=(0,))
        self.assertTrue(conjugate.report["is_met"])

    def pair(self, flown, text):
        """A plan and the statistical tracker by its flight."""
        folder = self.folder / f"model_of_{flown.folder.name}"
        folder.mkdir(exist_ok=True)
        return Pair(text, Report(flown.report), folder)

    def compared(self, name, model, own):
        """A tracker on pixels beside the model; prints the metrics one by one."""
        found = compare(own.report, model.report)
        print(f"\n{name}: metric | pixels | model | p | differs")
        show(found)
        self.assertEqual(found.missing, set())
        return found

    def assert_agrees(self, name, model, own):
        found = self.compared(name, model, own)
        self.assertEqual((found.different, found.exact), (set(), set()))
        self.assertGreater(found.chance, 0.001, "chance does not put so many outside their own intervals")

    def different(self, name, model, own):
        """Metrics of the whole plan that differ."""
        return {identifier for identifier, _ in self.compared(name, model, own).different}

    def test_the_statistical_tracker_agrees_with_the_one_on_pixels_in_every_metric(self):
        text = with_absolute_paths(PLAN)
        pair = self.pair(self.flown, text)
        noise, motion = pair.fit()
        self.assertGreater(motion[0], 1.5 * motion[1], "smeared stars are less certain along their motion")
        self.assert_agrees("model", pair.fly("model", noise, motion), pair.own)
        # Another detector of the same kind and other attitudes, with figures of its own.
        other_text = text.replace("seed = 1\n", "seed = 2\n")
        path = self.folder / "pixels_2.toml"
        path.write_text(other_text)
        starloop("fly", path, "--out", path.with_suffix(""), "--quiet")
        other = self.pair(Flown(path.with_suffix("")), other_text)
        own_noise, own_motion = other.fit()
        self.assert_agrees("model_2", other.fly("model_2", own_noise, own_motion), other.own)
        for one, another in zip(own_noise["temporal_noise"], noise["temporal_noise"]):
            self.assertLess(abs(one / another - 1.0), 0.1, "noise is not of one detector")
        # Controls: a noise that is the same all over the sky lacks the tail of the absolute error; one that is 20 % too
        # high; a bias of 1 arcsec.
        even = pair.fly("even", *pair.fit("even"), "even")
        self.assertIn("absolute_measurement_error.directional", self.different("even", even, pair.own))
        noisier = {**noise, "temporal_noise": [1.2 * value for value in noise["temporal_noise"]]}
        self.assertIn("temporal_noise.x", self.different("noisier", pair.fly("noisier", noisier, motion), pair.own))
        biased = Report(json.loads(json.dumps(self.flown.report)))
        for axis in AXES:
            biased.metrics[f"bias.{axis}", None]["value"] += 1.0
        off = Pair(text, biased, pair.folder).fly("off", noise, motion)
        self.assertIn("bias.x", self.different("off", off, pair.own))

    def test_noise_of_motion_is_found_from_slews(self):
        noise, field, wanted = (1.0, 1.0, 8.0), 1.3, (6.0, 2.0, 30.0)
        rates = {"slew 1": (0.3, 1.0, 0.1), "slew 2": (0.6, 2.0, 0.2), "slew -1": (-0.3, -1.0, -0.1)}

        def metrics(case, values):
            return [{"id": f"temporal_noise.{axis}", "case": case, "value": v} for axis, v in zip(AXES, values)]

        own, rest = [], []
        for case, (x, y, z) in rates.items():
            roll = 0.5 * math.radians(20.0) * z
            middle = math.hypot(wanted[0], wanted[1]) / math.sqrt(2.0) * roll
            added = (math.hypot(wanted[0] * x, wanted[1] * y, middle), math.hypot(wanted[0] * y, wanted[1] * x, middle),
                     wanted[2] * math.hypot(x, y, roll))
            rest += metrics(case, [field * n for n in noise])
            own += metrics(case, [field * math.hypot(n, a) for n, a in zip(noise, added)])
        got = noise_of_motion(Report({"metrics": own}), Report({"metrics": rest}), noise, rates, 20.0)
        for one, another in zip(got, wanted):
            self.assertAlmostEqual(one, another, places=9)
        still = noise_of_motion(Report({"metrics": rest}), Report({"metrics": rest}), noise, rates, 20.0)
        self.assertEqual(still, [0.0, 0.0, 0.0], "control: no noise of motion")

    def test_counts_are_compared_as_counts(self):
        self.assertEqual(count_p_value(1.0, 0.0), 1.0)
        self.assertEqual(count_p_value(0.0, 0.0), 1.0)
        self.assertAlmostEqual(count_p_value(0.0, 6.0), 2 / 64)
        self.assertAlmostEqual(count_p_value(2.0, 7.0), 2 * (1 + 9 + 36) / 512)
        self.assertLess(count_p_value(0.0, 20.0), 1e-5, "control: so many are not chance")

    def test_a_drift_of_the_mounting_comes_back(self):
        case = self.flown.folder / "thermo-elastic"
        described = json.loads((case / "case.json").read_text())
        drift = described["mounting_drift"]
        rows = rows_of(case / "frames.csv")
        zero = int(rows[0]["mid_exposure_tai_ns"])
        share = [math.sin(math.pi * (int(row["mid_exposure_tai_ns"]) - zero) * 1e-9 / drift["period_s"]) ** 2 for row in rows]
        fifth = len(share) // 5
        change = (sum(share[-fifth:]) - sum(share[:fifth])) / fifth
        self.assertGreater(change, 0.9, "from the cold to the hot end")
        wanted = dict(zip(AXES, (change * angle for angle in drift["arcsec"])))
        wanted["directional"] = math.hypot(wanted["x"], wanted["y"])
        for part, angle in wanted.items():
            self.assert_holds(self.flown.metric(f"thermo_elastic_error.{part}"), angle)
        # Controls: the other sign, another axis, and a report that takes the sensor's own axes for the truth.
        self.assert_holds(self.flown.metric("thermo_elastic_error.x"), -wanted["x"], is_held=False)
        self.assert_holds(self.flown.metric("thermo_elastic_error.y"), wanted["x"], is_held=False)
        other = self.flown.copy("own_axes")
        del described["mounting_drift"]
        (other.folder / "thermo-elastic/case.json").write_text(json.dumps(described))
        starloop("report", other.folder)
        for axis in AXES:
            self.assert_holds(other.metric(f"thermo_elastic_error.{axis}"), 0.0)
            self.assert_holds(other.metric(f"thermo_elastic_error.{axis}"), wanted[axis], is_held=False)

    def test_the_output_follows_a_sine_as_the_exposure_lets_it(self):
        exposure_s = float(rows_of(self.flown.folder / "sine_1.1/frames.csv")[0]["exposure_s"])
        ratios = [m for m in self.flown.report["metrics"] if m["id"] == "amplitude_ratio"]
        self.assertEqual(len(ratios), 5)
        for ratio in ratios:
            x = math.pi * float(ratio["case"].split()[1]) * exposure_s
            self.assertAlmostEqual(ratio["value"], math.sin(x) / x, delta=0.03, msg=ratio["case"])
        bandwidth = self.flown.metric("output_bandwidth")
        self.assertAlmostEqual(bandwidth["value"], 0.443 / exposure_s, delta=0.2)
        self.assert_holds(bandwidth, 0.443 / exposure_s)
        # Control: a log that is smoothed over three frames follows slower ones only.
        def smoothed(name):
            other = self.flown.copy(name)
            for case in other.folder.glob("sine_*"):
                path = case / "tracker_log.csv"
                rows = rows_of(path)
                lines = [",".join(rows[0])]
                for at, row in enumerate(rows):
                    near = [r for r in rows[max(at - 1, 0) : at + 2] if r["q_w"]]
                    means = [sum(float(r[n]) for r in near) / len(near) for n in ("q_w", "q_x", "q_y", "q_z")]
                    row.update(zip(("q_w", "q_x", "q_y", "q_z"), map(repr, means)))
                    lines.append(",".join(row.values()))
                path.write_text("\n".join(lines) + "\n")
            starloop("report", other.folder)
            return other

        self.assertLess(smoothed("smoothed").metric("output_bandwidth")["value"], 2.0)

    def test_exclusion_angles_are_between_two_swept_ones(self):
        for body, swept in (("sun", (12, 25, 60)), ("moon", (6, 25, 60)), ("earth", (2, 25, 50))):
            found = self.flown.metric(f"{body}_exclusion_angle")
            self.assertEqual((found["low"], found["value"], found["high"]), (swept[0], swept[1], swept[1]), body)
        # Control: no attitude at 25 degrees from the Sun.
        other = self.flown.copy("blinded")
        log = other.folder / "from_the_Sun_25/tracker_log.csv"
        log.write_text("".join(f"{line}\n" for line in log.read_text().splitlines()[:1]) + "0,,,,,,,,blinded\n")
        starloop("report", other.folder)
        self.assertEqual(other.metric("sun_exclusion_angle")["value"], 60)

    def test_a_recorded_run_is_judged_by_any_log(self):
        run = self.folder / "run"
        bench = ROOT / "configs/benches/closed_loop_small.toml"
        settings = ["--set", "timing.duration_s=20.0"]
        starloop("run", bench, "--clock", "virtual", "--sink", "recorder", "--out", run, "--quiet", *settings, status=(0,))
        # The truth itself as an AEM is a tracker without errors.
        starloop("export", run, "--attitude", run / "truth.aem")
        done = starloop("report", run, "--tracker", run / "truth.aem", status=(0,))
        self.assertTrue(done.stdout.startswith("PASSED: run"), done.stdout)
        report = json.loads((run / "tracker_report.json").read_text())
        bias = next(m for m in report["metrics"] if m["id"] == "bias.directional")
        self.assertLess(bias["value"], 1e-3)
        self.assertIn(["camera", "small tracker for campaigns"], report["conditions"])
        provenance = json.loads((run / "provenance.json").read_text())
        self.assertEqual(provenance["schema"], "starloop.provenance/1")
        self.assertIn("timing.duration_s=20.0", provenance["command_line"])
        self.assertTrue(any("small_tracker" in file["path"] for file in provenance["files"]))
        # Controls: a file of something else, a log of another day.
        starloop("report", run, "--tracker", run / "summary.json", status=(1,))
        other_day = run / "other.csv"
        other_day.write_text("utc,q_w,q_x,q_y,q_z\n2020-01-01T00:00:00Z,1,0,0,0\n")
        starloop("report", run, "--tracker", other_day, status=(4,))


    def fly_with_telemetry(self, name, outs):
        """A run of 20 s whose telemetry goes into files; returns its folder and the files by protocol."""
        run = self.folder / name
        bench = self.folder / f"{name}.toml"
        tables = "".join(
            f"""
[[tracker_out]]
protocol = "{protocol}"
link = "file"
path = "{protocol}.txt"
{keys}
"""
            for protocol, keys in outs.items()
        )
        bench.write_text(
            f"""name = "telemetry"
camera = "{ROOT}/configs/cameras/small_tracker.toml"

[timing]
frame_rate_hz = 5.0
duration_s = 20.0

[sink]
kind = "recorder"
fits = false
{tables}"""
        )
        starloop("run", bench, "--clock", "virtual", "--out", run, "--quiet", status=(0,))
        return run, {protocol: next(run.rglob(f"{protocol}.txt")) for protocol in outs}

    def judge(self, run, log, status=(0,)):
        """The metrics of a run's log."""
        starloop("report", run, "--tracker", log, status=status)
        report = json.loads((run / "tracker_report.json").read_text())
        return {m["id"]: m["value"] for m in report["metrics"] if m["case"] is None}

    def test_telemetry_of_a_bench_is_a_log(self):
        run, files = self.fly_with_telemetry("telemetry", {"json": "tag_error_ms = 30.0"})
        found = self.judge(run, files["json"])
        self.assertAlmostEqual(found["time_tag_error"], 30.0, places=6)
        self.assertEqual(found["acquisition_probability"], 1.0)
        self.assertLess(found["bias.directional"], 1.0)
        self.assertGreater(found["acquisition_time.median"], 0.1, "exposure, readout and 50 ms")

    def test_captures_of_every_protocol_are_judged_alike(self):
        outs = {"json": "", "sagitta": "", "canopen": "starts_operational = true", "ccsds": 'quaternion = "conjugate"'}
        run, files = self.fly_with_telemetry("captures", outs)
        wanted = self.judge(run, files["json"])
        self.assertEqual(wanted["acquisition_probability"], 1.0)
        ccsds = files["ccsds"].read_text()
        files["ccsds"].write_text("# sense: icrf_from_sensor\n" + ccsds)
        # Single precision of the line; milliseconds of the day, at a rate of nothing.
        for protocol in ("sagitta", "canopen", "ccsds"):
            found = self.judge(run, files[protocol])
            for identifier in ("bias.x", "bias.y", "bias.rotational", "temporal_noise.x", "acquisition_time.median"):
                self.assertAlmostEqual(found[identifier], wanted[identifier], delta=0.05, msg=f"{protocol} {identifier}")
            self.assertEqual(found["tracking_probability"], 1.0)
        # The same as candump writes it down.
        lines = [line.split() for line in files["canopen"].read_text().splitlines()]
        from_tai = 37
        candump = run / "candump.log"
        seconds = [(int(tai_ns) - from_tai * 10**9) for _, tai_ns, _, _ in lines]
        candump.write_text(
            "".join(f"({ns // 10**9}.{ns % 10**9:09d}) can0 {line[2]}#{line[3]}\n" for ns, line in zip(seconds, lines))
        )
        self.assertAlmostEqual(self.judge(run, candump)["bias.x"], wanted["bias.x"], delta=0.05)
        # Controls: the other sense; j and k swapped in PDO3 of node 96; a node that does not speak.
        files["ccsds"].write_text(ccsds)
        self.judge(run, files["ccsds"], status=(4,))
        swapped = run / "swapped.txt"
        rows = [(*line[:3], line[3][8:] + line[3][:8] if int(line[2], 16) == 0x3E0 else line[3]) for line in lines]
        swapped.write_text("".join(" ".join(row) + "\n" for row in rows))
        self.assertNotEqual(swapped.read_text(), files["canopen"].read_text())
        self.judge(run, swapped, status=(4,))
        swapped.write_text("# node: 97\n" + files["canopen"].read_text())
        starloop("report", run, "--tracker", swapped, status=(1,))

    def test_a_capture_of_nos3_written_here_is_judged(self):
        run, _ = self.fly_with_telemetry("nos3", {"json": ""})

        def capture(order):
            """Answers of the tracker, 120 ms after mid-exposure: the conjugate, scalar last, 16 bits each."""
            lines = ["# latency_ms: 120"]
            for row in rows_of(next(run.rglob("frames.csv"))):
                w, *vector = (float(row[name]) for name in QUATERNION_OF_FRAMES)
                parts = [-vector[axis] for axis in order] + [w]
                wire = b"".join(int(part * 32767 + 32768).to_bytes(2, "big") for part in parts)
                tai_ns = int(row["mid_exposure_tai_ns"]) + 120_000_000
                lines.append(f"2026-03-01T00:00:00Z {tai_ns} - {'DEAD' + wire.hex().upper() + '01BEEF'}")
            path = run / "nos3.txt"
            path.write_text("\n".join(lines) + "\n")
            return path

        found = self.judge(run, capture((0, 1, 2)))
        self.assertEqual((found["acquisition_probability"], found["tracking_probability"]), (1.0, 1.0))
        self.assertLess(found["bias.directional"], 12.6, "one step of 16 bits")
        self.judge(run, capture((1, 0, 2)), status=(4,))


SMALL_PLAN = f"""name = "small"
camera = "{ROOT}/configs/cameras/small_tracker.toml"
frame_rate_hz = 2.0
[document]
unit = "ST <20>"
serial_number = "003"
[[case]]
name = "slew"
use = "slew"
attitudes = {{ kind = "fixed", ra_deg = 84.05, dec_deg = -1.2 }}
rate_deg_s = [0.0, 0.1, 0.0]
frames = 6
"""
"""A plan of six frames."""
MADE_UP_TRACKER = """import csv, pathlib, sys
frames, log = map(pathlib.Path, sys.argv[1:3])
rows = list(csv.DictReader((frames / "frames.csv").open()))
names = ("frame", "qw", "qx", "qy", "qz")
lines = [",".join(row[name] for name in names) for row in rows]
log.write_text("frame,q_w,q_x,q_y,q_z\\n" + "\\n".join(lines) + "\\n")
print(*sys.argv[3:])
"""
"""A program that reads the truth: in the place of any tracker."""


def fits_pixels(path):
    """Returns the pixels of a FITS image of 16 bits, from the top."""
    data = path.read_bytes()
    cards = [data[at : at + 80].decode("latin-1") for at in range(0, len(data), 80)]
    end = next(place for place, card in enumerate(cards) if card.rstrip() == "END")
    value = {card[:8].strip(): card[10:].split("/")[0].strip() for card in cards[:end] if card[8:10] == "= "}
    count, start = int(value["NAXIS1"]) * int(value["NAXIS2"]), -(-(end + 1) * 80 // 2880) * 2880
    return [stored + 32768 for stored in struct.unpack_from(f">{count}h", data, start)]


def png_greys(path):
    """Returns the pixels of a PNG of 8-bit grey, whichever filter each row has."""
    data, place, packed = path.read_bytes(), 8, b""
    while place < len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        packed += data[place + 8 : place + 8 + length] if kind == b"IDAT" else b""
        place += 12 + length
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    if (depth, colour) != (8, 0):
        raise ValueError(f"{path}: got {depth} bits, colour {colour}, wanted 8-bit grey")
    raw, above, greys = zlib.decompress(packed), [0] * width, []
    for row in range(height):
        kind, *bytes_of_row = raw[row * (width + 1) : (row + 1) * (width + 1)]
        now = []
        for x, byte in enumerate(bytes_of_row):
            left, up, corner = (now[x - 1] if x else 0), above[x], (above[x - 1] if x else 0)
            nearest = min((left, up, corner), key=lambda near: abs(left + up - corner - near))
            now.append((byte + (0, left, up, (left + up) // 2, nearest)[kind]) % 256)
        greys += now
        above = now
    return greys


class Plans(InAFolder):
    """Messages of `fly`, `report` and `check` about plans and requirements."""

    def setUp(self):
        super().setUp()
        self.written("tracker.py", MADE_UP_TRACKER)

    def write(self, requirement="", plan=SMALL_PLAN):
        if requirement:
            (self.folder / "limits.toml").write_text(requirement)
            plan = plan.replace('name = "small"', 'name = "small"\nrequirements = "limits.toml"')
        (self.folder / "plan.toml").write_text(plan)

    def run_here(self, *arguments, status):
        return starloop(*arguments, status=status, cwd=self.folder)

    def fly(self, *arguments, status):
        command = ["--tracker-command", sys.executable, "tracker.py", "{frames}", "{log}", "--own", *arguments]
        return self.run_here("fly", "plan.toml", "--out", "flown", *command, status=status)

    def test_a_plan_named_without_a_folder_starts_its_program_and_options_behind_it_are_those_of_fly(self):
        self.write()
        done = self.fly("--tracker-name", "SN003", "--quiet", "--keep-images", status=4)
        self.assertIn("--own\n", done.stdout)
        self.assertIn("NOT SHOWN: SN003, small: ", done.stdout)
        self.assertTrue(list((self.folder / "flown/slew").glob("*.fits")), "--keep-images")
        page = (self.folder / "flown/report.html").read_text()
        self.assertIn("ST &lt;20&gt;", page)
        self.assertIn("<td>small tracker for campaigns</td>", page, "the camera's name, not that of its file")
        digest = hashlib.sha256((self.folder / "flown/report.json").read_bytes()).hexdigest()
        self.assertIn(digest, page, "the page has the hash of its data")

    def test_images_of_8_bits_are_on_the_scale_that_the_report_states(self):
        self.write()
        done = self.fly("--keep-images", "--images", "png8:60,2", status=4)
        words = "FITS, and PNG of 8 bits: grey = (DN - 60) / 2, rounded, 0 to 255; white from 570 DN"
        self.assertIn(f"images: {words}\n", done.stderr)
        report = json.loads((self.folder / "flown/report.json").read_text())
        self.assertIn(["images", words], report["conditions"])
        folder = self.folder / "flown/slew"
        self.assertEqual(len(list(folder.glob("*.png"))), len(list(folder.glob("*.fits"))))
        dn, greys = fits_pixels(folder / "frame_000003.fits"), png_greys(folder / "frame_000003.png")
        wanted = [min(max(math.floor((value - 60) / 2 + 0.5), 0), 255) for value in dn]
        self.assertEqual(greys, wanted)
        self.assertNotEqual(greys, [min(value >> 4, 255) for value in dn], "control: another scale")
        done = self.run_here("fly", "plan.toml", "--out", "own", "--images", "png8", status=2)
        self.assertIn("--images: wanted a program under test", done.stderr)

    def test_a_quoted_command_and_a_program_that_is_not_there(self):
        self.write()
        command = f"{sys.executable} tracker.py '{{frames}}' {{log}}"
        self.run_here("fly", "plan.toml", "--tracker-command", command, "--out", "quoted", "--quiet", status=4)
        done = self.run_here("fly", "plan.toml", "--tracker-command", "no_such_tracker", "--out", "flown", status=1)
        self.assertIn(f"cannot find the program no_such_tracker; wanted one on the PATH, or a path relative to {self.folder}", done.stderr)
        self.assertFalse((self.folder / "flown").exists())

    def test_all_mistakes_are_named_before_anything_flies(self):
        limits = """[[requirement]]
id = "A"
metric = "acquisition_time"
most = 9
[[requirement]]
id = "B"
metric = "losses"
case = "slev"
most = 0
"""
        turning = """[[case]]
name = "grid"
use = "inertial"
attitudes = { kind = "uniform", count = 9 }
frames = 2
frame_rate_hz = 9.0
"""
        self.write(limits, SMALL_PLAN + turning)
        done = self.fly(status=1)
        self.assertIn('case "grid": frame_rate_hz: got 9', done.stderr)
        self.assertIn('did you mean "acquisition_time.at_probability" or "acquisition_time.median"?', done.stderr)
        self.assertFalse((self.folder / "flown").exists(), "nothing blocks the next try")
        self.write(limits.replace("acquisition_time", "false_solutions"))
        done = self.fly(status=1)
        self.assertIn('unknown case "slev"; did you mean "slew"?; cases are slew', done.stderr)
        self.assertIn('did you mean "slew"?', self.run_here("check", "plan.toml", status=1).stderr)
        self.write(limits.replace("acquisition_time", "false_solutions").replace("slev", "slew"))
        self.assertIn('test plan "small" is sound', self.run_here("check", "plan.toml", status=0).stdout)
        self.assertTrue(self.fly("--quiet", status=0).stdout.startswith("--own\nPASSED: "))

    def test_a_flight_that_did_not_end_is_flown_again(self):
        self.write()
        broken = ["--tracker-command", sys.executable, "-c", "raise SystemExit(3)", "--out", "flown", "--quiet"]
        self.assertIn("ended with exit status: 3", self.run_here("fly", "plan.toml", *broken, status=1).stderr)
        self.assertTrue((self.folder / "flown/slew/frames.csv").exists())
        self.fly("--quiet", status=4)

    def test_a_sink_of_a_plan_and_a_confidence_without_an_interval_are_refused(self):
        self.write(plan='set = ["sink.png_every=1"]\n' + SMALL_PLAN)
        self.assertIn('got "sink.png_every=1", wanted no sink', self.fly(status=1).stderr)
        self.write()
        self.fly("--quiet", status=4)
        path = self.folder / "flown/plan.json"
        kept = path.read_text()
        for wrong in ("1e308", "1.0", "0", "-1"):
            path.write_text(kept.replace('"confidence": 0.95', f'"confidence": {wrong}'))
            self.assertIn("confidence: got", self.run_here("report", "flown", status=1).stderr)
            self.run_here("report", "flown", f"--confidence={wrong}", status=2)
        path.write_text(kept)
        self.run_here("report", "flown", "--serial-number", "004", status=4)
        self.assertEqual(json.loads((self.folder / "flown/report.json").read_text())["document"]["serial_number"], "004")

    def test_templates_are_printed_and_checked(self):
        for kind, sound in (("plan", "is sound"), ("requirements", "are sound"), ("dataset", "sound")):
            text = self.run_here("init", kind, status=0).stdout
            path = self.written(f"{kind}.toml", text.replace("../cameras", f"{ROOT}/configs/cameras"))
            self.assertIn(sound, self.run_here("check", path.name, status=0).stdout)
            json.loads(self.run_here("schema", kind, status=0).stdout)
            self.assertIn("| key |", self.run_here("keys", kind, status=0).stdout)
            path.write_text(path.read_text() + "\nno_such_key = 1\n")
            self.assertIn("no_such_key", self.run_here("check", path.name, status=1).stderr)


class CedarSolve(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.python = cedar_python()

    def fly(self, name, camera, *arguments):
        """Flies the cases lost in space of the short plan with cedar-solve behind a camera."""
        out = self.folder / name
        plan = self.folder / f"{name}.toml"
        text = PLAN.read_text().replace("../cameras/small_tracker.toml", str(ROOT / f"configs/cameras/{camera}.toml"))
        text = text.replace('requirements = "requirements_small_tracker.toml"\n', "")
        text = text.replace('kind = "uniform", count = 120', 'kind = "uniform", count = 10')
        text = text.replace("frame_rate_hz = 2.0", "frame_rate_hz = 1.0").replace("frames = 2\n", "frames = 1\n")
        plan.write_text(text)
        command = ["--tracker-command", self.python, CEDAR, "{frames}", "{camera}", "{log}", *arguments]
        starloop("fly", plan, "--out", out, "--quiet", "--case", "lost in space", "--tracker-name", "cedar-solve", *command)
        return Flown(out)

    def test_it_solves_frames_of_every_shipped_camera_that_its_field_allows(self):
        shipped = {path.stem for path in (ROOT / "configs/cameras").glob("*.toml")}
        self.assertEqual(shipped, set(CAMERAS) | set(TOO_NARROW), "a camera of neither list")
        for camera, share in CAMERAS.items():
            with self.subTest(camera=camera):
                flown = self.fly(camera, camera, "--aberration")
                self.assertGreaterEqual(flown.metric("acquisition_probability")["value"], share)
                self.assertEqual(flown.metric("false_solutions")["value"], 0)

    def test_errors_added_to_its_log_come_back(self):
        out = self.folder / "plan"
        command = ["--tracker-command", self.python, CEDAR, "{frames}", "{camera}", "{log}", "--aberration"]
        cases = [word for name in ("inertial", "slew", "drift") for word in ("--case", name)]
        plan = self.folder / "plan.toml"
        text = PLAN.read_text().replace("../cameras/", f"{ROOT}/configs/cameras/").replace("count = 40 }\nframes = 15", "count = 12 }\nframes = 6")
        plan.write_text(text.replace('requirements = "requirements_small_tracker.toml"\n', "").replace("frames = 600", "frames = 120").replace("frames = 40", "frames = 15"))
        starloop("fly", plan, "--out", out, "--quiet", *cases, "--tracker-name", "cedar-solve", *command)
        flown = Flown(out)
        dice = random.Random(6)
        sigma = 400.0

        def worse(q, row, frame):
            return turned(q, [dice.gauss(a, s) * ARCSEC for a, s in ((90.0, sigma), (-60.0, sigma), (900.0, sigma))])

        limits = ["--confidence", "0.99"]
        other = flown.copy("worse")
        plan_file = json.loads((other.folder / "plan.json").read_text())
        plan_file.update(false_directional_arcsec=3000.0, false_rotational_arcsec=30000.0)
        (other.folder / "plan.json").write_text(json.dumps(plan_file))
        for case in other.cases():
            change_log(case, worse)
        starloop("report", other.folder, *limits)
        starloop("report", flown.folder, *limits)
        for identifier, by in (("bias.x", 90.0), ("bias.y", -60.0), ("bias.rotational", 900.0)):
            metric, before = other.metric(identifier), flown.metric(identifier)["value"]
            self.assertTrue(metric["low"] <= before + by <= metric["high"], f"{metric} {before} {by}")
        noise, before = other.metric("temporal_noise.x"), flown.metric("temporal_noise.x")["value"]
        self.assertTrue(noise["low"] <= math.hypot(before, sigma) <= noise["high"], f"{noise} {before}")

    def test_aberration_that_it_does_not_know_is_found(self):
        out = self.folder / "aberration"
        plan = self.folder / "aberration.toml"
        text = PLAN.read_text().replace("../cameras/small_tracker", f"{ROOT}/configs/cameras/star_tracker_20deg")
        text = text.replace('requirements = "requirements_small_tracker.toml"\n', "").replace("count = 120 }\nframes = 2", "count = 60 }\nframes = 1")
        plan.write_text(text.replace("frame_rate_hz = 2.0", "frame_rate_hz = 1.0"))
        command = ["--tracker-command", self.python, CEDAR, "{frames}", "{camera}", "{log}"]
        starloop("fly", plan, "--out", out, "--quiet", "--case", "lost in space", "--keep-images", *command)
        flown = Flown(out)
        residual = flown.metric("aberration_residual")
        self.assertTrue(residual["low"] <= 20.5 <= residual["high"], f"{residual}")
        self.assertGreater(residual["low"], 5.0)
        # The same images with the Earth's velocity taken into account.
        case = out / "lost_in_space"
        camera = ROOT / "configs/cameras/star_tracker_20deg.toml"
        subprocess.run([self.python, CEDAR, case, camera, case / "tracker_log.csv", "--aberration"], check=True)
        starloop("report", out)
        residual = flown.metric("aberration_residual")
        self.assertTrue(residual["low"] <= 0.0 <= residual["high"], f"{residual}")


if __name__ == "__main__":
    unittest.main()
