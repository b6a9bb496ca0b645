#!/usr/bin/env python3
"""The shipped benches and scenarios of the subset fly the bits of tests/golden/bits.csv, and a changed file does not."""

import unittest

from support import BINARY
import bits


class Bits(unittest.TestCase):
    def test_the_subset_flies_the_golden_bits(self):
        table = bits.golden()
        for name in sorted(bits.SUBSET):
            with self.subTest(name):
                self.assertEqual(bits.fly(BINARY, name), table[name])

    def test_the_table_has_every_shipped_file(self):
        self.assertEqual(sorted(bits.golden()), sorted(bits.shipped()))
        self.assertEqual({name for name, row in bits.golden().items() if row["subset"]}, bits.SUBSET)

    def test_control_another_seed_has_other_bits(self):
        name = "benches/loopback.toml"
        other = bits.fly(BINARY, name, "--seed", "2")
        self.assertNotEqual(other["frames"], bits.golden()[name]["frames"])
        self.assertNotEqual(other["records"], bits.golden()[name]["records"])


if __name__ == "__main__":
    unittest.main()
