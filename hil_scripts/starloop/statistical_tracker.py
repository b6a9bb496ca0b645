"""Flies a test plan with its own tracker and with the statistical one by the figures of the first, and compares both.

    python3 hil_scripts/starloop/statistical_tracker.py PLAN.toml --out DIR [--cases]

DIR/own and DIR/model have the flights and their reports, DIR/model.toml the plan with the figures found: its [tracker.model]
goes into [tracker_out.model] of a bench as it is (without earth_exclusion_deg). Noise and spatial errors by the stars are
given as the root mean square over the sky, and a plan sees a part of it: a first flight of the cases concerned finds that
part. Noise of motion is fitted to the slews, in squares, by weighted least squares. A flight that DIR has already is used
again. STARLOOP_BINARY names the program (default target/release/starloop). Exit status 4: the two differ. Standard library
only.
"""
# mypy: ignore-errors

import argparse
import json
import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path

if not __package__:  # called by its path
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from starloop.compare_reports import compare, show

ROOT = Path(__file__).resolve().parents[2]
BINARY = os.environ.get("STARLOOP_BINARY", str(ROOT / "target/release/starloop"))
AXES = ("x", "y", "rotational")
CALIBRATED = ("temporal_noise", "fov_spatial_error", "pixel_spatial_error")
"""Metrics that a model by the stars takes as the root mean square over the sky."""
USES = ("inertial", "fov_grid", "pixel_grid", "slew")
"""Uses of the cases that show them."""
BODIES = ("sun", "moon", "earth")
MOST_STARS = 40
LOST_ABOVE_DEG_S = 5.0
"""The rate from which the model loses an attitude."""


class Report:
    """Metrics of a flight by identifier and case."""

    def __init__(self, report):
        self.report = report
        self.metrics = {(m["id"], m["case"]): m for m in report["metrics"]}

    @classmethod
    def of(cls, folder):
        """Reads the report in a folder."""
        return cls(json.loads((folder / "report.json").read_text()))

    def value(self, identifier, case=None):
        """The value of a metric; ends the program where the report has none."""
        found = self.metrics.get((identifier, case))
        if found is None:
            sys.exit(f"the report has no {identifier}: the plan needs a case that shows it, as ecss_star_tracker_short.toml has")
        return found["value"]

    def of_axes(self, identifier, case=None):
        """The values about x, y and z."""
        return [self.value(f"{identifier}.{axis}", case) for axis in AXES]


def starloop_fly(plan, out, *more):
    """Flies a plan unless its report is there; 4 is a report whose requirements are not met."""
    if not (out / "report.json").exists():
        done = subprocess.run([BINARY, "fly", str(plan), "--out", str(out), "--quiet", *more])
        if done.returncode not in (0, 4):
            sys.exit(f"{plan}: starloop fly ended with status {done.returncode}")
    return Report.of(out)


def with_absolute_paths(path):
    """Returns the text of a plan with paths that hold from any folder."""
    text = path.read_text()
    plan = tomllib.loads(text)
    for key in ("camera", "requirements"):
        if key in plan:
            text = text.replace(f'{key} = "{plan[key]}"', f'{key} = "{path.parent.resolve() / plan[key]}"')
    return text


def slews(plan):
    """Returns the slews of a plan: names of their cases, and rates about the sensor's axes, deg/s."""
    found = {}
    for case in plan["case"]:
        if case["use"] == "slew":
            for value in case["sweep"]["values"]:
                found[f"{case['name']} {value:g}"] = [value * rate for rate in case["rate_deg_s"]]
    return found


def noise_of_motion(own, at_rest, noise, rates, field_deg):
    """Returns noise per deg/s along and across the motion and about the boresight, from slews of both trackers.

    `at_rest` is the model's report without noise of motion, `noise` its figures. In squares the law is linear in the three
    figures; each variance has the weight of a variance's own error.
    """
    normal, right, about = [[0.0, 0.0], [0.0, 0.0]], [0.0, 0.0], [0.0, 0.0]
    for case, (x, y, z) in rates.items():
        if ("temporal_noise.x", case) not in own.metrics:
            continue
        roll = (0.5 * math.radians(field_deg) * z) ** 2
        terms = [(x * x + roll / 2, y * y + roll / 2), (y * y + roll / 2, x * x + roll / 2)]
        seen, rest = own.of_axes("temporal_noise", case), at_rest.of_axes("temporal_noise", case)
        for axis, (along, across) in enumerate(terms):
            field, weight = (rest[axis] / noise[axis]) ** 2, seen[axis] ** -4
            row, added = (along * field, across * field), seen[axis] ** 2 - rest[axis] ** 2
            for i in range(2):
                right[i] += weight * row[i] * added
                for j in range(2):
                    normal[i][j] += weight * row[i] * row[j]
        row, weight = (x * x + y * y + roll) * (rest[2] / noise[2]) ** 2, seen[2] ** -4
        about[0] += weight * row * (seen[2] ** 2 - rest[2] ** 2)
        about[1] += weight * row * row
    (a, b), (_, d) = normal
    determinant = a * d - b * b
    if determinant <= 0.0:
        return [0.0, 0.0, 0.0]
    squares = ((d * right[0] - b * right[1]) / determinant, (a * right[1] - b * right[0]) / determinant, about[0] / about[1])
    return [math.sqrt(max(square, 0.0)) for square in squares]


def false_probability(own):
    """Returns the share of false attitudes in cases without a disturbance: those of the others have their own causes."""
    disturbed = sum(m["value"] for (identifier, case), m in own.metrics.items() if identifier == "false_solutions" and case)
    return (own.value("false_solutions") - disturbed) / sum(case["frames"] for case in own.report["cases"])


def model_lines(own, noise, motion, method):
    """Returns [tracker.model] by a report; `noise` has the calibrated figures."""
    exclusion = [(body, own.metrics.get((f"{body}_exclusion_angle", None))) for body in BODIES]
    lines = {
        "bias_arcsec": own.of_axes("bias"),
        "fov_spatial_arcsec": noise["fov_spatial_error"],
        "pixel_spatial_arcsec": noise["pixel_spatial_error"],
        "aberration_residual_arcsec": own.value("aberration_residual"),
        "noise_arcsec": noise["temporal_noise"],
        "noise_over_sky": f'"{method}"',
        "stars": MOST_STARS,
        "noise_arcsec_per_deg_s": motion,
        "date_error_ms": own.value("measurement_date_error"),
        "false_probability": false_probability(own),
        "acquires_below_deg_s": LOST_ABOVE_DEG_S,
        "lost_above_deg_s": LOST_ABOVE_DEG_S,
    }
    for body, angle in exclusion:
        # Between the last angle that is not met and the first that is; 0: met at every angle flown.
        if angle and angle["low"]:
            lines[f"{body}_exclusion_deg"] = (angle["low"] + angle["value"]) / 2
    return "\n".join(["[tracker.model]", *(f"{key} = {value}" for key, value in lines.items())]) + "\n"


class Pair:
    """A plan, flown by its own tracker, and the statistical tracker that its report describes."""

    def __init__(self, plan_text, own, folder):
        self.text, self.own, self.folder = plan_text, own, folder
        self.plan = tomllib.loads(plan_text)
        camera = tomllib.loads(Path(self.plan["camera"]).read_text())
        width_mm = camera["detector"]["width_px"] * camera["detector"]["pixel_pitch_um"] * 1e-3
        self.field_deg = math.degrees(width_mm / camera["optics"]["focal_length_mm"])

    def fly(self, name, noise, motion, method="stars", cases=()):
        """Flies the model by these figures; `cases`: only these."""
        before = 'source = "built_in"\n'
        if before not in self.text:
            sys.exit(f"the plan's tracker: got another one, wanted {before.strip()}")
        path = self.folder / f"{name}.toml"
        path.write_text(self.text.replace(before, 'source = "model"\n\n' + model_lines(self.own, noise, motion, method)))
        return starloop_fly(path, self.folder / name, *(word for case in cases for word in ("--case", case)))

    def fit(self, method="stars"):
        """Returns the noise and the noise of motion with which the model has the tracker's own over the plan."""
        wanted = {name: self.own.of_axes(name) for name in CALIBRATED}
        cases = [case["name"] for case in self.plan["case"] if case["use"] in USES]
        first = self.fly(f"first_{method}", wanted, [0.0] * 3, method, cases)
        got = {name: first.of_axes(name) for name in CALIBRATED}
        motion = noise_of_motion(self.own, first, wanted["temporal_noise"], slews(self.plan), self.field_deg)
        noise = {name: [w * w / g if g > 0.0 else w for w, g in zip(wanted[name], got[name])] for name in CALIBRATED}
        return noise, motion


def main():
    """Finds the figures of a tracker from a flight of a plan."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--cases", action="store_true", help="compare metrics of single cases too")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    own = starloop_fly(given.plan, given.out / "own")
    pair = Pair(with_absolute_paths(given.plan), own, given.out)
    model = pair.fly("model", *pair.fit())
    found = compare(own.report, model.report, given.cases)
    show(found)
    sys.exit(4 if found.different or found.exact or found.missing else 0)


if __name__ == "__main__":
    main()
