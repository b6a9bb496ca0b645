"""Basilisk flies a spacecraft on starloop's pixels: python3 hil_scripts/tests/test_basilisk.py

Wants bsk of requirements_interop.txt.
"""

import unittest

from support import BINARY
from starloop import basilisk_loop

#: What a frame states against Basilisk's state at mid-exposure, arcsec.
TRUTH_ARCSEC = 0.03


class BasiliskLoop(unittest.TestCase):
    def test_slew_and_hold_is_flown_on_pixels_and_repeats_bit_for_bit(self):
        report = basilisk_loop.fly(BINARY, 60.0)
        self.assertGreaterEqual(len(report.crc32), 598)
        self.assertGreater(report.solved, 570, "frames with an attitude")
        self.assertLess(max(report.truth_arcsec), TRUTH_ARCSEC)
        begin, end = report.pointing[0][1], report.pointing[-1][1]
        self.assertAlmostEqual(begin / 3600.0, basilisk_loop.SLEW_DEG, delta=0.1, msg="control: it was not there before")
        self.assertLess(end, 60.0, "it holds")
        again = basilisk_loop.fly(BINARY, 60.0)
        self.assertEqual(again.crc32, report.crc32)
        self.assertEqual(again.pointing, report.pointing)
        self.assertGreater(len(set(report.crc32)), 590, "control: frames differ from each other")

    def test_a_conjugated_quaternion_is_noticed(self):
        wrong = basilisk_loop.fly(BINARY, 2.0, sense=-1)
        right = basilisk_loop.fly(BINARY, 2.0)
        self.assertGreater(min(wrong.truth_arcsec), 1e4)
        self.assertLess(max(right.truth_arcsec), TRUTH_ARCSEC)
        self.assertNotEqual(wrong.crc32, right.crc32)


if __name__ == "__main__":
    unittest.main(verbosity=2)
