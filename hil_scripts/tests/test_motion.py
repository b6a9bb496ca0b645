"""Tests of scripted motions and of jitter from files, by formulas of their own: python3 hil_scripts/tests/test_motion.py"""

import math
import shutil
import unittest

import numpy

from support import ARCSEC, CAMERA, InAFolder, rows_of, starloop

# Single precision on the wire, time tags in microseconds, and interpolation between messages 10 ms apart.
ATTITUDE_ARCSEC = 0.1
# Half of the exposure of the small tracker is found in the run itself.
BENCH = """camera = "{camera}"
[timing]
frame_rate_hz = 10.0
duration_s = {duration_s}
start_utc = "2026-03-01T00:00:00Z"
[flight_computer]
{pointing}
[sink]
kind = "recorder"
fits = false
png_every = 0
"""


def turned(matrix, vector):
    """The attitude after a turn of the body by a rotation vector: rows are the axes of the body."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return matrix
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / angle
    return (numpy.eye(3) - math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross) @ matrix


def pointing(ra_deg, dec_deg, roll_deg):
    ra, dec, roll = (math.radians(value) for value in (ra_deg, dec_deg, roll_deg))
    boresight = numpy.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    north = numpy.array([-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec)])
    east = numpy.array([-math.sin(ra), math.cos(ra), 0.0])
    down = -(math.cos(roll) * north + math.sin(roll) * east)
    return numpy.array([numpy.cross(down, boresight), down, boresight])


def matrix_of(row):
    w, x, y, z = (float(row[name]) for name in ("qw", "qx", "qy", "qz"))
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def angle_arcsec(a, b):
    off = a @ b.T
    return math.sqrt(sum((off[i][j] - off[j][i]) ** 2 for i, j in ((0, 1), (0, 2), (1, 2)))) / 2 / ARCSEC


class Moving(InAFolder):
    def fly(self, text, at="ra_deg = 83.0\ndec_deg = -1.0\nroll_deg = 20.0", duration_s=3.0):
        """Rows of the frames with their times after the first exposure began."""
        bench = self.written("bench.toml", BENCH.format(camera=CAMERA, pointing=at, duration_s=duration_s) + text)
        shutil.rmtree(self.out, ignore_errors=True)
        starloop("run", bench, "--quiet", "--clock", "virtual", "--backend", "cpu", "--out", self.out, status=0)
        rows = rows_of(self.out)
        first = int(rows[0]["mid_exposure_tai_ns"]) - 0.5e9 * float(rows[0]["exposure_s"])
        self.assertEqual(len(rows), round(10 * duration_s))
        return [((int(row["mid_exposure_tai_ns"]) - first) * 1e-9, row) for row in rows]

    def largest_arcsec(self, frames, attitude):
        return max(angle_arcsec(matrix_of(row), attitude(t)) for t, row in frames)


class Motions(Moving):
    START = pointing(83.0, -1.0, 20.0)

    def test_a_constant_rate_goes_on_from_before_the_run(self):
        rate = numpy.array([0.2, -0.5, 1.5])
        frames = self.fly(f'[flight_computer.motion]\nkind = "constant_rate"\nrate_deg_s = {rate.tolist()}\n')
        wanted = lambda t: turned(self.START, numpy.radians(rate) * t)
        self.assertLess(self.largest_arcsec(frames, wanted), ATTITUDE_ARCSEC)
        self.assertGreater(self.largest_arcsec(frames, lambda t: wanted(-t)), 1000, "negative control")
        for _, row in frames:
            for axis, value in zip("xyz", rate):
                self.assertAlmostEqual(float(row[f"rate_{axis}_deg_s"]), value, delta=1e-4)

    def test_sinusoids_are_turns_one_after_another(self):
        swing = "[[flight_computer.motion.sinusoid]]\naxis = {}\namplitude_deg = {}\nfrequency_hz = {}\nphase_deg = {}\n"
        frames = self.fly('[flight_computer.motion]\nkind = "sinusoidal"\nrate_deg_s = [0.0, 0.0, 0.3]\n'
                          + swing.format("[2.0, 0.0, 0.0]", 1.5, 0.4, 30.0) + swing.format("[0.0, 1.0, 0.0]", 0.5, 1.0, 0.0))

        def wanted(t, order=1):
            turns = [(numpy.array([0, 0, math.radians(0.3) * t])),
                     numpy.array([math.radians(1.5) * math.sin(2 * math.pi * 0.4 * t + math.pi / 6), 0, 0]),
                     numpy.array([0, math.radians(0.5) * math.sin(2 * math.pi * t), 0])]
            matrix = self.START
            for turn in turns[::order]:
                matrix = turned(matrix, turn)
            return matrix

        self.assertLess(self.largest_arcsec(frames, wanted), ATTITUDE_ARCSEC)
        self.assertGreater(self.largest_arcsec(frames, lambda t: wanted(t, -1)), 1.0, "negative control: the order counts")

    WAYPOINTS = [(-1.0, 83.0, -1.0, 20.0), (1.0, 85.0, 0.5, 25.0), (2.5, 85.0, 2.0, 10.0)]

    def waypoints(self, mode):
        row = "[[flight_computer.motion.waypoint]]\nt_s = {}\nra_deg = {}\ndec_deg = {}\nroll_deg = {}\n"
        rows = "".join(row.format(*waypoint) for waypoint in self.WAYPOINTS)
        return self.fly(f'[flight_computer.motion]\nkind = "waypoints"\nat_waypoints = "{mode}"\n' + rows, at="")

    def test_stops_are_turns_of_least_jerk(self):
        def wanted(t):
            places = [(time, pointing(*angles)) for time, *angles in self.WAYPOINTS]
            for (t0, a), (t1, b) in zip(places, places[1:]):
                if t <= t1:
                    off = b @ a.T
                    axis = numpy.array([off[1][2] - off[2][1], off[2][0] - off[0][2], off[0][1] - off[1][0]])
                    angle = math.atan2(numpy.linalg.norm(axis) / 2, (numpy.trace(off) - 1) / 2)
                    s = (t - t0) / (t1 - t0)
                    return turned(a, axis / numpy.linalg.norm(axis) * angle * (10 * s**3 - 15 * s**4 + 6 * s**5))
            return places[-1][1]

        frames = self.waypoints("stop")
        self.assertLess(self.largest_arcsec(frames, wanted), ATTITUDE_ARCSEC)
        self.assertGreater(abs(float(frames[0][1]["rate_y_deg_s"])), 0.1, "the run begins in motion")

    def test_passing_goes_through_the_waypoint_and_does_not_stop_there(self):
        for mode, moves in (("pass", True), ("stop", False)):
            frames = self.waypoints(mode)
            (t, row), = [(t, row) for t, row in frames if abs(t - 1.0) < 0.06][:1]
            rate = math.hypot(*(float(row[f"rate_{axis}_deg_s"]) for axis in "xyz"))
            self.assertEqual(rate > 0.3, moves, f"{mode}: {rate} deg/s at {t} s")
            self.assertLess(angle_arcsec(matrix_of(frames[-1][1]), pointing(*self.WAYPOINTS[-1][1:])), ATTITUDE_ARCSEC)

    def test_check_states_the_largest_rate(self):
        bench = self.folder / "bench.toml"
        motion = '[flight_computer.motion]\nkind = "constant_rate"\nrate_deg_s = [0.0, 3.0, 4.0]\n'
        bench.write_text(BENCH.format(camera=CAMERA, pointing="", duration_s=1.0) + motion)
        self.assertIn("at most 5.000 deg/s", starloop("check", bench, status=0).stdout)


class Jitter(Moving):
    def write(self, seconds):
        rows = [f"{i / 2000:.4f},{30 * math.sin(2 * math.pi * 100 * i / 2000):.5f},0" for i in range(round(2000 * seconds))]
        (self.folder / "shaker.csv").write_text("t_s,x_arcsec,y_arcsec\n" + "\n".join(rows) + "\n")

    def test_a_record_that_ends_is_an_event_and_one_that_repeats_is_none(self):
        self.write(1.0)
        for word, lacks in (("still", True), ("repeat", False)):
            limit = "[expect]\njitter_missing_frames_at_most = 10\n" if lacks else ""
            frames = self.fly(f'[jitter]\nseries = "shaker.csv"\nat_end = "{word}"\n{limit}', duration_s=2.0)
            missing = [t for t, row in frames if int(row["jitter_missing_ns"]) > 0]
            self.assertEqual(bool(missing), lacks, word)
            self.assertTrue(all(t > 0.9 for t in missing), missing)

    def test_jitter_widens_images_and_the_same_seed_repeats_them(self):
        self.write(3.0)
        jitter = '[jitter]\nseries = "shaker.csv"\n'
        checksums = [[row["pixel_crc32"] for _, row in self.fly(text, duration_s=0.5)] for text in (jitter, jitter, "")]
        self.assertEqual(checksums[0], checksums[1])
        self.assertNotEqual(checksums[0], checksums[2], "negative control")

    def test_check_shows_power_in_bands_and_refuses_a_short_record(self):
        self.write(4.0)
        bench = self.folder / "bench.toml"
        head = BENCH.format(camera=CAMERA, pointing="", duration_s=3.0)
        bench.write_text(head + '[jitter]\nseries = "shaker.csv"\n')
        section = starloop("check", bench, status=0).stdout.partition("jitter from shaker.csv")[2].split("\n\n")[0]
        rows = {line.split("  ")[1]: line.split() for line in section.splitlines() if line.startswith("  ")}
        whole = float(rows["all"][-3])
        self.assertAlmostEqual(whole, 30 / math.sqrt(2), delta=0.05)
        self.assertLess(float(rows["below 10 Hz"][-3]), 0.5)
        self.write(2.0)
        done = starloop("check", bench)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("at_end", done.stderr)

    def test_a_density_is_a_series_of_its_seed(self):
        (self.folder / "psd.csv").write_text("frequency_hz,x_arcsec2_hz,y_arcsec2_hz\n1,40,10\n100,4,1\n1000,0.1,0.1\n")
        density = '[jitter]\ndensity = "psd.csv"\n'
        first, again = (self.fly(density, duration_s=0.3) for _ in range(2))
        self.assertEqual([row["pixel_crc32"] for _, row in first], [row["pixel_crc32"] for _, row in again])


if __name__ == "__main__":
    unittest.main()
