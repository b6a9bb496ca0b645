"""The long run, made short: 16 s on the real clock and some simulated minutes, and its controls; a tiny run of scale.py.

python3 hil_scripts/tests/test_soak.py; Needs Aravis for the system's Python, python-can, cantools, pyserial and numpy.
"""

import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

from support import PROGRAM, SCRIPTS, InAFolder, folder_for, ran, starloop
import scale_report
import soak
import soak_account
import soak_bench
import soak_clients
import soak_virtual

SECONDS, SEED = 16.0, 13


def edit(path, change):
    """Changes the lines of a file."""
    path.write_text("\n".join(change(path.read_text().split("\n"))))


def largest_session(copy):
    return max(copy.glob("camera_*.csv"), key=lambda one: one.stat().st_size)


class Flight(unittest.TestCase):
    """A short flight on the real clock, judged as the long one; then the same files with something missing."""

    @classmethod
    def setUpClass(cls):
        cls.folder = soak.fly(PROGRAM, folder_for(cls) / "real", SECONDS, SEED, say=lambda _: None)

    def account_of_spoilt(self, change):
        """The account of a copy of the flight's files after a change."""
        with tempfile.TemporaryDirectory() as folder:
            copy = pathlib.Path(folder) / "real"
            shutil.copytree(self.folder, copy, symlinks=True)
            change(copy)
            return soak_account.account(copy)

    def spoilt(self, change):
        """Returns the frames that are lost after a change and were not before it."""
        before = soak_account.account(self.folder)["lost"]
        return {what: which for what, which in self.account_of_spoilt(change)["lost"].items() if which != before.get(what)}

    def spoilt_found(self, change):
        def rewrite(copy):
            found = json.loads((copy / "found.json").read_text())
            change(found)
            (copy / "found.json").write_text(json.dumps(found))

        return self.spoilt(rewrite)

    def test_every_frame_arrived_or_is_counted(self):
        found = soak.judged_real(self.folder, PROGRAM)
        frames = found["frames"]
        print(soak.real_text(found), file=sys.stderr)
        self.assertEqual(frames["lost"], {})
        self.assertEqual(frames["counts_that_differ"], [])
        self.assertEqual(sum(frames["fates"].values()), round(SECONDS * 20.0))
        self.assertEqual(found["worker_errors"], {})
        self.assertGreater(found["bus"]["seconds"], 0, "the load of the bus was measured")
        self.assertGreater(found["bus"]["mean"], 0.5, "and it was filled")
        self.assertGreater(frames["recorder"]["recorded"], 0)
        self.assertGreater(frames["camera"]["received"], 0)
        self.assertGreater(found["monitor"]["pictures"], 0)
        self.assertGreater(found["faults"]["outside"]["serial_unplugged"], 0)
        self.assertGreater(found["events"]["link_lost"], 0)
        self.assertGreater(found["faults"]["planned"], 0)

    def test_control_a_frame_that_was_not_recorded_is_found(self):
        lost = self.spoilt_found(lambda found: found["recorder"]["frames"].pop(len(found["recorder"]["frames"]) // 2))
        self.assertEqual(list(lost), ["sent, neither recorded nor counted"])
        lost = self.spoilt_found(lambda found: found["recorder"]["frames"].append([999_999, "00000000"]))
        self.assertEqual(list(lost), ["recorded, never sent"])

    def test_control_a_frame_that_the_camera_lost_is_found(self):
        def change(copy, line_of):
            edit(largest_session(copy), lambda lines: [*lines[:3], *line_of(lines[3]), *lines[4:]])

        before = soak_account.account(self.folder)["camera"]["unnamed"]
        after = self.account_of_spoilt(lambda copy: change(copy, lambda line: []))["camera"]["unnamed"]
        self.assertEqual(len(after), len(before) + 1, f"{before} {after}")
        lost = self.spoilt(lambda copy: change(copy, lambda line: [line.split(",")[0] + ",00000000,success"]))
        self.assertEqual(list(lost), ["received with other pixels than recorded"])

    def test_control_more_frames_than_the_camera_counts_are_found(self):
        cut = lambda copy: edit(largest_session(copy), lambda lines: lines[:3] + lines[-30:])
        self.assertIn("of the network camera, neither received nor counted", self.spoilt(cut))

    def test_control_a_slot_without_a_row_and_one_without_a_cause_are_found(self):
        def drop_row(copy, change):
            path = copy / "timing/frames_timing.csv"
            lines = path.read_text().split("\n")
            place = next(place for place, line in enumerate(lines) if ",sent,," in line)
            lines[place : place + 1] = change(lines[place])
            path.write_text("\n".join(lines))

        lost = self.spoilt(lambda copy: drop_row(copy, lambda line: []))
        self.assertIn("slots without a row", lost)
        lost = self.spoilt(lambda copy: drop_row(copy, lambda line: [line.replace(",sent,,", ",dropped,,")]))
        self.assertIn("dropped without a cause", lost)


class Memory(unittest.TestCase):
    def slope(self, body):
        """Growth of a small Python program that runs for two seconds."""
        process = subprocess.Popen([sys.executable, "-c", f"import time\nkept = []\nend = time.monotonic() + 2.5\nwhile time.monotonic() < end:\n    {body}"])
        samples = soak_clients.Samples(process.pid, 0.05).begin()
        process.wait()
        samples.end()
        return soak_account.memory_slope(samples.rows, 2.4)

    def test_a_process_that_grows_is_found(self):
        found = self.slope("kept.append(bytes(100_000)); time.sleep(0.02)")
        self.assertEqual(found["verdict"], "grows", found)
        # 5 MB/s at most.
        self.assertLess(found["bytes_per_hour"], 5e6 * 3600.0 * 1.2)

    def test_one_that_does_not_grow_is_flat(self):
        found = self.slope("time.sleep(0.02)")
        self.assertEqual(found["verdict"], "flat", found)

    def test_the_error_of_the_slope_covers_noise(self):
        rows = [(10.0 * k, 1e9 + 1e5 * math.sin(12.9898 * k * k), 1, 1, 0.0, 0.0) for k in range(360)]
        self.assertEqual(soak_account.memory_slope(rows, 3600.0)["verdict"], "flat")
        grown = [(t, rss + 2e7 * t / 3600.0, *rest) for t, rss, *rest in rows]
        self.assertEqual(soak_account.memory_slope(grown, 3600.0)["verdict"], "grows", "control: 2 % an hour")


class SimulatedTime(InAFolder):
    def test_two_legs_lose_nothing_and_a_missing_frame_is_found(self):
        found = soak_virtual.fly_virtual(PROGRAM, self.folder, 0.1, SEED, leg_s=180.0, say=lambda _: None)
        self.assertEqual((found["lost"], found["legs_whose_counts_differ"]), ({}, []))
        self.assertEqual([leg["exit_status"] for leg in found["legs"]], [0, 0])
        self.assertEqual(found["total"]["recorded"] + found["total"]["counted"], found["total"]["frames"])
        self.assertIn("bus_off", found["total"]["events"])
        leg = found["legs"][0]
        for change in ({"lost": [7]}, {"wrong": [7]}, {"beyond": [9999]}):
            self.assertIn("leg 0", soak_virtual.sum_of([{**leg, **change}])["lost"], "control")


class Schedules(InAFolder):
    def test_the_seed_decides_and_every_word_comes(self):
        events, injected = soak_bench.fault_schedule(1, 40_000.0)
        self.assertEqual((events, injected), soak_bench.fault_schedule(1, 40_000.0))
        self.assertNotEqual(events, soak_bench.fault_schedule(2, 40_000.0)[0])
        self.assertEqual(len({event["do"] for event in events + injected}), 33)
        words = {word for _, word, _ in soak_bench.outside_schedule(1, 3600.0)}
        self.assertEqual(words, {word for _, word, _ in soak_bench.outside_schedule(1, 30.0)})

    def test_the_program_takes_every_fault(self):
        events, injected = soak_bench.fault_schedule(1, 40_000.0)
        path = self.written("bench.toml", soak_bench.bench_text(1, 40_000.0, events + injected))
        done = starloop("check", path)
        self.assertEqual(done.returncode, 0, done.stderr)


class Scale(InAFolder):
    def test_a_tiny_run_has_tables_and_exponents(self):
        words = [word for part in ("stars", "path", "largest", "windows") for word in ("--part", part)]
        command = [sys.executable, str(SCRIPTS / "measure/scale.py"), "--tiny", "--out", self.folder, *words]
        done = ran(*command)
        self.assertEqual(done.returncode, 0, done.stderr)
        parts = json.loads((self.folder / "scale.json").read_text())
        self.assertEqual([x for x, _ in parts["stars"]["rows"]], [100, 1000, 3000])
        self.assertTrue(all(found["stars"] == stars for stars, found in parts["stars"]["rows"]), "all of them are drawn")
        frames = parts["windows"]["rows"][0][1]["frames"]
        self.assertGreater(frames["scheduled"], 100, "the commanded rate, not the 10 Hz of the bench")
        self.assertEqual(frames["delivered"] + frames["dropped"], frames["scheduled"])
        for title in ("### Stars", "### Length of the path", "### The largest scene", "### 500 Hz with windows"):
            self.assertIn(title, done.stdout)

    def test_exponents_are_those_of_made_up_costs(self):
        points = [(10.0**k, 5.0 + 0.01 * 10.0**k) for k in range(0, 9)]
        (low, _, _, bend), (high, _, _, _) = scale_report.bent_line(points)
        self.assertLess(low, 0.2)
        self.assertAlmostEqual(high, 1.0, delta=0.05)
        self.assertTrue(10.0 <= bend <= 1e4, bend)
        ((exponent, error, _, _),) = scale_report.bent_line([(x, 3.0 * x**1.5) for x, _ in points])
        self.assertAlmostEqual(exponent, 1.5, places=9)
        self.assertLess(error, 1e-6)
        self.assertFalse(scale_report.is_linear(exponent, error))


if __name__ == "__main__":
    begun = time.monotonic()
    try:
        unittest.main()
    finally:
        print(f"{time.monotonic() - begun:.0f} s", file=sys.stderr)
