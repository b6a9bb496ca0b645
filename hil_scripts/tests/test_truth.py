"""Tests of what data sets rely on: seeds of sensor and noise, smear: python3 hil_scripts/tests/test_truth.py"""

import math
import unittest

import numpy
from astropy.io import fits

from support import CAMERA, ROOT, InAFolder, rows_of, starloop, summary_of

# The small tracker in the dark: offsets of 27.5 e- (pattern), and 55 e- of read noise and 19 e- of dark current (noise).
PATTERN = 27.5**2 / (27.5**2 + 55.0**2 + 19.0)


class Seeds(InAFolder):
    def dark(self, *words):
        sources, image = self.folder / "none.csv", self.folder / "dark.fits"
        sources.write_text("x_px,y_px,electrons\n")
        starloop("render", "--camera", CAMERA, "--sources", sources, "--backend", "cpu", *words, "--out", image, status=0)
        with fits.open(image) as file:
            return file[0].data.astype(float), file[0].header

    def test_a_data_set_can_have_many_exposures_of_one_sensor(self):
        first, head = self.dark("--seed", 3)
        self.assertEqual((head["SEED"], head["NOISSEED"], head["FRAME"]), (3, 3, 0))
        same, _ = self.dark("--seed", 3, "--noise-seed", 3, "--frame", 0)
        self.assertTrue((first == same).all(), "one number sets both seeds")
        by_noise, head = self.dark("--seed", 3, "--noise-seed", 4)
        self.assertEqual((head["SEED"], head["NOISSEED"]), (3, 4))
        by_frame, head = self.dark("--seed", 3, "--frame", 9)
        self.assertEqual(head["FRAME"], 9)
        other, _ = self.dark("--seed", 5, "--noise-seed", 4)
        correlation = lambda a, b: numpy.corrcoef(a.ravel(), b.ravel())[0, 1]
        five_sigma = 5 / math.sqrt(first.size)
        for image in (by_noise, by_frame):
            self.assertAlmostEqual(correlation(first, image), PATTERN, delta=five_sigma)
        self.assertAlmostEqual(correlation(by_noise, by_frame), PATTERN, delta=five_sigma)
        self.assertAlmostEqual(correlation(first, other), 0.0, delta=five_sigma)

    def test_a_run_records_both_seeds(self):
        bench = self.written("bench.toml", f'camera = "{CAMERA}"\nseed = 3\nnoise_seed = 11\n[timing]\nframe_rate_hz = 10.0\n')
        found = {}
        for name, words in {"bench": [], "words": ["--seed", 4, "--noise-seed", 12], "one": ["--noise-seed", 3]}.items():
            out = self.folder / name
            starloop("run", bench, "--quiet", "--clock", "virtual", "--backend", "cpu", "--duration", 0.3, *words, "--out", out, status=0)
            summary, rows = summary_of(out), rows_of(out)
            head = fits.getheader(out / "frame_000001.fits")
            self.assertEqual((head["SEED"], head["NOISSEED"]), (summary["seed"], summary["noise_seed"]))
            self.assertEqual((int(rows[1]["seed"]), int(rows[1]["noise_seed"])), (summary["seed"], summary["noise_seed"]))
            found[name] = summary["seed"], summary["noise_seed"], summary["run_crc32"]
        self.assertEqual([found[name][:2] for name in ("bench", "words", "one")], [(3, 11), (4, 12), (3, 3)])
        self.assertEqual(len({crc for *_, crc in found.values()}), 3, "the seeds are used")


class Smear(InAFolder):
    def test_every_star_has_the_length_of_its_path(self):
        camera, truth = ROOT / "configs/cameras/star_tracker_20deg.toml", self.folder / "truth.csv"
        words = ["render", "--camera", camera, "--ra", 83.8, "--dec", -1.2, "--backend", "cpu", "--truth", truth]
        rate_deg_s, exposure_s, focal_px = numpy.array([1.0, -4.0, 2.0]), 0.1, 52.26 / 0.018
        starloop(*words, "--rate", ",".join(map(str, rate_deg_s)), "--out", self.folder / "a.fits", status=0)
        rows = [row for row in rows_of(truth) if row["kind"] == "star"]
        self.assertGreater(len(rows), 200)
        # Each star's mean place turned back and forth with the sensor and projected, step by step.
        mean = numpy.array([[float(row["x_px"]), float(row["y_px"])] for row in rows]) - 511.5
        direction = numpy.concatenate([mean / focal_px, numpy.ones((len(mean), 1))], axis=1)
        direction /= numpy.linalg.norm(direction, axis=1)[:, None]
        vector = -numpy.radians(rate_deg_s)
        speed = numpy.linalg.norm(vector)
        axis, places = vector / speed, []
        for t_s in numpy.linspace(-0.5, 0.5, 201) * exposure_s:
            sin, cos = math.sin(speed * t_s), math.cos(speed * t_s)
            turned = direction * cos + numpy.cross(axis, direction) * sin + axis * (direction @ axis)[:, None] * (1 - cos)
            places.append(focal_px * turned[:, :2] / turned[:, 2:])
        places = numpy.array(places)
        length = numpy.linalg.norm(numpy.diff(places, axis=0), axis=2).sum(axis=0)
        angle = numpy.degrees(numpy.arctan2(*(places[-1] - places[0]).T[::-1]))
        reported = numpy.array([[float(row["smear_px"]), float(row["smear_deg"])] for row in rows])
        self.assertGreater(length.max() / length.min(), 1.2, "control: the roll makes them differ")
        self.assertLess(numpy.abs(reported[:, 0] / length - 1).max(), 2e-3)
        self.assertLess(numpy.abs((reported[:, 1] - angle + 180) % 360 - 180).max(), 0.3)
        starloop(*words, "--out", self.folder / "b.fits", status=0)
        still = rows_of(truth)
        self.assertEqual({float(row["smear_px"]) for row in still}, {0.0})


if __name__ == "__main__":
    unittest.main(verbosity=2)
