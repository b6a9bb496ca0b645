"""Tests of `starloop verify --export` with another program: python3 hil_scripts/tests/test_emva.py

PyPI's emva1288 reads the flats and darks of two cameras and finds what their files say: system gain, temporal dark noise,
quantum efficiency, both patterns and saturation. Control: the file of the other camera does not agree.
"""

import math
import tomllib
import unittest

import numpy

if not hasattr(numpy, "asfarray"):
    # emva1288 1.0.2 calls a function that NumPy 2 has no more.
    numpy.asfarray = lambda values: numpy.asarray(values, float)

from emva1288.process import Data1288, LoadImageData, ParseEmvaDescriptorFile, Results1288

from support import ROOT, folder_for, starloop

CAMERAS = ("small_tracker", "cubesat_tracker")
NEAR = 0.01
SATURATION_NEAR = 0.06
"""The saturation is the level with the largest variance, where the pixels with the largest response begin to be full; one level
of fifty is 2.1 %."""
LINEARITY_PERCENT = 1.0
"""A straight response without noise has none; with that of these images emva1288 finds up to 0.7 %."""


def stated(name):
    """Returns what a camera file says, in the words of the standard."""
    camera = tomllib.loads((ROOT / f"configs/cameras/{name}.toml").read_text())
    detector = camera["detector"]
    dark_e = detector["dark_e_per_s"] * camera["exposure"]["exposure_s"]
    full_e = min(detector["full_well_e"], (2 ** detector["bits"] - 1 - detector["black_level_dn"]) * detector["gain_e_per_dn"])
    return {
        "gain, DN/e-": 1.0 / detector["gain_e_per_dn"],
        "temporal dark noise, e-": math.hypot(detector["read_noise_e_rms"], math.sqrt(dark_e)),
        "quantum efficiency": detector["quantum_efficiency"],
        "DSNU, e-": detector["dsnu_e_rms"],
        "PRNU": detector["prnu"],
        "saturation, e-": full_e,
    }


def differences(measured, file):
    """Returns the lines on which they differ."""
    limit = lambda name: SATURATION_NEAR if name.startswith("saturation") else NEAR
    return [
        f"{name}: {measured[name]:.5g} for {wanted:.5g}"
        for name, wanted in file.items()
        if not abs(measured[name] / wanted - 1.0) <= limit(name)
    ]


class Emva(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.measured, cls.results = {}, {}
        for name in CAMERAS:
            out = cls.folder / name
            starloop("verify", ROOT / f"configs/cameras/{name}.toml", "--frames", 2, "--export", out, status=(0, 4))
            described = ParseEmvaDescriptorFile(str(out / "EMVA1288descriptor.txt"))
            found = Results1288(Data1288(LoadImageData(described.images).data).data)
            cls.results[name] = (described, found)
            cls.measured[name] = {
                "gain, DN/e-": found.K,
                "temporal dark noise, e-": found.sigma_d,
                "quantum efficiency": found.QE / 100.0,
                "DSNU, e-": found.DSNU1288,
                "PRNU": found.PRNU1288 / 100.0,
                "saturation, e-": found.u_e_sat,
            }
            print(f"{name}: {cls.measured[name]}; linearity {found.LE_min:.3f} {found.LE_max:.3f} %")

    def test_emva1288_finds_what_the_camera_file_says(self):
        for name in CAMERAS:
            self.assertEqual(differences(self.measured[name], stated(name)), [], name)
            self.assertLess(abs(self.results[name][1].LE_max), LINEARITY_PERCENT)
            self.assertLess(abs(self.results[name][1].LE_min), LINEARITY_PERCENT)

    def test_the_file_of_another_camera_does_not_agree(self):
        for name, other in (CAMERAS, CAMERAS[::-1]):
            off = differences(self.measured[name], stated(other))
            self.assertTrue(any(line.startswith("gain") for line in off), off)
            self.assertTrue(any(line.startswith("temporal dark noise") for line in off), off)
            self.assertTrue(any(line.startswith("PRNU") for line in off), off)

    def test_the_descriptor_says_what_the_images_are(self):
        described, _ = self.results["small_tracker"]
        self.assertEqual(described.version, "4.0")
        self.assertEqual(described.format, {"bits": 12, "width": 512, "height": 512})
        ((exposure_ns, temporal),) = described.images["temporal"].items()
        ((_, spatial),) = described.images["spatial"].items()
        self.assertEqual((exposure_ns, len(temporal), len(spatial)), (1e8, 51, 2))

    def test_a_folder_with_files_is_left_alone(self):
        before = sorted(self.folder.joinpath("small_tracker").iterdir())
        done = starloop("verify", "--export", self.folder / "small_tracker")
        self.assertNotIn(done.returncode, (0, 4))
        self.assertIn("wanted a new folder or an empty one", done.stderr)
        self.assertEqual(sorted(self.folder.joinpath("small_tracker").iterdir()), before)


if __name__ == "__main__":
    unittest.main(verbosity=2)
