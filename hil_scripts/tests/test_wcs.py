"""Tests of the WCS in FITS headers with astropy: python3 hil_scripts/tests/test_wcs.py

astropy puts the catalog place of every truth star where the truth has its pixel, in frames of three cameras (one
distorted), binned, windowed, at a pole, rendered and recorded. Nothing moves in them: the WCS is that of mid-exposure.
"""

import unittest
import warnings

import numpy
from astropy.io import fits
from astropy.time import Time
from astropy.wcs import WCS

from support import ROOT, folder_for, rows_of, starloop

CAMERAS = ROOT / "configs/cameras"
WCS_PX = 0.02
BINNED = ("star_tracker_20deg", "[detector.binning]\nfactor = 2\nkind = \"digital-sum\"\n")
WINDOWED = ("cubesat_tracker", "[detector.window]\nleft_px = 1200\ntop_px = 100\nwidth_px = 640\nheight_px = 480\n")
# Camera (and lines added to its file), right ascension, declination, roll, time.
SKY = [
    ("star_tracker_20deg", "", 83.8, -1.2, 0.0, "2026-03-01T00:00:00Z"),
    ("star_tracker_20deg", "", 210.0, 89.99, 77.0, "2026-09-15T06:00:00Z"),
    ("star_tracker_20deg", "", 359.99, 40.0, 271.0, "2034-06-01T00:00:00Z"),
    (*BINNED, 83.8, -1.2, 120.0, "2026-03-01T00:00:00Z"),
    ("cubesat_tracker", "", 84.05, -1.2, 33.0, "2026-03-01T00:00:00Z"),
    ("cubesat_tracker", "", 0.0, -90.0, 0.0, "2026-12-01T00:00:00Z"),
    (*WINDOWED, 266.4, -29.0, 200.0, "2026-03-01T00:00:00Z"),
]
BENCH = f"""
name = "wcs"
camera = "{CAMERAS / 'small_tracker.toml'}"
[timing]
frame_rate_hz = 10.0
start_utc = "2026-03-01T00:00:00Z"
[flight_computer]
ra_deg = 82.05
dec_deg = -1.2
"""


class Frame:
    """A FITS file with its truth table."""

    def __init__(self, image, truth):
        with warnings.catch_warnings():
            # A wrong checksum is a warning of astropy's; here it is an error.
            warnings.simplefilter("error")
            with fits.open(image, checksum=True) as file:
                file.verify("exception")
                self.header, shape = file[0].header.copy(), file[0].data.shape
            self.wcs = WCS(self.header)
        rows = rows_of(truth)
        column = lambda name: numpy.array([float(row[name]) for row in rows])
        self.px = numpy.stack([column("x_px"), column("y_px")], -1)
        self.catalog = numpy.stack([column("catalog_ra_deg"), column("catalog_dec_deg")], -1)
        self.apparent = numpy.stack([column("apparent_ra_deg"), column("apparent_dec_deg")], -1)
        inside = (self.px >= -0.5) & (self.px <= numpy.array(shape[::-1]) - 0.5)
        self.inside = inside.all(axis=1)

    def worst_px(self, places=None, wcs=None):
        places = self.catalog if places is None else places
        found = (wcs or self.wcs).all_world2pix(places[self.inside], 0, tolerance=1e-6, maxiter=50)
        return numpy.linalg.norm(found - self.px[self.inside], axis=1).max()


class Wcs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.frames = []
        for number, (camera, lines, ra, dec, roll, time) in enumerate(SKY):
            path = cls.folder / f"{number}.toml"
            path.write_text((CAMERAS / f"{camera}.toml").read_text() + lines)
            image, truth = cls.folder / f"{number}.fits", cls.folder / f"{number}.csv"
            words = ["--camera", path, "--ra", ra, "--dec", dec, "--roll", roll, "--time", time, "--backend", "cpu"]
            starloop("render", *words, "--truth", truth, "--out", image, status=0)
            cls.frames.append(Frame(image, truth))
        bench, run = cls.folder / "bench.toml", cls.folder / "run"
        bench.write_text(BENCH)
        starloop("run", bench, "--quiet", "--clock", "virtual", "--backend", "cpu", "--duration", 0.6, "--out", run, status=0)
        images = sorted(run.glob("frame_*.fits"))[-3:]
        cls.recorded = [Frame(image, image.with_name(image.name.replace(".fits", ".truth.csv"))) for image in images]

    def test_every_star_is_where_astropy_puts_its_catalog_place(self):
        frames = self.frames + self.recorded
        self.assertEqual(len(frames), 10)
        stars = 0
        for frame in frames:
            with self.subTest(camera=frame.header["INSTRUME"], dec=frame.header["DEC_DEG"]):
                self.assertGreater(frame.inside.sum(), 5, "control: there are stars")
                worst = frame.worst_px()
                print(f"{frame.header['INSTRUME']}: {frame.inside.sum()} stars, {worst:.5f} px, "
                      f"WCSERR {frame.header['WCSERR']:.5f}, {frame.header['CTYPE1']}")
                self.assertLess(worst, WCS_PX)
                self.assertLess(frame.header["WCSERR"], WCS_PX)
                stars += frame.inside.sum()
        self.assertGreater(stars, 1000)
        self.assertEqual(len({frame.header["INSTRUME"] for frame in frames}), 3)

    def test_the_comparison_can_fail(self):
        for frame in self.frames + self.recorded:
            self.assertGreater(frame.worst_px(frame.apparent), WCS_PX, "aberration is in the map")
        distorted = self.frames[4]
        self.assertEqual(distorted.header["CTYPE1"], "RA---TAN-SIP")
        self.assertEqual(self.frames[0].header["CTYPE1"], "RA---TAN", "a lens that does not distort needs no polynomial")
        straight = distorted.header.copy()
        for name in [name for name in straight if name.split("_")[0] in ("A", "B", "AP", "BP") and "_" in name]:
            del straight[name]
        straight["CTYPE1"], straight["CTYPE2"] = "RA---TAN", "DEC--TAN"
        self.assertGreater(distorted.worst_px(wcs=WCS(straight)), 20 * WCS_PX, "without SIP")

    def test_the_polynomials_back_agree_with_those_to_the_sky(self):
        frames = [frame for frame in self.frames if frame.wcs.sip is not None]
        self.assertEqual(len(frames), 3, "the distorted camera's")
        for frame in frames:
            # By AP and BP alone, as viewers do: the linear part of the map, then the polynomials.
            crpix, sip = frame.wcs.wcs.crpix, frame.wcs.sip
            u, v = (frame.wcs.wcs_world2pix(frame.catalog[frame.inside], 1) - crpix).T
            bent = [numpy.polynomial.polynomial.polyval2d(u, v, terms) for terms in (sip.ap, sip.bp)]
            off = lambda x, y: numpy.linalg.norm(numpy.stack([x, y], -1) + crpix - 1 - frame.px[frame.inside], axis=1).max()
            self.assertLess(off(u + bent[0], v + bent[1]), WCS_PX)
            self.assertGreater(off(u, v), 2 * WCS_PX, "control: without them")

    def test_the_words_that_other_programs_look_for_are_there(self):
        head = self.frames[3].header
        self.assertEqual((head["XBINNING"], head["XPIXSZ"], head["YPIXSZ"]), (2, 36.0, 36.0))
        self.assertAlmostEqual(head["FOCALLEN"], 52.26)
        self.assertEqual((head["RADESYS"], head["ROWORDER"]), ("ICRS", "TOP-DOWN"))
        self.assertGreater(head["SATURATE"], 0)
        self.assertGreater(head["RDNOISE"], 0)
        begin, middle, end = (Time(head[f"DATE-{name}"], scale="utc") for name in ("BEG", "AVG", "END"))
        self.assertAlmostEqual((end - begin).to_value("s"), head["EXPTIME"], delta=2e-6)
        self.assertAlmostEqual((middle - begin).to_value("s"), head["EXPTIME"] / 2, delta=2e-6)
        # The scale of a pixel follows from pitch and focal length.
        scale = numpy.degrees(head["XPIXSZ"] * 1e-3 / head["FOCALLEN"])
        self.assertAlmostEqual(numpy.sqrt(abs(numpy.linalg.det(self.frames[3].wcs.wcs.cd))) / scale, 1.0, delta=3e-4)

    def test_damage_is_seen_by_the_checksums(self):
        whole = self.folder / "0.fits"
        spoiled = self.folder / "spoiled.fits"
        for at in (-3000, 300):
            data = bytearray(whole.read_bytes())
            data[at] ^= 1
            spoiled.write_bytes(data)
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                with fits.open(spoiled, checksum=True) as file:
                    _ = file[0].data
            self.assertTrue(any("verification failed" in str(warning.message) for warning in caught), at)


if __name__ == "__main__":
    unittest.main(verbosity=2)
