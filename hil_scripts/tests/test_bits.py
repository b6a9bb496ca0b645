#!/usr/bin/env python3
"""The shipped benches and scenarios of the subset fly the bits of tests/golden/bits.csv, and a changed file does not.

Vector levels that fuse draw the same bits.
"""

import os
import tempfile
import unittest
from pathlib import Path

from support import BINARY, ran
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

    def test_vector_levels_with_fused_additions_draw_the_same_bits(self):
        def drawn(level):
            environment = {**os.environ, "STARLOOP_VECTOR_LEVEL": level}
            with tempfile.TemporaryDirectory() as name:
                out = Path(name) / "image.fits"
                field = ["--camera", "cameras/star_tracker_20deg.toml", "--ra", "83.8", "--dec", "-1.2"]
                words = ["render", *field, "--backend", "cpu", "--stage", "electrons", "--timing", "--out", out]
                done = ran(BINARY, *words, env=environment, status=0)
                return out.read_bytes(), done.stdout, done.stderr

        usual, said, _ = drawn("V4")
        lower, said_lower, refused = drawn("V3")
        self.assertEqual(usual, lower)
        self.assertRegex(said, "vector level V[34]|Neon|Scalar")
        if not refused:
            self.assertIn("vector level V3", said_lower)
            self.assertNotEqual(usual, drawn("Scalar")[0], "control: products that are rounded first")
        self.assertIn("STARLOOP_VECTOR_LEVEL: got V9, wanted one of Scalar", drawn("V9")[2])


if __name__ == "__main__":
    unittest.main()
