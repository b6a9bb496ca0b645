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


def started(test, model, unzipped, out, **parameters):
    """An instance between steps, with an output folder and other boolean parameters; it goes with the test."""
    references = {variable.name: variable.valueReference for variable in model.modelVariables}
    slave = FMU3Slave(
        instanceName="one",
        guid=model.instantiationToken,
        unzipDirectory=unzipped,
        modelIdentifier=model.coSimulation.modelIdentifier,
    )
    slave.instantiate()
    test.addCleanup(slave.freeInstance)
    slave.setString([references["output_dir"]], [str(out)])
    for name, value in parameters.items():
        slave.setBoolean([references[name]], [value])
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    return slave


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
        cls.model = read_model_description(str(cls.fmu))
        cls.references = {variable.name: variable.valueReference for variable in cls.model.modelVariables}
        cls.unzipped = extract(str(cls.fmu))

    def start(self, out, **parameters):
        return started(self, self.model, self.unzipped, out, **parameters)

    def fly(self, out, attitude_at, steps=100, **parameters):
        """Flies steps of a slew; returns what the outputs said of each new frame: time, truth, stars."""
        slave, seen = self.start(out, **parameters), []
        get = lambda name, count: list(slave.getFloat64([self.references[name]], nValues=count))
        slave.setFloat64([self.references["rate"]], [0.0, 0.0, math.radians(RATE_DEG_S)])
        frames = 0
        for step in range(steps):
            slave.setFloat64([self.references["q_body_from_icrf"]], attitude_at(step * STEP_S))
            slave.doStep(step * STEP_S, STEP_S)
            counter = slave.getUInt64([self.references["frame_counter"]])[0]
            if counter > frames:
                frames = counter
                stars = slave.getInt32([self.references["star_count"]])[0]
                seen.append((get("mid_exposure", 1)[0], get("true_q_sensor_from_icrf", 4), stars))
        self.assertEqual(slave.getUInt64([self.references["refused_samples"]])[0], 0)
        slave.terminate()
        return seen

    def worst_arcsec(self, seen):
        """The largest angle between what frames were drawn from and the formula of the slew."""
        self.assertGreater(len(seen), 10)
        return max(angle_rad(q, slew(t_s)) for t_s, q, _ in seen) / ARCSEC

    def fly2(self, out, attitude_at, steps=100):
        """Flies steps of a slew with the unit of FMI 2; returns what `fly` returns."""
        model = read_model_description(str(self.fmu2))
        names = {variable.name: variable.valueReference for variable in model.modelVariables}
        of = lambda name, count: [names[f"{name}[{place + 1}]"] for place in range(count)]
        slave = FMU2Slave(
            instanceName="two",
            guid=model.guid,
            unzipDirectory=extract(str(self.fmu2)),
            modelIdentifier=model.coSimulation.modelIdentifier,
        )
        slave.instantiate()
        self.addCleanup(slave.freeInstance)
        slave.setupExperiment(startTime=0.0)
        slave.setString([names["output_dir"]], [str(out)])
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        seen, frames = [], 0
        slave.setReal(of("rate", 3), [0.0, 0.0, math.radians(RATE_DEG_S)])
        for step in range(steps):
            slave.setReal(of("q_body_from_icrf", 4), attitude_at(step * STEP_S))
            slave.doStep(step * STEP_S, STEP_S)
            counter = slave.getInteger([names["frame_counter"]])[0]
            if counter > frames:
                frames = counter
                stars = slave.getInteger([names["star_count"]])[0]
                seen.append((slave.getReal([names["mid_exposure"]])[0], slave.getReal(of("true_q_sensor_from_icrf", 4)), stars))
        self.assertEqual(slave.getInteger([names["refused_samples"]]), [0])
        with self.assertRaises(Exception):
            slave.getFMUState()
        slave.terminate()
        return seen

    def test_the_units_are_valid(self):
        self.assertEqual(validate_fmu(str(self.fmu)), [])
        self.assertEqual(validate_fmu(str(self.fmu2)), [])
        self.assertEqual((self.model.fmiVersion, read_model_description(str(self.fmu2)).fmiVersion), ("3.0", "2.0"))

    def test_both_versions_say_and_draw_the_same(self):
        def images(name):
            return [zlib.crc32(path.read_bytes()[-131072:]) for path in sorted((self.here / name).rglob("*.fits"))]

        three, two = self.fly(self.here / "three", slew), self.fly2(self.here / "two", slew)
        self.assertEqual(three, two)
        self.assertLess(self.worst_arcsec(two), 1e-6)
        self.assertEqual(images("three"), images("two"))
        self.assertGreater(len(images("two")), 10)
        other = self.fly2(self.here / "another two", lambda t_s: slew(1.01 * t_s))
        self.assertNotEqual(three, other, "control: another slew")

    def test_fmpy_simulates_the_unit_of_fmi_2(self):
        out = self.here / "simulated two"
        attitude = {f"q_body_from_icrf[{place}]": value for place, value in enumerate(slew(0.0), 1)}
        result = simulate_fmu(
            str(self.fmu2),
            start_values={"output_dir": str(out), **attitude},
            stop_time=1.0,
            step_size=0.1,
            output_interval=0.1,
            output=["frame_counter", "star_count", "true_jitter[1]"],
        )
        self.assertGreaterEqual(result["frame_counter"][-1], 8)
        self.assertGreater(result["star_count"][-1], 5)
        self.assertEqual(result["true_jitter[1]"][-1], 0.0)
        self.assertTrue(list(out.rglob("*.fits")))

    def test_the_end_of_the_program_is_an_error_and_nothing_is_left_running(self):
        before = children()
        slave = self.start(self.here / "killed")
        slave.setFloat64([self.references["q_body_from_icrf"]], slew(0.0))
        slave.doStep(0.0, STEP_S)
        (started,) = children() - before
        os.kill(started, signal.SIGKILL)
        with self.assertRaises(Exception):
            slave.doStep(STEP_S, STEP_S)
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
        def checksums(name, rate=1.0):
            self.fly(self.here / name, lambda t_s: slew(rate * t_s))
            files = sorted((self.here / name).rglob("*.fits"))
            self.assertGreater(len(files), 10)
            return [zlib.crc32(path.read_bytes()[-131072:]) for path in files]

        self.assertEqual(checksums("once"), checksums("again"))
        self.assertNotEqual(checksums("once more"), checksums("another slew", 1.01))

    def test_impossible_values_are_errors_not_crashes(self):
        slave = self.start(self.here / "errors")
        with self.assertRaises(Exception):
            slave.getFMUState()
        with self.assertRaises(Exception):
            slave.getFloat64([9999])
        slave.setFloat64([self.references["q_body_from_icrf"]], [1.0, 1.0, 0.0, 0.0])
        with self.assertRaises(Exception):
            slave.doStep(0.0, STEP_S)
        slave.setFloat64([self.references["q_body_from_icrf"]], slew(0.0))
        with self.assertRaises(Exception):
            slave.doStep(5.0, STEP_S)
        slave.doStep(0.0, STEP_S)
        with self.assertRaises(Exception):
            self.start(self.here / "errors")

    def test_fmpy_simulates_it(self):
        out = self.here / "simulated"
        result = simulate_fmu(
            str(self.fmu),
            start_values={"output_dir": str(out), "q_body_from_icrf": slew(0.0)},
            stop_time=1.0,
            step_size=0.1,
            output_interval=0.1,
            output=["frame_counter", "star_count"],
        )
        self.assertGreaterEqual(result["frame_counter"][-1], 8)
        self.assertGreater(result["star_count"][-1], 5)
        self.assertTrue(list(out.rglob("*.fits")))

    def jittered(self, name, more, **inputs):
        """Flies a unit of the bench with further lines; returns checksums of its images, and the last jitter it drew."""
        (self.here / f"{name}.toml").write_text(BENCH + more)
        unit, out = self.here / f"{name}.fmu", self.here / f"frames of {name}"
        said = starloop("fmu", self.here / f"{name}.toml", "--out", unit, status=0).stdout
        result = simulate_fmu(
            str(unit),
            start_values={"output_dir": str(out), "q_body_from_icrf": slew(0.0), **inputs},
            stop_time=1.0,
            step_size=0.1,
            output_interval=0.1,
            output=["frame_counter", "true_jitter"],
        )
        files = sorted(out.rglob("*.fits"))
        self.assertGreater(len(files), 5)
        return [zlib.crc32(path.read_bytes()[-131072:]) for path in files], list(result["true_jitter"][-1]), said

    def test_an_importer_that_sets_no_jitter_gets_none(self):
        lines = "[[flight_computer.jitter_line]]\nfrequency_hz = 0.8\namplitude_arcsec = [400.0, 300.0, 600.0]\nphase_deg = 20.0\n"
        images, jitter, said = self.jittered("jitter", lines)
        self.assertIn("lines of the simulated flight computer are left out (1)", said)
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
        result = simulate_fmu(
            str(unit),
            start_values={"output_dir": str(self.here / "three"), "q_body_from_icrf": slew(0.0)},
            stop_time=1.0,
            step_size=0.1,
            output_interval=0.1,
            output=outputs,
        )
        for head, mounting in enumerate(heads):
            self.assertGreaterEqual(result[f"head_{head}_frame_counter"][-1], 8)
            wxyz = list(result[f"head_{head}_true_q_sensor_from_icrf"][-1])
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
