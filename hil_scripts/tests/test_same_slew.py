"""One slew through every interface on the virtual clock: python3 hil_scripts/tests/test_same_slew.py

The control socket in lockstep, a co-simulation unit under FMPy, an AEM file and the rows of a table draw the same slew.
Lockstep and unit get the same samples in double precision: their attitudes differ by rounding. The files go over the
simulated bus in single precision: their frames show the slew to the accuracy of the wire. UDP, TCP and the lines of 42
need the real clock: test_plain_links.py. Needs fmpy.
"""

import math
import unittest

from support import ARCSEC, BINARY, CAMERA, InAFolder, about_y, rows_of, starloop
from starloop.client import Starloop, attitude_sample
from test_fmu import Driven

BENCH = """
name = "slew"
camera = "{camera}"
seed = 7
[timing]
frame_rate_hz = 10
duration_s = 2
start_utc = "2026-03-01T12:00:00Z"
{rest}
"""
RATE = math.radians(0.5)
STEP_S, COUNT = 0.02, 100
#: Four numbers of single precision and a time tag in microseconds, with a slew of 0.5 deg/s.
WIRE_ARCSEC = 0.05


def slew(t_s):
    """The attitude at a time: a turn about the body's y axis, passive, w x y z; and the rate."""
    return about_y(RATE * t_s), [0.0, RATE, 0.0]


def off_arcsec(wxyz, t_s, rate=1.0):
    """The angle between an attitude and the slew at a time."""
    wanted, _ = slew(rate * t_s)
    near = min(math.dist(wxyz, [sign * part for part in wanted]) for sign in (1.0, -1.0))
    return 2.0 * near / ARCSEC


class SameSlew(InAFolder):
    def bench(self, rest):
        return self.written("bench.toml", BENCH.format(camera=CAMERA, rest=rest))

    def frames(self, folder):
        """Number, pixels' checksum, attitude and seconds after the first exposure of each recorded frame."""
        return {int(row["frame"]): row for row in rows_of(next(folder.rglob("frames.csv")))}

    def lockstep(self, rate=1.0):
        """Frames in lockstep: number to checksum, attitude and time."""
        seen = {}
        with Starloop.start(BINARY, self.bench('[plant]\nkind = "outside"\n')) as loop:
            for k in range(COUNT):
                wxyz, turn = slew(rate * k * STEP_S)
                loop.attitude([attitude_sample(round(k * STEP_S, 9), wxyz, turn)])
                loop.step(until_s=round((k + 1) * STEP_S - 1e-9, 12))
                if loop.state()["frames"]["delivered"]:
                    facts = loop.frame_facts()
                    seen[facts["number"]] = (facts["crc32"], facts["meta"]["attitude_wxyz"], facts["mid_exposure_s"])
            loop.finish()
        return seen

    def unit(self):
        """Frames of a co-simulation unit: number to attitude and time; their pixels are in the folder."""
        fmu, out, seen = self.folder / "slew.fmu", self.folder / "unit", {}
        starloop("fmu", self.bench('[sink]\nkind = "recorder"\n'), "--out", fmu, status=0)
        unit = Driven(self, fmu, out)
        for k in range(COUNT):
            wxyz, rate = slew(k * STEP_S)
            unit.set("q_body_from_icrf", wxyz)
            unit.set("rate", rate)
            unit.slave.doStep(k * STEP_S, STEP_S)
            (frames,) = unit.get("frame_counter")
            if frames:
                seen[frames - 1] = (unit.get("true_q_sensor_from_icrf"), *unit.get("mid_exposure"))
        unit.slave.terminate()
        return seen, out

    def test_lockstep_and_unit_draw_the_same_attitudes(self):
        lockstep, (unit, out) = self.lockstep(), self.unit()
        recorded = self.frames(out)
        both = sorted(set(lockstep) & set(unit))
        self.assertGreater(len(both), 15)
        for number in both:
            _, wxyz, mid_s = lockstep[number]
            self.assertAlmostEqual(mid_s, unit[number][1], 9)
            self.assertLess(2.0 * math.dist(wxyz, unit[number][0]) / ARCSEC, 1e-9, f"frame {number}: rounding only")
            self.assertLess(off_arcsec(wxyz, mid_s), 1e-6, f"frame {number}")
            self.assertEqual(len(recorded[number]["pixel_crc32"]), 8)
        faster = self.lockstep(rate=1.001)
        self.assertTrue(all(faster[number][0] != lockstep[number][0] for number in both[1:]), "control: another slew")

    def test_files_show_the_slew_to_the_accuracy_of_the_wire(self):
        rows = [(k * STEP_S, *slew(k * STEP_S)[0]) for k in range(-5, COUNT + 5)]
        lines = ["t_s,q_w,q_x,q_y,q_z"] + [",".join(f"{value:.15g}" for value in row) for row in rows]
        (self.folder / "slew.csv").write_text("\n".join(lines) + "\n")
        bench = self.bench('[plant]\nkind = "file"\nattitude = "slew.csv"\n')
        starloop("run", bench, "--clock", "virtual", "--out", self.folder / "from_table", status=0)
        starloop("export", self.folder / "from_table", "--attitude", self.folder / "slew.aem", status=0)
        # The file begins in the middle of the first exposure and ends in that of the last one.
        limits = "[expect]\nblank_frames_at_start_at_most = 1\nblank_frames_at_most = 1\nheld_attitude_frames_at_most = 1\n"
        bench = self.bench(f'[plant]\nkind = "file"\nattitude = "slew.aem"\n{limits}')
        starloop("run", bench, "--clock", "virtual", "--out", self.folder / "from_aem", status=0)
        for name in ("from_table", "from_aem"):
            frames = self.frames(self.folder / name)
            # An AEM of what was rendered begins with the middle of the first exposure.
            inner = [row for number, row in frames.items() if 1 <= number <= 18]
            self.assertGreater(len(inner), 15)
            first = self.frames(self.folder / "from_table")[0]
            for row in inner:
                wxyz = [float(row[f"q{axis}"]) for axis in "wxyz"]
                since_s = (int(row["mid_exposure_tai_ns"]) - int(first["mid_exposure_tai_ns"])) * 1e-9
                mid_s = since_s + self.half_exposure_s(first)
                self.assertLess(off_arcsec(wxyz, mid_s), 2 * WIRE_ARCSEC, name)
                self.assertGreater(off_arcsec(wxyz, mid_s, rate=1.01), 2 * WIRE_ARCSEC, "control: another slew")

    def half_exposure_s(self, row):
        return 0.5 * float(row["exposure_s"])


if __name__ == "__main__":
    unittest.main()
