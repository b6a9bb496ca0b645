"""Tests of what starloop does to files and memory that are not its own: python3 hil_scripts/tests/test_files.py

Names planted in output folders, names that lead out of them, rings that vanish, captures that were cut, and limits of
memory set from outside. Standard library only.
"""

import os
import resource
import shutil
import time
import unittest

from support import BINARY, CAMERA, ROOT, InAFolder, Running, bench_text, rows_of, starloop, summary_of, until

LARGE_CAMERA = """
[detector]
width_px = {side}
height_px = {side}
pixel_pitch_um = 5.0
[optics]
focal_length_mm = 100.0
"""
LOST = 5


def limited(megabytes):
    """Limits the address space of the program that is started, MB."""
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (megabytes * 10**6,) * 2)


class Folder(InAFolder):
    def bench(self, sinks="", name="files", camera=CAMERA):
        return self.written("bench.toml", bench_text(name, camera) + sinks)

    def large(self, side, sinks=""):
        return self.bench(sinks, camera=self.written(f"camera_{side}.toml", LARGE_CAMERA.format(side=side)))

    def run_it(self, *words, **options):
        return starloop(*words, timeout=300, cwd=self.folder, **options)


class Files(Folder):
    def rows(self):
        return [int(row["frame"]) for row in rows_of(self.out)]

    def refusals(self):
        sink = summary_of(self.out)["sinks"][0]
        return sink["refused"], sink["first_error"]

    def test_planted_names_cost_their_frames_and_their_targets_stay(self):
        victim = self.written("victim", "precious")
        self.out.mkdir()
        os.mkfifo(self.out / "frame_000003.fits")
        (self.out / "frame_000005.fits").symlink_to(victim)
        (self.out / "frame_000007.truth.csv").write_text("a stranger's")
        words = ["--quiet", "--backend", "cpu", "--out", str(self.out), "--duration", "2"]
        # A pipe that is not read must not hold up the run; the limit of time is that of run_it.
        done = self.run_it("run", self.bench('[sink]\nkind = "recorder"\n'), *words, status=LOST)
        self.assertIn("is there already", done.stderr)
        self.assertEqual(victim.read_text(), "precious")
        self.assertTrue((self.out / "frame_000005.fits").is_symlink())
        self.assertEqual((self.out / "frame_000007.truth.csv").read_text(), "a stranger's")
        listed = set(self.rows())
        self.assertTrue(listed and not listed & {3, 5, 7}, listed)
        refused, first_error = self.refusals()
        self.assertGreaterEqual(refused, 1)
        self.assertIn("is there already", first_error)
        for kind in ("fits", "truth.csv"):
            names = {int(path.name[6:12]) for path in self.out.glob(f"frame_*.{kind}")}
            self.assertEqual(names - {3, 5, 7}, listed, f"no {kind} without its row")
        self.assertFalse((self.out / "frame_000007.fits").exists(), "no image without its truth table")
        self.assertFalse((self.out / "frame_000003.truth.csv").exists(), "no truth table without its image")

    def test_first_error_is_in_the_summary_of_a_run_with_one_sink_on_the_virtual_clock(self):
        self.out.mkdir()
        (self.out / "frame_000004.fits").mkdir()
        words = ["--quiet", "--backend", "cpu", "--out", str(self.out), "--duration", "1", "--clock", "virtual"]
        done = self.run_it("run", self.bench('[sink]\nkind = "recorder"\n'), *words)
        self.assertNotEqual(done.returncode, 0)
        refused, first_error = self.refusals()
        self.assertEqual(refused, 1)
        self.assertIn("frame_000004.fits", first_error)
        self.assertFalse((self.out / "frame_000004.truth.csv").exists())

    def test_name_cannot_lead_out_of_the_output_folder_or_reach_the_terminal(self):
        done = self.run_it("run", self.bench(name="../../escaped"), "--clock", "virtual", "--duration", "0.3", status=1)
        self.assertIn("name is", done.stderr)
        self.assertEqual([path.name for path in self.folder.iterdir()], ["bench.toml"])
        self.assertFalse((self.folder.parent.parent / "escaped").exists())
        done = self.run_it("check", self.bench(name="\\u001b[2J\\u0007"), status=1)
        self.assertNotIn("\x1b", done.stdout + done.stderr)
        self.assertNotIn("\x07", done.stdout + done.stderr)
        # Also from where nothing is checked: the name of a file.
        done = self.run_it("check", "no\x1b[2Jfile.toml")
        self.assertIn("no\\u{1b}[2Jfile.toml", done.stderr)

    def test_cell_of_ten_megabytes_is_shortened_in_the_message(self):
        table = self.written("los.csv", "t_s,dx_px,dy_px,roll_arcsec\n" + "9" * 10_000_000 + "x,0,0,0\n")
        words = ["--camera", str(CAMERA), "--ra", "82", "--dec", "-1", "--los", str(table), "--out", "a.fits"]
        done = self.run_it("render", *words, status=1)
        self.assertIn("los.csv", done.stderr)
        self.assertLess(len(done.stderr), 5000)

    def test_ring_that_vanishes_in_mid_run_is_a_loss(self):
        ring = self.folder / "ring"
        sinks = f'[sink]\nkind = "shared_memory"\npath = "{ring}"\n'
        words = ["--quiet", "--backend", "cpu", "--duration", "4", "--out", str(self.out)]
        with Running(BINARY, "run", self.bench(sinks), *words) as running:
            until("the ring", lambda: running.process.poll() is not None or ring.exists())
            self.assertIsNone(running.process.poll(), "it runs")
            time.sleep(1)
            ring.unlink()
            running.ended(300)
        error = "".join(running.said)
        self.assertEqual(running.process.returncode, LOST, error)
        self.assertIn("was removed or replaced by another program", error)

    def test_capture_that_was_cut_is_refused(self):
        capture = self.folder / "capture"
        words = ["--quiet", "--backend", "cpu", "--duration", "1", "--clock", "virtual", "--sink", "null"]
        done = self.run_it("run", self.bench(), *words, "--capture", str(capture), status=0)
        rows = (capture / "frames.csv").read_text().splitlines(keepends=True)
        (capture / "frames.csv").write_text("".join(rows[:-3]))
        done = self.run_it("replay", str(capture), status=1)
        self.assertIn("holds 7 rows, wanted 10", done.stderr)
        (capture / "frames.csv").write_text("".join(rows))
        done = self.run_it("replay", str(capture))
        self.assertEqual((done.returncode, done.stdout.strip()), (0, "10 of 10 frames bit-identical"), "control")


class Memory(Folder):
    def refused(self, done):
        self.assertEqual(done.returncode, 1, f"{done.returncode}: {done.stderr}")
        self.assertIn("this run needs", done.stderr)
        self.assertIn("of memory, and", done.stderr)

    def test_kept_and_queued_frames_of_a_large_camera_are_refused_in_words(self):
        sinks = '[sink]\nkind = "network_camera"\nport = 0\nframes_kept = 64\nframes_queued = 16\n'
        words = ["--backend", "cpu", "--duration", "1"]
        done = self.run_it("run", self.large(16384, sinks), *words, preexec_fn=limited(8000))
        self.refused(done)
        self.assertIn("frames_kept = 64", done.stderr)
        self.assertIn("(ulimit -v)", done.stderr)
        done = self.run_it("budget", self.large(16384, sinks), "--duration", "1", preexec_fn=limited(8000))
        self.refused(done)

    def test_large_frames_under_small_limits_are_refused_and_never_aborted(self):
        bench = self.large(8192, '[sink]\nkind = "recorder"\n')
        for megabytes in (200, 400, 600, 800, 1000):
            with self.subTest(megabytes=megabytes):
                words = ["--clock", "virtual", "--backend", "cpu", "--duration", "0.2", "--out", str(self.out)]
                self.refused(self.run_it("run", bench, *words, preexec_fn=limited(megabytes)))
                self.assertFalse(self.out.exists(), "nothing was made")

    def test_whatever_the_limit_a_run_is_refused_in_words_or_goes_through(self):
        bench = self.large(2048, '[sink]\nkind = "recorder"\n')
        seen = set()
        for megabytes in range(150, 700, 50):
            with self.subTest(megabytes=megabytes):
                shutil.rmtree(self.out, ignore_errors=True)
                words = ["--clock", "virtual", "--backend", "cpu", "--duration", "0.2", "--out", str(self.out), "--quiet"]
                done = self.run_it("run", bench, *words, preexec_fn=limited(megabytes))
                seen.add(done.returncode)
                if done.returncode != 0:
                    self.refused(done)
        self.assertEqual(seen, {0, 1}, "control: both happened")

    def test_image_of_a_large_camera_is_refused_in_words_and_never_aborted(self):
        camera = self.written("camera.toml", LARGE_CAMERA.format(side=8192))
        words = ["render", "--camera", str(camera), "--ra", "82", "--dec", "-1", "--backend", "cpu", "--out", "a.fits"]
        for megabytes in (150, 300, 500, 700):
            with self.subTest(megabytes=megabytes):
                self.refused(self.run_it(*words, preexec_fn=limited(megabytes)))
        self.assertFalse((self.folder / "a.fits").exists())

    def test_study_and_campaign_of_a_large_camera_are_refused_in_words(self):
        for command, name in (("study", "study"), ("campaign", "campaign")):
            with self.subTest(command=command):
                scenario = ROOT / f"configs/scenarios/{name}.toml"
                done = self.run_it(command, str(scenario), preexec_fn=limited(150))
                self.refused(done)
                self.assertIn("closed loops (RAYON_NUM_THREADS", done.stderr)

    def test_check_states_the_memory_of_a_run_and_warns(self):
        done = self.run_it("check", self.large(2048, '[sink]\nkind = "recorder"\n'), status=0)
        self.assertRegex(done.stdout, r"\n  memory       \d+ MiB: ")
        self.assertNotIn("this run needs", done.stdout)

    def test_load_without_bounds_is_refused_in_words(self):
        done = self.run_it("budget", "--load", "4294967296", status=2)
        self.assertIn("wanted a number of threads from 0 to 1024", done.stderr)


if __name__ == "__main__":
    unittest.main()
