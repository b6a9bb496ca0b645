"""Tests of `starloop fmu` with FMPy: python3 hil_scripts/tests/test_fmu.py

A unit is validated and simulated by another program. Its frames show the attitudes that were set, compared with the formula
of a slew written here; two runs give the same bits; a conjugated quaternion does not. STARLOOP_BINARY names the program
(default target/release/starloop), beside which libstarloop_fmu_library.so lies. Needs fmpy and numpy.
"""

import csv
import math
import unittest
import zlib

from fmpy import extract, read_model_description, simulate_fmu
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


class Unit(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.here = folder_for(cls)
        (cls.here / "camera.toml").write_text(CAMERA)
        (cls.here / "bench.toml").write_text(BENCH)
        cls.fmu = cls.here / "bench.fmu"
        starloop("fmu", cls.here / "bench.toml", "--out", cls.fmu, status=0)
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

    def test_the_unit_is_valid(self):
        self.assertEqual(validate_fmu(str(self.fmu)), [])

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

    def test_jitter_of_the_run_files_flight_computer_is_left_out(self):
        lines = "[[flight_computer.jitter_line]]\nfrequency_hz = 0.8\namplitude_arcsec = [400.0, 300.0, 600.0]\nphase_deg = 20.0\n"

        def images(name, more):
            (self.here / f"{name}.toml").write_text(BENCH + more)
            unit, out = self.here / f"{name}.fmu", self.here / f"frames of {name}"
            starloop("fmu", self.here / f"{name}.toml", "--out", unit, status=0)
            attitude = {"output_dir": str(out), "q_body_from_icrf": slew(0.0)}
            simulate_fmu(str(unit), start_values=attitude, stop_time=1.0, step_size=0.1, output_interval=0.1, output=["frame_counter"])
            files = sorted(out.rglob("*.fits"))
            self.assertGreater(len(files), 5)
            return [zlib.crc32(path.read_bytes()[-131072:]) for path in files]

        self.assertEqual(images("jitter", lines), images("rest", ""))

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
