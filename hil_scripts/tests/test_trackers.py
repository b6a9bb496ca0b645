"""Other people's star trackers in plans: python3 hil_scripts/tests/test_trackers.py

Each adapter of hil_scripts/trackers has at most ten lines, and `starloop fly` starts it. LOST and openstartracker have a stand-in
here, which gives the truth in the form of the program, by that program's own formulas; cedar-solve and tetra3rs are the programs
themselves, from PyPI, in environments below target. `starloop report --find-axes` finds the turn of a tracker with other axes
and refuses one that is not constant. Needs numpy.
"""

import json
import math
import os
import socket
import sys
import threading
import types
import unittest
from pathlib import Path

import numpy
from support import ROOT, TARGET, InAFolder, product, rows_of, starloop
from test_tracker_report import cedar_python, python_with

TRACKERS = ROOT / "hil_scripts/trackers"
ADAPTERS = ("cedar_solve", "lost", "openstartracker", "tetra3_rs")
LINES_MOST = 10
TETRA3RS = "tetra3rs==0.14.0"
QUATERNION = ("qw", "qx", "qy", "qz")
PLAN = f"""name = "other trackers"
camera = "{ROOT}/configs/cameras/CAMERA.toml"
frame_rate_hz = 1.0
[tracker]
source = "program"
command = ["{sys.executable}", "tracker.py", "{{frames}}", "{{camera}}", "{{log}}"]
EXTRA
[[case]]
name = "lost in space"
use = "lost_in_space"
attitudes = {{ kind = "uniform", count = 8 }}
frames = 1
"""
LOST = '''#!{python}
"""Gives the truth in the form of LOST: what its ToSpherical makes of the quaternion (+x boresight, +y left, +z up)."""
import csv, math, sys
from pathlib import Path
png = Path(sys.argv[sys.argv.index("--png") + 1])
assert png.read_bytes()[:8] == b"\\x89PNG\\r\\n\\x1a\\n" and png.stat().st_size > 1000
assert [float(sys.argv[sys.argv.index(name) + 1]) > 0 for name in ("--focal-length", "--pixel-size")]
row = next(row for row in csv.DictReader(open("{frames}")) if int(row["frame"]) == int("".join(filter(str.isdigit, png.stem))))
if int(row["frame"]) == 3:
    print("attitude_known 0")
    sys.exit()
def product(a, b):
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw)
# Axes x, y, z of LOST are z, -x, -y of the sensor.
real, i, j, k = product((0.5, -0.5, 0.5, -0.5), [float(row[name]) for name in ("qw", "qx", "qy", "qz")])
ra = math.atan2(2 * (-real * k + i * j), 1 - 2 * (j * j + k * k)) % math.tau
de = -math.asin(2 * (-real * j - i * k))
roll = -math.atan2(2 * (-real * i + j * k), 1 - 2 * (i * i + j * j)) % math.tau
print("attitude_known 1")
for name, angle in ("ra", ra), ("de", de), ("roll", roll):
    print(f"attitude_{{name}} {{math.degrees(angle)}}")
'''
TRUTH = """import csv, pathlib, sys
frames, log = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[3])
rows = list(csv.DictReader((frames / "frames.csv").open()))
"""
"""First lines of programs that read the truth, in the place of any tracker."""


def matrix_of(row):
    """Rows: the sensor's axes in ICRF axes."""
    w, x, y, z = (float(row[name]) for name in QUATERNION)
    return numpy.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Trackers(InAFolder):
    """Flights of a small plan."""

    def plan(self, extra="", camera="small_tracker"):
        return self.written("plan.toml", PLAN.replace("CAMERA", camera).replace("EXTRA", extra))

    def fly(self, command=(), status=(0, 4), extra="", camera="small_tracker", **options):
        """Flies the plan; returns metrics by their names."""
        plan = self.plan(extra, camera)
        words = ["--tracker-command", *command] if command else []
        done = starloop("fly", plan, "--out", self.out, "--quiet", *words, status=status, timeout=900, cwd=self.folder, **options)
        if done.returncode == 1:
            return done.stderr
        found = json.loads((self.out / "report.json").read_text())["metrics"]
        return {metric["id"]: metric["value"] for metric in found if metric["case"] is None}

    def adapter(self, name):
        return [sys.executable, TRACKERS / f"{name}.py", "{frames}", "{camera}", "{log}"]

    def assert_is_the_truth(self, metrics, share=1.0):
        self.assertEqual(metrics["false_solutions"], 0)
        self.assertEqual(metrics["acquisition_probability"], share)


class Adapters(Trackers):
    def test_each_has_at_most_ten_lines_and_there_is_one_place(self):
        self.assertEqual({path.stem for path in TRACKERS.glob("*.py")}, {*ADAPTERS, "adapter"})
        for name in ADAPTERS:
            with self.subTest(name=name):
                self.assertLessEqual(len((TRACKERS / f"{name}.py").read_text().splitlines()), LINES_MOST)

    def test_lost_answers_in_its_own_form(self):
        folder = self.folder / "lost"
        folder.mkdir()
        program = folder / "lost"
        frames = self.out / "lost_in_space/frames.csv"
        program.write_text(LOST.format(python=sys.executable, frames=frames))
        program.chmod(0o755)
        environment = {**os.environ, "LOST": str(folder)}
        self.assert_is_the_truth(self.fly(self.adapter("lost"), env=environment), 7 / 8)
        log = (self.out / "lost_in_space/tracker_log.csv").read_text()
        self.assertTrue(log.startswith("# roll: lost\n"), log)
        # Control: read with another convention, all are false.
        case = self.out / "lost_in_space/tracker_log.csv"
        case.write_text(log.replace("# roll: lost", "# roll: tetra3"))
        starloop("report", self.out, status=4)
        metrics = json.loads((self.out / "report.json").read_text())["metrics"]
        self.assertEqual(next(metric["value"] for metric in metrics if metric["id"] == "false_solutions"), 7)

    def test_openstartracker_answers_over_its_port(self):
        server = socket.create_server(("127.0.0.1", 0))
        self.addCleanup(server.close)
        tracker = OpenStarTracker(self.out / "lost_in_space/frames.csv")
        threading.Thread(target=tracker.serve, args=(server,), daemon=True).start()
        environment = {**os.environ, "OPENSTARTRACKER_PORT": str(server.getsockname()[1])}
        self.assert_is_the_truth(self.fly(self.adapter("openstartracker"), env=environment), 7 / 8)


class OpenStarTracker:
    """Runs the Python text that arrives, as openstartracker's server does; its camera finds the truth."""

    def __init__(self, frames):
        self.frames = frames
        self.last_match = None

    def solve_image(self, path, lis=1, quiet=0):
        number = int("".join(filter(str.isdigit, Path(path).stem)))
        assert Path(path).read_bytes().startswith(b"\x89PNG")
        row = next(row for row in rows_of(self.frames) if int(row["frame"]) == number)
        # From body axes (boresight, image right, image down) to ICRF.
        x, y, z = matrix_of(row)
        turn = numpy.stack([z, x, y], 1)
        winner = types.SimpleNamespace(**{f"R{i + 1}{j + 1}": turn[i, j] for i in range(3) for j in range(3)})
        match = types.SimpleNamespace(match=types.SimpleNamespace(winner=winner))
        self.last_match = None if number == 3 else match

    def serve(self, server):
        while True:
            try:
                line, _ = server.accept()
            except OSError:
                return
            said = []

            def note(*words):
                said.append(" ".join(map(str, words)) + "\n")

            with line:
                exec(line.recv(4096).decode(), {"rgb": self, "np": numpy, "print": note})
                line.sendall("".join(said).encode())


class Forms(Trackers):
    """Logs in the form of a program, with keys of a plan and options of `report`."""

    def tracker(self, lines):
        self.written("tracker.py", TRUTH + lines)

    def write_angles(self):
        # tetra3's own lines: vectors of image left and up, and north.
        self.tracker(
            "import math\n"
            "log.write_text('frame,RA,Dec,Roll\\n')\n"
            "for row in rows:\n"
            "    w, x, y, z = (float(row[name]) for name in ('qw', 'qx', 'qy', 'qz'))\n"
            "    left, up = -2 * (x * z + w * y), -2 * (y * z - w * x)\n"
            "    axis = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)\n"
            "    angles = math.atan2(axis[1], axis[0]), math.asin(axis[2]), math.atan2(left, up)\n"
            "    with log.open('a') as out:\n"
            "        out.write(','.join([row['frame'], *(str(math.degrees(angle)) for angle in angles)]) + '\\n')\n"
        )

    def write_turned(self, sense=""):
        """A tracker whose +x is the boresight, +y image left and +z image up, 20 arcsec off about the boresight."""
        self.tracker(
            f"def product(a, b):\n"
            f"    (aw, ax, ay, az), (bw, bx, by, bz) = a, b\n"
            f"    return (aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,\n"
            f"            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw)\n"
            f"log.write_text('frame,q_w,q_x,q_y,q_z\\n')\n"
            f"for row in rows:\n"
            f"    q = product((1, 0, 0, 4.848e-5), [float(row[name]) for name in ('qw', 'qx', 'qy', 'qz')])\n"
            f"    w, x, y, z = product((0.5, -0.5, 0.5, -0.5), q)\n"
            f"    with log.open('a') as out:\n"
            f"        out.write(','.join([row['frame'], *map(str, (w, {sense}x, {sense}y, {sense}z))]) + '\\n')\n"
        )

    def test_a_roll_without_its_convention_is_refused_and_with_it_is_the_truth(self):
        self.write_angles()
        self.assertIn("got ra,dec,roll without the convention of the roll", self.fly(status=1))
        self.assertFalse((self.out / "plan.json").exists(), "at its first case")
        self.assert_is_the_truth(self.fly(extra='roll = "tetra3"'))
        # As an option of report; the other conventions are false.
        for roll, is_true in (("cedar-solve", True), ("lost", False), ("astrometry", False)):
            starloop("report", self.out, "--roll", roll, status=(0, 4))
            metrics = {metric["id"]: metric["value"] for metric in json.loads((self.out / "report.json").read_text())["metrics"]}
            self.assertEqual(metrics["false_solutions"], 0 if is_true else 8, roll)
        self.assertIn("roll of the log", (self.out / "report.html").read_text())
        done = starloop("report", self.out, "--roll", "mine", status=2)
        self.assertIn("wanted up, starloop, lost, north, tetra3", done.stderr)

    def test_the_turn_of_axes_is_found_and_its_line_is_pasted(self):
        self.write_turned()
        self.assertEqual(self.fly()["false_solutions"], 8, "control: without its axes")
        printed = starloop("report", self.out, "--find-axes", status=0).stdout.splitlines()
        self.assertIn("8 of 8 solutions agree", printed[0])
        self.assertTrue(printed[1].startswith('axes = "-y -z x" # the nearest map of axes, 20.0 arcsec off'), printed)
        for line, bias in (printed[1], 20.0), (printed[2], 0.0):
            (self.folder / "plan.toml").unlink()
            self.out = self.folder / f"run_{bias:.0f}"
            self.assert_is_the_truth(self.fly(extra=line))
            residual = self.rotational()
            self.assertAlmostEqual(residual, bias, delta=0.1)
        axes = line.split("[")[1].split("]")[0].replace(",", " ")
        self.assertIn("PASSED", starloop("report", self.out, "--axes", axes, status=0).stdout)
        self.assertNotIn("PASSED", starloop("report", self.out, "--axes", "x y z", status=4).stdout)

    def rotational(self):
        """Mean turn about the boresight, arcsec: of the log with the plan's axes, against the truth."""
        log = json.loads((self.out / "plan.json").read_text())["log"]["axes"]
        case = self.out / "lost_in_space"
        found = []
        for frame, row in zip(rows_of(case / "frames.csv"), rows_of(case / "tracker_log.csv")):
            measured = product(log, [float(row[name]) for name in ("q_w", "q_x", "q_y", "q_z")])
            w, *vector = (float(frame[name]) for name in QUATERNION)
            off = product(measured, (w, *(-part for part in vector)))
            found.append(2 * math.copysign(off[3], off[3] * off[0]) * 206264.8)
        return abs(sum(found) / len(found))

    def test_a_turn_that_is_not_constant_is_refused(self):
        self.write_turned(sense="-")
        self.fly()
        done = starloop("report", self.out, "--find-axes", status=1)
        self.assertIn("the turn is not constant: ", done.stderr)
        self.assertIn("write # sense: icrf_from_sensor before the rows", done.stderr)


class Installed(Trackers):
    """The programs themselves."""

    def test_they_solve_frames_in_space(self):
        tetra3rs = python_with(TARGET / "tetra3rs_environment", TETRA3RS, "tetra3rs, numpy")
        for name, python in {"cedar_solve": cedar_python(), "tetra3_rs": tetra3rs}.items():
            with self.subTest(name=name):
                self.out = self.folder / name
                command = [python, *self.adapter(name)[1:]]
                metrics = self.fly(command, camera="star_tracker_20deg")
                self.assertEqual(metrics["false_solutions"], 0)
                self.assertGreaterEqual(metrics["acquisition_probability"], 0.9)
                printed = starloop("report", self.out, "--find-axes", status=0).stdout
                self.assertIn('axes = "x y z" # the nearest map of axes, ', printed)


if __name__ == "__main__":
    unittest.main()
