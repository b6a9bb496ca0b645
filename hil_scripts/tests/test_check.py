"""Tests of the verdict of `starloop check`: python3 hil_scripts/tests/test_check.py

A bench with any warning is not called sound, each warning names a number and its limit, and `--strict` ends with 4;
every shipped bench is sound, except those in the list below, with the warnings that it names.
"""

import contextlib
import json
import tempfile
import unittest
from pathlib import Path

from support import ROOT, starloop

EXIT_NOT_MET = 4

# Warnings of shipped files are about bright discs, a fast target, a telescope that wants layers of stars.
SHIPPED_WARNINGS = {
    "earth_limb": ["over the accuracy budget"],
    "moon": ["over the accuracy budget"],
    "telescope": ["the catalog ends at G = 8.5", "the attitude records alone are wrong by up to 0.0246 arcsec"],
}
# Its layers of stars are not shipped.
NOT_CHECKED = {"galactic_slew"}

CAMERA = {
    "width_px": 512,
    "height_px": 512,
    "pixel_pitch_um": 5.3,
    "quantum_efficiency": 0.5,
    "focal_length_mm": 16.0,
    "aperture_mm": 11.43,
    "exposure_s": 0.05,
    "limiting_mag": '"auto"',
}
DETECTOR = ("width_px", "height_px", "pixel_pitch_um", "quantum_efficiency")


def camera(**changed):
    keys = {**CAMERA, **changed}
    line = lambda names: "".join(f"{name} = {keys[name]}\n" for name in names)  # noqa: E731
    return (
        f"[detector]\n{line(DETECTOR)}[optics]\n{line(('focal_length_mm', 'aperture_mm'))}"
        f"[exposure]\n{line(('exposure_s',))}[radiometry]\n{line(('limiting_mag',))}"
    )


@contextlib.contextmanager
def folder_of(files):
    """A folder with these files."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        yield folder


def checked(files, *words, **options):
    """Returns the report on bench.toml beside other files."""
    with folder_of(files) as folder:
        return starloop("check", "bench.toml", "--built-in-costs", *words, cwd=folder, **options)


def with_camera(bench="", **changed):
    return {"bench.toml": f'camera = "cam.toml"\n{bench}', "cam.toml": camera(**changed)}


def rows(step_s, seconds):
    count = round(seconds / step_s)
    return "t_s,q_w,q_x,q_y,q_z\n" + "".join(f"{step_s * i:.3f},1,0,0,0\n" for i in range(count + 1))


PLANT = '[plant]\nkind = "file"\nattitude = "a.csv"\n'

# A mistake, the files with it, and texts of its warning.
WARNED = [
    ("an aperture of a pinhole", with_camera(aperture_mm=0.11), ["aperture_mm is 0.11", "0.3 to 40000 mm"]),
    ("a pinhole for a millisecond: no star is seen", with_camera(aperture_mm=0.11, exposure_s=1e-5), ["sees no star", "brightest star has G = -1.5"]),
    ("an exposure in the wrong unit", with_camera(exposure_s=5e-8), ["exposure_s is 0.00000005", "0.000001 to 3600 s"]),
    ("an efficiency of a hundredth of a percent", with_camera(quantum_efficiency=0.0001), ["quantum_efficiency is 0.0001"]),
    ("a limit brighter than what the camera sees", with_camera(limiting_mag=5.0), ["limiting_mag is 5.00", "left out"]),
    ("a camera that sees beyond the catalog", with_camera(exposure_s=0.09, aperture_mm=30.0), ["the catalog ends at G = 8.5"]),
    ("a field without stars", with_camera(focal_length_mm=16000.0, aperture_mm=1000.0), ["no star is in the field of frame 0"]),
    (
        "attitudes that end before the run",
        {"bench.toml": PLANT, "a.csv": rows(0.1, 5.0)},
        ["frames begin or end before or after the rows of the file", "the body rests"],
    ),
    (
        "attitudes that end, and nothing after them",
        {"bench.toml": PLANT + 'outside = "none"\n', "a.csv": rows(0.1, 5.0)},
        ["frames begin or end where the file has no attitude"],
    ),
]


class Verdict(unittest.TestCase):
    def test_a_bench_with_a_warning_is_not_sound(self):
        for name, files, parts in WARNED:
            with self.subTest(name):
                done = checked(files)
                first = done.stdout.splitlines()[0] if done.stdout else done.stderr
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertRegex(first, r"^WARNING: bench \"bench\": \d+ warnings?$")
                self.assertNotIn("is sound", done.stdout)
                for part in parts:
                    self.assertIn(part, done.stdout)

    def test_the_repaired_bench_is_sound(self):
        for files in (with_camera(), {"bench.toml": PLANT, "a.csv": rows(0.1, 12.0)}):
            done = checked(files, "--strict")
            self.assertEqual(done.stdout.splitlines()[0], 'bench "bench" is sound', done.stdout[:400])
            self.assertEqual(done.returncode, 0)
        ends = {"bench.toml": PLANT + 'outside = "rest"\n', "a.csv": rows(0.1, 5.0)}
        self.assertEqual(checked(ends, "--strict").returncode, 0, "rest after the end is stated")

    def test_strict_has_a_status_and_json_has_the_same_warnings(self):
        files = with_camera(limiting_mag=5.0)
        self.assertEqual(checked(files, "--strict").returncode, EXIT_NOT_MET)
        done = checked(files, "--strict", "--json", status=EXIT_NOT_MET)
        numbered = [line.split(". ", 1)[1] for line in checked(files).stdout.splitlines()[1:] if line.startswith("  1. ")]
        self.assertEqual(json.loads(done.stdout)["warnings"], numbered)

    def test_impossible_numbers_are_refused(self):
        for key, value in (("pixel_pitch_um", 0.0053), ("focal_length_mm", 0.016), ("quantum_efficiency", 55)):
            done = checked(with_camera(**{key: value}), status=1)
            self.assertIn(f"{key} is {value}", done.stderr)

    def test_a_run_repeats_the_warnings_in_one_line(self):
        with folder_of(with_camera(limiting_mag=5.0, aperture_mm=40.0)) as folder:
            words = ("run", "bench.toml", "--clock", "virtual", "--duration", "0.5", "--sink", "null")
            lines = [line for line in starloop(*words, cwd=folder).stderr.splitlines() if "WARNING" in line]
            self.assertEqual(len(lines), 1, lines)
            for part in ('WARNING: bench "bench": ', "limiting_mag is 5.00", "focal length / aperture is 0.4"):
                self.assertIn(part, lines[0])
            quiet = starloop(*words, "--quiet", cwd=folder)
            self.assertNotIn("WARNING", quiet.stderr)


class Shipped(unittest.TestCase):
    def test_shipped_files_are_sound_or_their_warnings_are_known(self):
        files = sorted((ROOT / "configs/benches").glob("*.toml")) + sorted((ROOT / "configs/scenarios").glob("*.toml"))
        self.assertGreater(len(files), 30)
        for file in files:
            if file.stem in NOT_CHECKED:
                continue
            with self.subTest(file.stem):
                done = starloop("check", file, "--built-in-costs", "--json", cwd=ROOT, status=0)
                warnings = json.loads(done.stdout)["warnings"]
                known = SHIPPED_WARNINGS.get(file.stem, [])
                unknown = [words for words in warnings if not any(part in words for part in known)]
                self.assertEqual(unknown, [])
                for part in known:
                    self.assertTrue(any(part in words for words in warnings), f"no longer warned of: {part}")


class Magnitude(unittest.TestCase):
    def test_auto_is_stated_and_bounded(self):
        with folder_of(with_camera()) as folder:
            seen = starloop("check", "bench.toml", "--json", cwd=folder)
            drawn = json.loads(seen.stdout)["camera"]["limiting_mag_g"]
            snr = json.loads(starloop("snr", "cam.toml", "--json", cwd=folder).stdout)
            limit = next(row["mag_g"] for row in snr["limits"] if row["snr"] == 3.0)
            self.assertAlmostEqual(snr["drawn_to_mag_g"], drawn, places=9)
            self.assertTrue(limit + 0.5 <= drawn <= limit + 0.6, f"{limit} {drawn}")
            words = ("render", "--camera", "cam.toml", "--ra", "83.8", "--dec", "-1.2", "--out", "a.fits")
            self.assertIn(f"drawn down to G = {drawn}", starloop(*words, cwd=folder).stderr)
            (Path(folder) / "cam.toml").write_text(camera(exposure_s=0.09, aperture_mm=30.0))
            seen = starloop("check", "bench.toml", "--json", cwd=folder)
            self.assertEqual(json.loads(seen.stdout)["camera"]["limiting_mag_g"], 8.5, "the end of the catalog")


if __name__ == "__main__":
    unittest.main()
