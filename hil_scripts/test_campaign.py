"""Tests of campaign.py with the program on a cluster of two workers: python3 hil_scripts/test_campaign.py

A campaign is killed halfway and goes on; its rows are whole, and one seed has the same bits twice. STARLOOP_BINARY names
the program (default target/release/starloop); the Python that runs this needs hil_scripts/requirements_campaign.txt.
"""

import argparse
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import pyarrow.parquet

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

import campaign

ROOT = Path(__file__).resolve().parent.parent
BINARY = os.environ.get("STARLOOP_BINARY", str(ROOT / "target/release/starloop"))
SCENARIO = str(ROOT / "configs/scenarios/acquisition.toml")
SHORT = ["--set", "duration_s=3.0", "--set", "expect.window_s=1.0"]
SHORT += ["--set", "bench.camera=../cameras/small_tracker.toml"]


def command(out, *arguments):
    script = str(ROOT / "hil_scripts/campaign.py")
    return [
        sys.executable, "-B", script, SCENARIO, "--binary", BINARY, "--workers", "2", "--out", str(out), *SHORT,
        *arguments,
    ]  # fmt: skip


def run(out, *arguments):
    return subprocess.run(command(out, *arguments), capture_output=True, text=True, timeout=300)


def whole_rows(out):
    return sorted((Path(out) / "tasks").glob("[!.]*.parquet"))


class Campaign(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="campaign")
        self.addCleanup(folder.cleanup)
        self.out = Path(folder.name) / "a"
        self.other = Path(folder.name) / "b"

    def kill_halfway(self, arguments, rows):
        """Kills a campaign with all its workers as soon as it has written so many rows."""
        going = subprocess.Popen(command(self.out, *arguments), stderr=subprocess.PIPE, start_new_session=True)
        deadline = time.monotonic() + 120
        while len(whole_rows(self.out)) < rows and going.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        self.assertIsNone(going.poll(), "killed before its end")
        os.killpg(going.pid, signal.SIGKILL)
        going.communicate()

    def test_killed_halfway_it_goes_on_and_the_bits_of_a_seed_are_the_same(self):
        arguments = ["--seeds", "1..4", "--grid", "control.delay_ms=0,100"]
        self.kill_halfway(arguments, 3)
        there = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in whole_rows(self.out)}
        self.assertTrue(3 <= len(there) < 8, f"{len(there)} of 8 rows")
        # Files that a killed writer or a full disk may leave behind: neither counts as a row.
        (self.out / "tasks" / ".half.parquet.1.part").write_bytes(b"PAR1half")
        torn = sorted(there)[0]
        torn.write_bytes(there.pop(torn)[1][:100])
        resumed = run(self.out, *arguments)
        # At three seconds no run has reached fine pointing: each gives a report, and none holds.
        self.assertEqual(resumed.returncode, 4, resumed.stderr)
        self.assertIn(f"({len(there)} were there)", resumed.stderr)
        for path, (written, content) in there.items():
            self.assertEqual((path.stat().st_mtime_ns, path.read_bytes()), (written, content), "not run again")
        rows = pyarrow.parquet.read_table(self.out / "results.parquet").to_pylist()
        self.check_rows(rows)
        self.check_summary(json.loads((self.out / "summary.json").read_text()))
        self.assertIn("<svg", (self.out / "campaign.svg").read_text()[:2000])
        again = run(self.out, *arguments)
        self.assertIn("all 8 tasks were there", again.stderr)
        self.check_repeats(rows)

    def check_rows(self, rows):
        self.assertEqual(len(rows), 8)
        self.assertEqual(
            {(row["seed"], row["param.control.delay_ms"]) for row in rows},
            {(seed, delay_ms) for seed in range(1, 5) for delay_ms in (0.0, 100.0)},
        )
        for row in rows:
            self.assertTrue(row["has_report"], row)
            self.assertEqual((row["exit_status"], row["violations"], row["frames.delivered"]), (4, 0, 30))
            self.assertFalse(row["verdict.fine_pointing_reached_after.passed"])
            self.assertRegex(row["frames_crc32"], "^[0-9a-f]{8}$")
            self.assertGreater(row["task_wall_s"], 0.0)
            self.assertIn("failed: ", row["stderr_tail"])
        self.assertEqual(len({row["telemetry_crc32"] for row in rows}), 8, "control: each has bits of its own")

    def check_summary(self, summary):
        self.assertEqual((summary["tasks"], summary["passed"], summary["without_report"]), (8, 0, 0))
        self.assertEqual(summary["by_value"]["control.delay_ms"]["100"]["tasks"], 4)
        self.assertAlmostEqual(summary["simulated_h"], 8 * 3.0 / 3600.0)
        self.assertEqual(len(summary["not_passed"]), 8)
        self.assertIn("fine pointing reached after: wanted at most", summary["not_passed"][0]["why"])

    def check_repeats(self, rows):
        """One seed in another campaign, and by the command in its row, has the bits of the first."""
        run(self.other, "--seeds", "2", "--set", "control.delay_ms=100")
        (other,) = pyarrow.parquet.read_table(self.other / "results.parquet").to_pylist()
        (first,) = [row for row in rows if row["seed"] == 2 and row["param.control.delay_ms"] == 100.0]
        by_hand = subprocess.run(shlex.split(first["command"]) + ["--json", "--quiet"], capture_output=True, text=True)
        by_hand = json.loads(by_hand.stdout)
        crcs = (first["frames_crc32"], first["telemetry_crc32"])
        self.assertEqual((other["frames_crc32"], other["telemetry_crc32"]), crcs)
        self.assertEqual(("+".join(by_hand["frames_crc32"]), by_hand["telemetry_crc32"]), crcs)

    def test_runs_that_hold_are_status_0_and_random_faults_are_distinguished(self):
        # This scenario expects nothing but its invariants.
        calm = str(ROOT / "configs/scenarios/campaign.toml")
        arguments = [calm if word == SCENARIO else word for word in command(self.out, "--seeds", "1..2")]
        ended = subprocess.run(arguments, capture_output=True, text=True, timeout=300)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        rows = pyarrow.parquet.read_table(self.out / "results.parquet").to_pylist()
        self.assertEqual([(row["passed"], row["exit_status"]) for row in rows], [(True, 0)] * 2)
        with_faults = campaign.tasks_of([1], {}, {}, True)[0]
        self.assertIn("--random-faults", campaign.command_of(with_faults, "starloop", calm))
        self.assertNotEqual(with_faults["id"], campaign.tasks_of([1], {}, {})[0]["id"], "not the same run")

    def test_a_task_that_cannot_run_is_reported_with_its_command_and_the_others_go_on(self):
        ended = run(self.out, "--seeds", "3", "--grid", "tracker.delay_ms=50,-1")
        self.assertEqual(ended.returncode, 1, ended.stderr)
        self.assertIn("--set tracker.delay_ms=-1", ended.stderr)
        self.assertIn("tracker.delay_ms is -1; wanted", ended.stderr)
        rows = pyarrow.parquet.read_table(self.out / "results.parquet").to_pylist()
        self.assertEqual([(row["has_report"], row["exit_status"]) for row in rows], [(True, 4), (False, 2)])
        refused = subprocess.run(
            command(self.out, "--seeds", "3")[:-6] + ["--binary", sys.executable], capture_output=True, text=True
        )
        self.assertIn("results of another program", refused.stderr, "programs are not mixed")


class Arguments(unittest.TestCase):
    def test_seeds_and_grids(self):
        self.assertEqual(campaign.parse_seeds("1..3,7,2"), [1, 2, 3, 7])
        self.assertEqual(campaign.parse_grid("a.b=0,1.5"), ("a.b", ["0", "1.5"]))
        self.assertEqual(campaign.parse_grid('a=[1, 2],"x,y"'), ("a", ["[1, 2]", '"x,y"']))
        for wrong in ("", "3..1", "-1", "1-5"):
            self.assertRaises(argparse.ArgumentTypeError, campaign.parse_seeds, wrong)
        for wrong in ("a", "=1", "a=1,,2"):
            self.assertRaises(argparse.ArgumentTypeError, campaign.parse_grid, wrong)

    def test_tasks_have_names_of_their_own_that_stay(self):
        tasks = campaign.tasks_of([1, 2], {"a": ["0", "1"]}, {"b": "2"})
        self.assertEqual(len({task["id"] for task in tasks}), 4)
        as_fixed = campaign.tasks_of([1], {}, {"a": "0", "b": "2"})
        self.assertEqual(as_fixed[0]["id"], tasks[0]["id"], "the same run, however it was asked for")

    def test_only_runs_that_came_to_their_end_are_results(self):
        with tempfile.TemporaryDirectory(prefix="campaign") as folder:
            out, program = Path(folder), Path(folder) / "program"
            task = campaign.tasks_of([1], {}, {})[0]
            for status, is_result, is_there, is_retried in (
                (0, True, True, False),
                (4, True, True, False),
                (1, False, True, True),
                (3, False, True, True),
                (130, False, False, True),
            ):
                # A program that prints a report, however it ends.
                report = '{"passed": true, "frames_crc32": ["0"]}'
                program.write_text(f"#!/bin/sh\necho '{report}'\nexit {status}\n")
                program.chmod(0o755)
                result = campaign.run_task(task, str(program), "scenario", 10.0)
                self.assertEqual((result["report"] is not None, result["error"] is None), (is_result,) * 2, result)
                row = campaign.row_of(task, result, [])
                self.assertEqual((row["has_report"], row["passed"]), (is_result,) * 2)
                path = out / "tasks" / f"{task['id']}.parquet"
                campaign.write_whole(path, lambda beside: pyarrow.parquet.write_table(campaign.table_of([row]), beside))
                self.assertEqual(bool(campaign.rows_there(out, [task], False)), is_there, status)
                self.assertEqual(bool(campaign.rows_there(out, [task], True)), not is_retried, status)

    def test_columns_of_numbers_and_words_are_one_table(self):
        table = campaign.table_of([{"a": 1.0, "b": None}, {"a": "off", "c": True}])
        self.assertEqual(table.to_pylist(), [{"a": "1.0", "b": None, "c": None}, {"a": "off", "b": None, "c": True}])

    def test_quantiles_lie_between_neighbours(self):
        self.assertEqual(campaign.quantile([3.0, 1.0, 2.0], 0.5), 2.0)
        self.assertAlmostEqual(campaign.quantile([0.0, 10.0], 0.95), 9.5)
        self.assertIsNone(campaign.quantile([], 0.5))


if __name__ == "__main__":
    unittest.main(verbosity=2)
