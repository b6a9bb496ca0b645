"""Tests of `starloop compare`: python3 hil_scripts/tests/test_compare.py

Frames are drawn by `starloop render`, written as TIFF files as a camera writes them, and compared. Where
STARLOOP_REAL_SKY names a folder with four real frames (test_data of the repository esa/tetra3 at commit c8324f4:
2019-07-29T204726_Alt40_Azi-135_Try1.tiff and others), these are compared too, with attitudes that another program
found; their checks are part of tests that run either way.
"""

import json
import math
import os
import struct
import unittest
from pathlib import Path

import numpy
from astropy.io import fits

from support import ROOT, folder_for, starloop

START = "cameras/imx265_35mm.toml"
REAL_SKY = os.environ.get("STARLOOP_REAL_SKY")

# Optics and light of the camera of the drawn frames.
TAKING = """
[distortion]
k1 = 0.1
[psf]
model = "moffat"
fwhm_px = 1.1
beta = 2.4
[illumination]
cos4 = true
window_radius_mm = 13.0
window_distance_mm = 90.0
[background]
uniform_e_per_s = 450.0
gradient = [0.1, 0.4]
quadratic = -0.3
mag_per_arcsec2 = 16.2
"""

# Drawn frames: right ascension, declination, roll, deg.
FIELDS = [(230.667, 11.035, 27.7), (355.205, 58.152, 306.7), (212.211, 64.201, 91.7), (286.435, 28.944, 331.4)]

# Real frames: right ascension, declination and roll of the image's middle by another solver, with the catalog's directions
# (no aberration); its roll counts the other way. It states 6 arcsec rms for a star.
SOLVED = {
    "2019-07-29T204726_Alt40_Azi-135_Try1": (230.667, 11.035, 360 - 332.284),
    "2019-07-29T204726_Alt40_Azi45_Try1": (355.205, 58.152, 360 - 53.304),
    "2019-07-29T204726_Alt60_Azi-45_Try1": (212.211, 64.201, 360 - 268.328),
    "2019-07-29T204726_Alt60_Azi135_Try1": (286.435, 28.944, 360 - 28.635),
}
REAL_TIME = "2019-07-29T20:47:26Z"


def write_tiff(path, pixels):
    """Writes 16-bit grey in one strip, as industrial cameras do."""
    height, width = pixels.shape
    data = pixels.astype("<u2").tobytes()
    entries = [(256, 3, width), (257, 3, height), (258, 3, 16), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1)]
    entries += [(278, 3, height), (279, 4, len(data))]
    directory = struct.pack("<H", len(entries))
    for tag, kind, value in entries:
        directory += struct.pack("<HHI", tag, kind, 1) + struct.pack("<I", value)
    head = struct.pack("<2sHI", b"II", 42, 8 + len(data))
    Path(path).write_bytes(head + data + directory + struct.pack("<I", 0))


def arcsec_apart(one, other):
    (a, d), (b, e) = [[math.radians(of[i]) for i in (0, 1)] for of in (one, other)]
    half = math.sin((d - e) / 2) ** 2 + math.cos(d) * math.cos(e) * math.sin((a - b) / 2) ** 2
    return math.degrees(2 * math.asin(math.sqrt(half))) * 3600


class Compare(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.path = folder_for(cls)
        text = (ROOT / "configs" / START).read_text()
        before, after = text.split("[psf]")
        after = "[radiometry]" + after.split("[radiometry]")[1]
        taking = cls.path / "taking.toml"
        taking.write_text(before.replace("focal_length_mm = 35.0", "focal_length_mm = 35.2") + after + TAKING)
        cls.taking = taking
        cls.frames = []
        for number, (ra, dec, roll) in enumerate(FIELDS):
            drawn = cls.path / f"drawn_{number}.fits"
            done = starloop("render", "--camera", taking, "--ra", ra, "--dec", dec, "--roll", roll, "--time", REAL_TIME, "--seed", number + 1, "--out", drawn)
            assert done.returncode == 0, done.stderr
            frame = cls.path / f"frame_{number}.tiff"
            write_tiff(frame, fits.getdata(drawn).astype("u2") * 16)
            cls.frames.append(frame)

    def compared(self, *arguments):
        done = starloop("compare", *arguments, "--json")
        self.assertIn(done.returncode, (0, 4), done.stderr)
        answer = json.loads(done.stdout)
        self.assertEqual(answer["schema_version"], 1)
        return done.returncode, answer["images"]

    def holds(self, image):
        """The limits of a comparison, checked here by their numbers."""
        self.assertTrue(image["agrees"], image["failures"])
        self.assertGreaterEqual(image["stars"], 10)
        # Limits are by the stars without outliers: their rms may be so much more than that of all.
        fewer = math.sqrt(image["stars"] / (image["stars"] - image["outliers"]))
        for figure, limit, drawn in [
            ("centroid_robust_px", "centroid_limit_px", "drawn_centroid_rms_px"),
            ("mag_robust", "mag_limit", "drawn_mag_rms"),
        ]:
            self.assertLessEqual(image[figure], image[limit])
            self.assertLessEqual(image[limit], math.hypot(0.15, fewer * image[drawn]) + 1e-9)
        self.assertLessEqual(image["unexplained_outliers"], 1 + image["stars"] // 20)
        self.assertEqual(image["outliers"], sum(star["is_outlier"] for star in image["worst_stars"]))
        self.assertLessEqual(abs(image["background_noise_ratio"] - 1), 0.10)
        self.assertLessEqual(abs(image["ensquared_energy_difference"]), 0.03)
        self.assertLessEqual(abs(image["background"]["drawn_mean_dn"] / image["background"]["real_mean_dn"] - 1), 0.05)

    def test_drawn_frames_give_attitude_and_camera_back(self):
        status, images = self.compared(*self.frames, "--camera", START, "--time", REAL_TIME)
        self.assertEqual(status, 0)
        self.assertEqual(len(images), 4)
        for image, field in zip(images, FIELDS):
            self.holds(image)
            self.assertLess(arcsec_apart((image["ra_deg"], image["dec_deg"]), field), 10)
            self.assertLess(abs(image["roll_deg"] - field[2]), 0.01)
            self.assertLess(abs(image["focal_length_mm"][0] - 35.2), 0.01)
        if REAL_SKY:
            self.real_frames_agree_and_have_the_attitudes_of_another_solver()

    def real_frames_agree_and_have_the_attitudes_of_another_solver(self):
        paths = [Path(REAL_SKY) / f"{name}.tiff" for name in SOLVED]
        # As the other solver has them: the catalog's directions, no time.
        _, plain = self.compared(*paths, "--camera", START)
        for image, solved in zip(plain, SOLVED.values()):
            # Its 6 arcsec a star over some tens of stars, the principal point and the distortion that go with it.
            self.assertLess(arcsec_apart((image["ra_deg"], image["dec_deg"]), solved), 15, image["image"])
            self.assertLess(abs(image["roll_deg"] - solved[2]), 0.02, image["image"])
        status, images = self.compared(*paths, "--camera", START, "--ground", "--time", REAL_TIME)
        self.assertEqual(status, 0)
        for image, before in zip(images, plain):
            self.holds(image)
            self.assertLess(image["centroid_rms_px"], before["centroid_rms_px"] + 0.005, "refraction explains something")
        focal = [image["focal_length_mm"][0] for image in images]
        self.assertLess(max(focal) - min(focal), 0.02, "four frames, one lens")
        # Air above sea level bends by 58 arcsec x tan z: at 40 degrees its stretch is four times that at 60.
        low, high = ([image["refraction"]["stretch"] for image in images[i : i + 2]] for i in (0, 2))
        for stretch in low:
            self.assertLess(abs(stretch - 2.0e-4), 0.8e-4)
        for stretch in high:
            self.assertLess(abs(stretch - 0.47e-4), 0.8e-4)

    def test_fitted_camera_is_a_camera_and_report_holds_all(self):
        out = self.path / "out"
        done = starloop("compare", self.frames[3], "--camera", START, "--time", REAL_TIME, "--out", out, status=0)
        self.assertTrue(done.stdout.startswith("AGREES: 1 of 1 images"), done.stdout)
        names = sorted(path.name for path in out.iterdir())
        self.assertEqual(names, ["frame_3.camera.toml", "frame_3.png", "frame_3.stars.csv", "report.html"])
        page = (out / "report.html").read_text()
        for word in ("AGREES", "Radial profile", "SNR in 5 x 5 px", "data:image/png;base64,", "published"):
            self.assertIn(word, page)
        self.assertNotIn("http://", page.replace("http://www.w3.org/", ""), "nothing is fetched")
        rows = (out / "frame_3.stars.csv").read_text().splitlines()
        self.assertGreater(len(rows), 20)
        bench = self.path / "bench.toml"
        bench.write_text(f'camera = "{out / "frame_3.camera.toml"}"\n[timing]\nframe_rate_hz = 2\n')
        starloop("check", bench, status=0)
        # The fitted camera takes the place of the first one.
        starloop("compare", self.frames[3], "--camera", out / "frame_3.camera.toml", "--time", REAL_TIME, "--json", status=0)

    def test_fits_of_other_programs_and_of_data_sets_are_read(self):
        pixels = fits.getdata(self.path / "drawn_3.fits").astype("u2")
        table = fits.BinTableHDU.from_columns([fits.Column(name="A", format="J", array=numpy.arange(5))])
        # Compressed after a table, the first row at the bottom as FITS has it; and one with tiles of 128 x 100 px.
        for name, image, flipped in [
            ("rows.fits.fz", fits.CompImageHDU(pixels[::-1], compression_type="RICE_1"), "rows"),
            ("tiles.fits", fits.CompImageHDU(pixels.astype("i4"), compression_type="RICE_1", tile_shape=(100, 128)), None),
            ("plain.fits", fits.ImageHDU(pixels.astype("i2")), None),
        ]:
            path = self.path / name
            fits.HDUList([fits.PrimaryHDU(), table, image]).writeto(path, overwrite=True)
            status, images = self.compared(path, "--camera", START, "--time", REAL_TIME)
            self.assertEqual((status, images[0]["flipped"]), (0, flipped), name)
            self.assertLess(arcsec_apart((images[0]["ra_deg"], images[0]["dec_deg"]), FIELDS[3]), 10)
        floats = self.path / "floats.fits.fz"
        fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(pixels.astype("f4"))]).writeto(floats, overwrite=True)
        done = starloop("compare", floats, "--camera", START, status=1)
        self.assertIn("funpack", done.stderr)
        self.assertNotIn("damaged", done.stderr)

    def test_shifted_frame_does_not_agree(self):
        ra, dec, roll = FIELDS[1]
        for off, status in ((0.0, 0), (1.5 * 40.4 / 3600, 4)):
            attitude = f"{ra},{dec + off},{roll}"
            got, images = self.compared(self.frames[1], "--camera", START, "--time", REAL_TIME, "--attitude", attitude)
            self.assertEqual(got, status, images[0]["failures"])
        self.assertTrue(any("centroids" in why for why in images[0]["failures"]), images[0]["failures"])

    def test_what_cannot_be_compared_is_refused_in_words(self):
        pixels = fits.getdata(self.path / "drawn_3.fits").astype("u2")
        mirrored, blank = self.path / "mirrored.tiff", self.path / "blank.tiff"
        write_tiff(mirrored, pixels[:, ::-1])
        write_tiff(blank, numpy.full_like(pixels, 200))
        other = self.path / "other.toml"
        other.write_text((ROOT / "configs" / START).read_text().replace("focal_length_mm = 35.0", "focal_length_mm = 25.0"))
        cut = self.path / "cut.tiff"
        cut.write_bytes(self.frames[0].read_bytes()[:100_000])
        for arguments, words in [
            ((mirrored, "--camera", START), "give --flip rows"),
            ((self.frames[3], "--camera", START, "--flip", "rows"), "leave --flip out"),
            ((blank, "--camera", START), "0 stars above the background"),
            ((self.frames[0], "--camera", other), "optics.focal_length_mm"),
            ((self.frames[0], "--camera", "cameras/small_tracker.toml"), "1024 x 768 pixels"),
            ((cut, "--camera", START), "TIFF file is damaged"),
            ((ROOT / "README.md", "--camera", START), "TIFF, PNG or FITS"),
            ((self.path / "none.tiff", "--camera", START), "cannot be read"),
            ((self.frames[0], "--camera", "benches/loopback.toml"), "got a bench"),
        ]:
            done = starloop("compare", *arguments)
            self.assertIn(done.returncode, (1, 2), arguments)
            self.assertIn(words, done.stderr)
            self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)


if __name__ == "__main__":
    unittest.main()
