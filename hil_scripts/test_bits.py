#!/usr/bin/env python3
"""The shipped benches and scenarios of the subset fly the bits of tests/golden/bits.csv, and a changed file does not."""

import csv
import os
import pathlib
import tempfile
import unittest

import bits

BINARY = os.environ.get("STARLOOP_BINARY", str(bits.ROOT / "target" / "release" / "starloop"))


def wanted():
    """Rows of the golden table by file."""
    with bits.TABLE.open(newline="") as lines:
        return {row["file"]: row for row in csv.DictReader(lines)}


def flown(name):
    """The row that this program makes of a file."""
    with tempfile.TemporaryDirectory() as folder:
        return bits.fly(BINARY, name, pathlib.Path(folder))


class Bits(unittest.TestCase):
    def test_the_subset_flies_the_golden_bits(self):
        table = wanted()
        for name in sorted(bits.SUBSET):
            with self.subTest(name):
                self.assertEqual(flown(name), table[name])

    def test_the_table_has_every_shipped_file(self):
        self.assertEqual(sorted(wanted()), sorted(bits.shipped()))
        self.assertEqual({name for name, row in wanted().items() if row["subset"]}, bits.SUBSET)

    def test_control_another_seed_has_other_bits(self):
        name = "benches/loopback.toml"
        with tempfile.TemporaryDirectory() as folder:
            other = bits.fly(BINARY, name, pathlib.Path(folder), "--seed", "2")
        self.assertNotEqual(other["frames"], wanted()[name]["frames"])
        self.assertNotEqual(other["records"], wanted()[name]["records"])


if __name__ == "__main__":
    unittest.main()
