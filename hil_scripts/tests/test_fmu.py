"""Tests of `starloop fmu` with FMPy: python3 hil_scripts/tests/test_fmu.py

A unit of FMI 3 and one of FMI 2 are validated and simulated by another program. Their frames show the attitudes that were
set, compared with the formula of a slew written here; two runs give the same bits, also in the other version; a conjugated
quaternion does not. STARLOOP_BINARY names the program (default target/release/starloop). Needs fmpy and numpy.
"""

import csv
import math
import os
import signal
import unittest
import zlib
from itertools import count, takewhile

from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.model_description import ValidationError
from fmpy.validation import validate_fmu

from support import ARCSEC, ROOT, folder_for, product, starloop

CAMERA = """
[detector]
width_px = 256
height_px = 256
[optics]
focal_length_mm = 25
"""
BENCH = """
name = "unit"
camera = "camera.toml"
seed = 3
[timing]
frame_rate_hz = 10
duration_s = 2
start_utc = "2026-03-01T12:00:00Z"
[link]
kind = "simulated"
wire = "can_fd"
[sink]
kind = "recorder"
"""
RATE_DEG_S = 1.0
STEP_S = 0.02


def about_z(angle_rad):
    """The attitude of a body that has turned by an angle about its z axis: passive, w x y z."""
    return [math.cos(angle_rad / 2), 0.0, 0.0, -math.sin(angle_rad / 2)]


def angle_rad(a, b):
    """The angle between two attitudes."""
    off = product(a, [b[0], -b[1], -b[2], -b[3]])
    return 2 * math.asin(min(1.0, math.hypot(*off[1:])))


class Driven:
    """An instance between steps, with an output folder, whose variables have names; it goes with the test."""

    def __init__(self, test, unit, out):
        model = read_model_description(str(unit))
        self.is_3 = model.fmiVersion == "3.0"
        self.variables = {variable.name: variable for variable in model.modelVariables}
        kind, token = (FMU3Slave, model.instantiationToken) if self.is_3 else (FMU2Slave, model.guid)
        name = model.coSimulation.modelIdentifier
        self.slave = kind(instanceName="one", guid=token, unzipDirectory=extract(str(unit)), modelIdentifier=name)
        self.slave.instantiate()
        test.addCleanup(self.slave.freeInstance)
        self.slave.setString([self.variables["output_dir"].valueReference], [str(out)])
        if not self.is_3:
            self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def of(self, name):
        """The type of a variable, and references: one of FMI 3, those of all its numbers of FMI 2."""
        elements = [name] if name in self.variables else (f"{name}[{number}]" for number in count(1))
        known = [self.variables[element] for element in takewhile(self.variables.__contains__, elements)]
        return known[0].type, [variable.valueReference for variable in known]

    def set(self, name, values):
        kind, references = self.of(name)
        getattr(self.slave, f"set{kind}")(references, values)

    def get(self, name):
        """The values of a variable, as a list."""
        kind, references = self.of(name)
        how_many = {"nValues": math.prod(int(size.start) for size in self.variables[name].dimensions)} if self.is_3 else {}
        return list(getattr(self.slave, f"get{kind}")(references, **how_many))

    def step(self, number):
        self.slave.doStep(number * STEP_S, STEP_S)


def children():
    """The programs that this process has started and that still run."""
    return {int(pid) for pid in open(f"/proc/self/task/{os.getpid()}/children").read().split()}


class Unit(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.here = folder_for(cls)
        (cls.here / "camera.toml").write_text(CAMERA)
        (cls.here / "bench.toml").write_text(BENCH)
        cls.fmu = cls.here / "bench.fmu"
        starloop("fmu", cls.here / "bench.toml", "--out", cls.fmu, status=0)
        cls.fmu2 = cls.here / "bench of FMI 2.fmu"
        starloop("fmu", cls.here / "bench.toml", "--fmi", 2, "--out", cls.fmu2, status=0)

    def start(self, out, unit=None):
        return Driven(self, unit or self.fmu, out)

    def fly(self, out, attitude_at, steps=100, unit=None):
        """Flies steps of a slew; returns what the outputs said of each new frame: time, truth, stars."""
        driven, seen, frames = self.start(out, unit), [], 0
        driven.set("rate", [0.0, 0.0, math.radians(RATE_DEG_S)])
        for step in range(steps):
            driven.set("q_body_from_icrf", attitude_at(step * STEP_S))
            driven.step(step)
            (counter,) = driven.get("frame_counter")
            if counter > frames:
                frames = counter
                seen.append((*driven.get("mid_exposure"), driven.get("true_q_sensor_from_icrf"), *driven.get("star_count")))
        self.assertEqual(driven.get("refused_samples"), [0])
        driven.slave.terminate()
        return seen

    def worst_arcsec(self, seen):
        """The largest angle between what frames were drawn from and the formula of the slew."""
        self.assertGreater(len(seen), 10)
        return max(angle_rad(q, slew(t_s)) for t_s, q, _ in seen) / ARCSEC

    def images(self, folder):
        """Checksums of the pixels below a folder."""
        files = sorted((self.here / folder).rglob("*.fits"))
        self.assertGreater(len(files), 5)
        return [zlib.crc32(path.read_bytes()[-131072:]) for path in files]

    def simulated(self, unit, folder, outputs, **inputs):
        """The outputs of a unit after a second that FMPy simulates by itself."""
        inputs["output_dir"] = str(self.here / folder)
        times = {"stop_time": 1.0, "step_size": 0.1, "output_interval": 0.1}
        return simulate_fmu(str(unit), start_values=inputs, output=outputs, **times)[-1]

    def test_the_units_are_valid(self):
        for unit, version in [(self.fmu, "3.0"), (self.fmu2, "2.0")]:
            self.assertEqual(validate_fmu(str(unit)), [])
            self.assertEqual(read_model_description(str(unit)).fmiVersion, version)

    def test_both_versions_say_and_draw_the_same(self):
        three, two = self.fly(self.here / "three", slew), self.fly(self.here / "two", slew, unit=self.fmu2)
        self.assertEqual(three, two)
        self.assertEqual(self.images("three"), self.images("two"))
        other = self.fly(self.here / "another two", lambda t_s: slew(1.01 * t_s), unit=self.fmu2)
        self.assertNotEqual(three, other, "control: another slew")
        self.assertNotEqual(self.images("three"), self.images("another two"), "control: another slew")

    def test_fmpy_simulates_both_units(self):
        elements = {f"q_body_from_icrf[{place}]": value for place, value in enumerate(slew(0.0), 1)}
        for unit, attitude in [(self.fmu, {"q_body_from_icrf": slew(0.0)}), (self.fmu2, elements)]:
            result = self.simulated(unit, f"simulated {unit.name}", ["frame_counter", "star_count"], **attitude)
            self.assertGreaterEqual(result["frame_counter"], 8)
            self.assertGreater(result["star_count"], 5)
            self.assertGreater(len(self.images(f"simulated {unit.name}")), 7)

    def test_the_end_of_the_program_is_an_error_and_nothing_is_left_running(self):
        before = children()
        driven = self.start(self.here / "killed")
        driven.set("q_body_from_icrf", slew(0.0))
        driven.step(0)
        (started,) = children() - before
        os.kill(started, signal.SIGKILL)
        with self.assertRaises(Exception):
            driven.step(1)
        self.doCleanups()
        self.assertEqual(children(), before)

    def test_a_damaged_unit_is_not_valid(self):
        import shutil
        import zipfile

        bad = self.here / "bad.fmu"
        with zipfile.ZipFile(self.fmu) as good, zipfile.ZipFile(bad, "w") as out:
            for name in good.namelist():
                data = good.read(name)
                if name == "modelDescription.xml":
                    data = data.replace(b'<Output valueReference="20"/>', b"")
                out.writestr(name, data)
        with self.assertRaises(ValidationError):
            read_model_description(str(bad))
            raise_if = validate_fmu(str(bad))
            if raise_if:
                raise ValidationError(raise_if)
        shutil.rmtree(bad, ignore_errors=True)

    def test_frames_show_the_slew_that_was_set(self):
        seen = self.fly(self.here / "slew", slew)
        self.assertLess(self.worst_arcsec(seen), 1e-6)
        self.assertTrue(all(stars > 5 for _, _, stars in seen))
        with open(next((self.here / "slew").rglob("frames.csv"))) as table:
            rows = list(csv.DictReader(table))
        self.assertGreaterEqual(len(rows), len(seen))

    def test_a_conjugated_attitude_shows_another_sky(self):
        conjugated = self.fly(self.here / "wrong", lambda t_s: [c * s for c, s in zip(slew(t_s), (1, -1, -1, -1))])
        self.assertGreater(self.worst_arcsec(conjugated), 1000)

    def test_outputs_are_those_of_the_end_of_the_step(self):
        seen = self.fly(self.here / "prompt", slew, steps=50)
        # The tenth frame of a second is on its way at its end.
        self.assertGreaterEqual(len(seen), 9)
        self.assertTrue(all(later[0] - earlier[0] < 0.1 + 1e-6 for earlier, later in zip(seen, seen[1:])))

    def test_two_runs_have_the_same_bits(self):
        def images(name, rate=1.0):
            self.fly(self.here / name, lambda t_s: slew(rate * t_s))
            return self.images(name)

        self.assertEqual(images("once"), images("again"))
        self.assertNotEqual(images("once more"), images("another slew", 1.01))

    def test_impossible_values_are_errors_not_crashes(self):
        for unit in (self.fmu, self.fmu2):
            out = self.here / f"errors of {unit.name}"
            driven = self.start(out, unit)
            with self.assertRaises(Exception):
                driven.slave.getFMUState()
            with self.assertRaises(Exception):
                (driven.slave.getFloat64 if driven.is_3 else driven.slave.getReal)([9999])
            driven.set("q_body_from_icrf", [1.0, 1.0, 0.0, 0.0])
            with self.assertRaises(Exception):
                driven.step(0)
            driven.set("q_body_from_icrf", slew(0.0))
            with self.assertRaises(Exception):
                driven.step(250)
            driven.step(0)
            with self.assertRaises(Exception):
                self.start(out, unit)

    def jittered(self, name, more, **inputs):
        """Flies a unit of the bench with further lines; returns checksums of its images, the last jitter, what was printed."""
        (self.here / f"{name}.toml").write_text(BENCH + more)
        unit = self.here / f"{name}.fmu"
        said = starloop("fmu", self.here / f"{name}.toml", "--out", unit, status=0).stdout
        result = self.simulated(unit, f"frames of {name}", ["true_jitter"], q_body_from_icrf=slew(0.0), **inputs)
        return self.images(f"frames of {name}"), list(result["true_jitter"]), said

    def test_an_importer_that_sets_no_jitter_gets_none(self):
        lines = "[[flight_computer.jitter_line]]\nfrequency_hz = 0.8\namplitude_arcsec = [400.0, 300.0, 600.0]\nphase_deg = 20.0\n"
        images, jitter, said = self.jittered("jitter", lines)
        self.assertIn("jitter lines of the simulated flight computer: 1 left out", said)
        still, none, quiet = self.jittered("rest", "")
        self.assertEqual((images, jitter, none), (still, [0.0] * 3, [0.0] * 3))
        self.assertNotIn("jitter", quiet)

    def test_jitter_that_is_asked_for_is_drawn_and_reported(self):
        still, _, _ = self.jittered("no jitter", "")
        images, jitter, _ = self.jittered("set", "", jitter=[0.0, 2e-4, 0.0])
        self.assertNotEqual(images, still)
        self.assertLess(math.dist(jitter, [0.0, 2e-4, 0.0]), 1e-12)
        rows = "".join(f"{0.1 * k:.1f},41.253,0\n" for k in range(60))
        (self.here / "series.csv").write_text("t_s,x_arcsec,y_arcsec\n" + rows)
        images, jitter, said = self.jittered("file", '[jitter]\nseries = "series.csv"\nstart_s = -1.0\n')
        self.assertNotEqual(images, still)
        self.assertLess(math.dist(jitter, [41.253 * ARCSEC, 0.0, 0.0]), 1e-9)
        self.assertIn("series.csv of [jitter] is added", said)

    def test_a_unit_of_three_heads_has_the_outputs_of_each(self):
        heads = [[1.0, 0.0, 0.0, 0.0], [math.cos(0.4), math.sin(0.4), 0.0, 0.0], [math.cos(0.4), 0.0, math.sin(0.4), 0.0]]
        text = BENCH + "".join(f"[[head]]\nsensor_from_body = {head}\n" for head in heads)
        (self.here / "three.toml").write_text(text)
        unit = self.here / "three.fmu"
        starloop("fmu", self.here / "three.toml", "--out", unit, status=0)
        outputs = [f"head_{head}_{what}" for head in range(3) for what in ("frame_counter", "true_q_sensor_from_icrf")]
        result = self.simulated(unit, "three heads", outputs, q_body_from_icrf=slew(0.0))
        for head, mounting in enumerate(heads):
            self.assertGreaterEqual(result[f"head_{head}_frame_counter"], 8)
            wxyz = list(result[f"head_{head}_true_q_sensor_from_icrf"])
            self.assertLess(angle_rad(wxyz, product(mounting, slew(0.0))), 0.01 * ARCSEC)
            self.assertGreater(angle_rad(wxyz, product(heads[head - 1], slew(0.0))), 0.1, "control: another head's")

    def test_a_flight_inside_is_refused_in_one_sentence(self):
        done = starloop("fmu", ROOT / "configs/scenarios/slew_and_settle.toml", "--out", self.here / "no.fmu", status=1)
        self.assertIn("wanted plant.kind", done.stderr)
        self.assertFalse((self.here / "no.fmu").exists())


def slew(t_s):
    """The slew: a turn about the boresight from a field near Orion."""
    ra, dec = math.radians(83.0), math.radians(-2.0)
    # Sensor +Z to the boresight: a turn about ICRF z, then about the new y.
    to_meridian = [math.cos(ra / 2), 0.0, 0.0, -math.sin(ra / 2)]
    tilt = math.pi / 2 - dec
    to_boresight = [math.cos(tilt / 2), 0.0, -math.sin(tilt / 2), 0.0]
    return list(product(about_z(math.radians(RATE_DEG_S) * t_s), product(to_boresight, to_meridian)))


if __name__ == "__main__":
    unittest.main()
