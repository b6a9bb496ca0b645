"""The benchmark beside other programs: a quick run, with the peers that this Python has, and its controls."""

import csv
import dataclasses
import os
import pathlib
import subprocess
import sys
import unittest

import numpy as np

import support
import bench_peers
import peers
import peers_contest
import peers_loop
import peers_report

SCRIPT = pathlib.Path(bench_peers.__file__)


class QuickRun(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.out = support.folder_for(cls)
        # Slow peers are left out after a second.
        command = [sys.executable, SCRIPT, "--quick", "--limit-s", "1", "--out", cls.out]
        cls.done = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
        with open(cls.out / "peers.csv", newline="") as file:
            cls.rows = list(csv.DictReader(file))

    def test_every_cell_has_a_time_or_a_reason(self):
        self.assertEqual(self.done.returncode, 0, self.done.stdout + self.done.stderr)
        ours = {row["program"] for row in self.rows if row["program"].startswith("starloop")}
        self.assertEqual(len(self.rows), 3 * (len(ours) + len(peers_contest.PROGRAMS)))
        for row in self.rows:
            self.assertNotEqual(bool(row["ms"]), bool(row["reason"]), row)
        measured = {row["program"] for row in self.rows if row["ms"]}
        self.assertLessEqual({"starloop", "numpy", "C loop"}, measured)
        print(f"peers measured here: {sorted(measured)}")

    def test_what_installs_the_peers_needs_none_of_them(self):
        # -S: no packages but Python's own.
        for script, status in [(SCRIPT, 0), (peers_contest.__file__, 1)]:
            done = subprocess.run([sys.executable, "-S", script, "--help"], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, status, done.stderr)

    def test_errors_are_those_of_single_precision_for_starloop(self):
        for row in self.rows:
            if row["program"] == "starloop":
                self.assertLess(float(row["l1"]), 1e-4, row)
                self.assertGreater(float(row["l1"]), 0.0, "the reference is not compared with itself")

    def test_table_and_chart_have_all_programs(self):
        table, chart = ((self.out / name).read_text() for name in ("peers.md", "peers.svg"))
        for peer in peers_contest.PROGRAMS:
            self.assertIn(f"| {peer.name} ", table)
            self.assertIn(f">{peer.name}<", chart)


class Checks(unittest.TestCase):
    """Same scene or not, without starloop."""

    def setUp(self):
        self.scene = peers_contest.made_up(50, 256, 4)
        self.image = peers.Numpy().prepare(self.scene)()

    def test_a_star_that_is_off_and_a_loss_of_flux_are_found(self):
        self.assertEqual(peers_contest.differs(self.image, self.image), "")
        shifted = peers.Numpy().prepare(self.scene.shifted())()
        self.assertIn("of the brightest one off", peers_contest.differs(shifted, self.image))
        self.assertGreater(peers_contest.l1(shifted, self.image), 1e-3)
        self.assertIn("of the flux", peers_contest.differs(0.98 * self.image, self.image))

    def test_noise_that_is_not_the_chain_s_is_found(self):
        numbers = peers.Numpy().noise(self.scene)(self.image)
        self.assertEqual(peers_contest.noise_differs(numbers, self.image, self.scene), "")
        quieter = peers.Numpy().noise(dataclasses.replace(self.scene, read_noise_e=8.0))(self.image)
        self.assertIn("variance", peers_contest.noise_differs(quieter, self.image, self.scene))
        self.assertIn("dark pixels", peers_contest.noise_differs(numbers + np.uint16(2), self.image, self.scene))

    def test_a_peer_that_is_faster_is_named(self):
        row = peers_contest.Row
        rows = [row("s", "starloop", 2.0, 1e-6), row("s", "other", 1.0, 1e-7), row("s", "rough", 1.0, 1e-3)]
        self.assertEqual(peers_report.behind(rows), ["s (other)"])
        self.assertEqual(len(peers_report.faster(rows)), 2)
        self.assertEqual(peers_report.behind(rows[::2]), [])
        bound = [row("s", "starloop", 2.0, 1e-6), row("s", "C loop", 1.0, 1e-7)]
        self.assertEqual((peers_report.behind(bound), peers_report.faster(bound)), ([], []), "a bound does not count as a peer")
        self.assertIn("| s | 2 | - | 0.5 | - | - |", peers_report.ratios(bound))
        both = [row("s", "starloop", 1.0, 1e-6), row("s", "starloop V3", 3.0, 1e-6), row("s", "numba", 2.0, 1e-6)]
        self.assertEqual(peers_report.behind(both), ["s (numba than starloop V3)"], "at each vector level")

    def test_the_loop_in_c_draws_what_numpy_draws(self):
        loop = peers_loop.CLoop()
        still = [peers_contest.made_up(200, 100, 1, decades=4.0), peers_contest.made_up(3000, 256, 1)]
        for scene in [*still, peers_contest.made_up(300, 64, 5), self.scene]:
            image, wanted = loop.prepare(scene)(), peers.Numpy().prepare(scene)()
            self.assertLess(peers_contest.l1(image, wanted), 1e-5, scene.name)
        for kind in (peers_loop.Avx2, peers_loop.Avx512):
            try:
                bound = kind()
            except peers.Cannot as reason:
                self.assertRegex(str(reason), "lacks|x86-64")
                continue
            for one in still:
                drawn, of_numpy = bound.prepare(one)(), peers.Numpy().prepare(one)()
                self.assertLess(peers_contest.l1(drawn, of_numpy), 1e-5, f"{kind.name}, {one.name}")
            dark = peers_contest.made_up(20, 256, 1)
            drawn, of_numpy = bound.prepare(dark)(), peers.Numpy().prepare(dark)()
            for dark_e in (3.0, 19.0, 50.0):
                lit = dataclasses.replace(dark, dark_e=dark_e)
                numbers = bound.noise(lit)(drawn)
                self.assertEqual(peers_contest.noise_differs(numbers, of_numpy, lit), "", f"{kind.name}, {dark_e} e-")
                darker = dataclasses.replace(lit, dark_e=dark_e - 1.0)
                self.assertNotEqual(peers_contest.noise_differs(numbers, of_numpy, darker), "", "control")
            with self.assertRaisesRegex(peers.Cannot, "pixels at a time"):
                bound.noise(still[0])
            with self.assertRaisesRegex(peers.Cannot, "without motion"):
                bound.prepare(self.scene)
        self.assertEqual(peers_contest.noise_differs(loop.noise(scene)(image), wanted, scene), "")
        wide = dataclasses.replace(scene, sigma_px=2.0)
        with self.assertRaisesRegex(peers.Cannot, "wider than 15 px"):
            loop.prepare(wide)
        with self.assertRaisesRegex(peers.Cannot, "C compiler is missing"):
            peers_loop.build("/tmp", compiler="no-such-compiler")


if __name__ == "__main__":
    unittest.main()
