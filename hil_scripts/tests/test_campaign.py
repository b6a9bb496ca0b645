"""Tests of campaign.py with the program on a cluster of two workers: python3 hil_scripts/tests/test_campaign.py

A campaign is killed halfway and goes on; its rows are whole, and one seed has the same bits twice; the report about all runs
says what their rows say, and requirements that are broken are found. STARLOOP_BINARY names
the program (default target/release/starloop); the Python that runs this needs hil_scripts/requirements_campaign.txt.
"""

import argparse
import hashlib
import json
import os
import random
import re
import shlex
import signal
import statistics
import subprocess
import sys
import time
import unittest
import xml.etree.ElementTree
from pathlib import Path

import pyarrow.parquet

from support import BINARY, ROOT, InAFolder, folder_for, ran
from starloop import campaign, campaign_page, campaign_report

SCENARIO = str(ROOT / "configs/scenarios/acquisition.toml")
SHORT = ["--set", "duration_s=3.0", "--set", "expect.window_s=1.0"]
SHORT += ["--set", "bench.camera=../cameras/small_tracker.toml"]


def command(out, *arguments):
    script = str(ROOT / "hil_scripts/starloop/campaign.py")
    return [
        sys.executable, "-B", script, SCENARIO, "--binary", BINARY, "--workers", "2", "--out", str(out), *SHORT,
        *arguments,
    ]  # fmt: skip


def run(out, *arguments):
    return ran(*command(out, *arguments), timeout=300)


def whole_rows(out):
    return sorted((Path(out) / "tasks").glob("[!.]*.parquet"))


class Campaign(InAFolder):
    def setUp(self):
        super().setUp()
        self.out, self.other = self.folder / "a", self.folder / "b"

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
        by_hand = ran(*shlex.split(first["command"]), "--json", "--quiet")
        by_hand = json.loads(by_hand.stdout)
        crcs = (first["frames_crc32"], first["telemetry_crc32"])
        self.assertEqual((other["frames_crc32"], other["telemetry_crc32"]), crcs)
        self.assertEqual(("+".join(by_hand["frames_crc32"]), by_hand["telemetry_crc32"]), crcs)

    def test_runs_that_hold_are_status_0_and_random_faults_are_distinguished(self):
        # This scenario expects nothing but its invariants.
        calm = str(ROOT / "configs/scenarios/campaign.toml")
        arguments = [calm if word == SCENARIO else word for word in command(self.out, "--seeds", "1..2")]
        ran(*arguments, status=0)
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
        refused = ran(*command(self.out, "--seeds", "3")[:-6], "--binary", sys.executable)
        self.assertIn("results of another program", refused.stderr, "programs are not mixed")


REQUIREMENTS = """
[[requirement]]
id = "C-1"
text = "Frames are delivered"
metric = "frames.delivered"
least = 30.0

[[requirement]]
id = "C-2"
text = "The attitude stays near its target"
metric = "pointing.largest_boresight_arcsec"
most = {most}
share = 0.5
where = {{ "control.delay_ms" = 100 }}
"""


class Report(unittest.TestCase):
    """The report about a campaign on two workers."""

    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        cls.out, cls.requirements = cls.folder / "a", cls.folder / "requirements.toml"
        cls.requirements.write_text(REQUIREMENTS.format(most=1e9))
        cls.arguments = ["--seeds", "1..6", "--grid", "control.delay_ms=0,100", "--report"]
        cls.ended = run(cls.out, *cls.arguments, "--requirements", str(cls.requirements))
        cls.report = json.loads((cls.out / "report.json").read_text())
        cls.page = (cls.out / "report.html").read_text()
        cls.rows = pyarrow.parquet.read_table(cls.out / "results.parquet").to_pylist()

    def again(self, text):
        """The same rows under other requirements: no run is flown again."""
        other = self.folder / "other.toml"
        other.write_text(text)
        ended = run(self.out, *self.arguments, "--requirements", str(other))
        self.assertIn("all 12 tasks were there", ended.stderr)
        return ended, json.loads((self.out / "report.json").read_text())

    def test_numbers_are_those_of_the_rows(self):
        self.assertEqual(self.ended.returncode, 0, self.ended.stderr)
        self.assertEqual((self.report["schema"], self.report["runs"]), (campaign_report.SCHEMA, 12))
        self.assertTrue(self.report["verdict"].startswith("PASSED: acquisition, 12 runs, 2 of 2"), self.report["verdict"])
        metrics = {metric["id"]: metric for metric in self.report["metrics"]}
        name = "pointing.largest_boresight_arcsec"
        values = [row[name] for row in self.rows]
        self.assertAlmostEqual(metrics[name]["mean"]["value"], statistics.mean(values))
        self.assertAlmostEqual(metrics[name]["median"]["value"], statistics.median(values))
        self.assertEqual((metrics[name]["least"], metrics[name]["most"]), (min(values), max(values)))
        late = [row[name] for row in self.rows if row["param.control.delay_ms"] == 100.0]
        of_late = metrics[name]["by_value"]["control.delay_ms"]["100"]
        self.assertEqual(of_late["count"], 6)
        self.assertAlmostEqual(of_late["mean"]["value"], statistics.mean(late))
        self.assertLess(of_late["mean"]["low"], of_late["mean"]["value"])
        for wanted in ("tracker_availability", "frames.delivered", "attitudes_used", "knowledge.boresight_arcsec"):
            self.assertIn(wanted, metrics)

    def test_the_worst_run_is_repeated_by_its_command(self):
        (metric,) = [m for m in self.report["metrics"] if m["id"] == "pointing.largest_boresight_arcsec"]
        self.assertEqual(metric["worst"]["value"], metric["most"])
        by_hand = ran(*shlex.split(metric["worst"]["command"]), "--json", "--quiet")
        found = json.loads(by_hand.stdout)["pointing"]["largest_boresight_arcsec"]
        self.assertEqual(found, metric["worst"]["value"])

    def test_files(self):
        page = self.page
        self.assertLess(len(page.encode()), campaign_report.MOST_HTML_BYTES)
        self.assertIn("PASSED", page.split("<h2>")[0])
        self.assertFalse(re.search(r"<(script|link|img|iframe)|src=|url\(", page), "it needs no other file")
        charts = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
        self.assertGreater(len(charts), 5)
        for chart in charts:
            xml.etree.ElementTree.fromstring(chart)
        files = {row["path"]: row["sha256"] for row in self.report["provenance"]["files"]}
        digest = hashlib.sha256((self.out / "results.parquet").read_bytes()).hexdigest()
        self.assertIn(digest, files.values())
        self.assertIn(hashlib.sha256(Path(SCENARIO).read_bytes()).hexdigest(), files.values())
        self.assertRegex(self.report["provenance"]["program"]["version"], "starloop")

    def test_a_requirement_that_is_broken_or_not_shown_is_found(self):
        ended, report = self.again(REQUIREMENTS.format(most=1e-3))
        self.assertEqual(ended.returncode, 4, ended.stderr)
        self.assertEqual([judgement["verdict"] for judgement in report["requirements"]], ["met", "NOT MET"])
        suite = xml.etree.ElementTree.parse(self.out / "report.xml").getroot().find("testsuite")
        self.assertEqual((suite.get("tests"), suite.get("failures")), ("2", "1"))
        self.assertEqual(report["requirements"][1]["runs"], 6, "of one value of the grid")
        # Six of six runs show 50 % with a confidence of 95 %, and not 99 %.
        ended, report = self.again(REQUIREMENTS.format(most=1e9).replace("share = 0.5", "share = 0.99"))
        self.assertEqual((ended.returncode, report["requirements"][1]["verdict"]), (4, "not shown"))
        ended, report = self.again(REQUIREMENTS.format(most=1e9).replace("frames.delivered", "no_such_number"))
        self.assertEqual((ended.returncode, report["requirements"][0]["verdict"]), (4, "not measured"))

    def test_without_requirements_every_run_must_hold(self):
        ended = run(self.out, *self.arguments)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((ended.returncode, report["not_held_count"]), (4, 12), "at three seconds none is at its target")
        self.assertTrue(report["verdict"].startswith("FAILED"))


class Distributions(InAFolder):
    """Reports about made-up rows, whose truth is known."""

    def rows(self, count, seed, mean_of_late=12.0):
        dice = random.Random(seed)
        rows = []
        for number in range(count):
            delay = 100.0 * (number % 2)
            value = dice.gauss(mean_of_late if delay else 10.0, 2.0)
            rows.append(
                {
                    "task": f"t{number}", "seed": number, "random_faults": False, "param.control.delay_ms": delay,
                    "has_report": True, "passed": True, "error": None, "exit_status": 0, "error_arcsec": value,
                    "command": f"starloop run x --seed {number}",
                }
            )  # fmt: skip
        return rows

    def report(self, rows, requirements=(campaign_report.HOLDS,), planned=None):
        program = {"path": "p", "version": "v", "sha256": "s"}
        provenance = {"command_line": ["c"], "program": program, "host": "h", "machine": "m", "python": "3", "seeds": [0, 1]}
        about = {"title": "made up", "planned": planned or len(rows), "provenance": {**provenance, "files": []}}
        grid = {"control.delay_ms": ["0", "100"]}
        return campaign_report.report_of(rows, grid, list(requirements), about, campaign.number)

    def test_thousands_of_runs_are_one_page_and_their_truth_is_within_the_intervals(self):
        report = self.report(self.rows(6000, 7))
        (metric,) = [m for m in report["metrics"] if m["id"] == "error_arcsec"]
        for value, truth in (("0", 10.0), ("100", 12.0)):
            of = metric["by_value"]["control.delay_ms"][value]
            tail = statistics.NormalDist(truth, 2.0).inv_cdf(0.95)
            for part, wanted in (("mean", truth), ("median", truth), ("p95", tail)):
                self.assertTrue(of[part]["low"] <= wanted <= of[part]["high"], (value, part, of[part], wanted))
                self.assertFalse(of[part]["low"] <= wanted + 0.3 <= of[part]["high"], "control: 0.3 arcsec off")
        page = campaign_page.html_of(report)
        self.assertLess(len(page.encode()), 100_000)

    def test_intervals_hold_the_truth_as_often_as_they_say(self):
        dice, trials, held = random.Random(8), 1500, {"mean": 0, "median": 0, "p95": 0}
        wanted = {"mean": 0.0, "median": 0.0, "p95": statistics.NormalDist().inv_cdf(0.95)}
        for _ in range(trials):
            found = campaign_report.distribution([dice.gauss(0.0, 1.0) for _ in range(80)], 0.9)
            for part, truth in wanted.items():
                low, high = found[part]["low"], found[part]["high"]
                held[part] += (low is None or low <= truth) and (high is None or truth <= high)
        # Order statistics hold it at least as often; four standard errors of a share of 0.9 are 0.031.
        self.assertLess(abs(held["mean"] / trials - 0.9), 0.031, held)
        self.assertTrue(0.869 < held["median"] / trials < 0.98 and 0.869 < held["p95"] / trials < 0.98, held)

    def test_runs_without_the_number_do_not_meet_it_and_are_the_worst(self):
        rows = self.rows(40, 9)
        rows[5].update(error_arcsec=None, has_report=False, passed=False, error="took longer than 3 s")
        wanted = campaign_report.Requirement("A", "error_arcsec", most=100.0, share=0.98, by="value")
        report = self.report(rows, [wanted])
        (judgement,) = report["requirements"]
        self.assertEqual((judgement["verdict"], judgement["without_number"]), ("NOT MET", 1))
        self.assertEqual(judgement["worst"][0]["seed"], 5)
        self.assertEqual((report["not_held_count"], report["not_held"][0]["error"]), (1, "took longer than 3 s"))
        part = self.report(rows[:5] + rows[6:], [wanted], planned=40)
        self.assertEqual(part["requirements"][0]["verdict"], "met")
        self.assertFalse(part["is_met"], "a campaign that was stopped")

    def test_requirements_that_cannot_be_meant_are_refused(self):
        path = self.folder / "requirements.toml"
        head = '[[requirement]]\nid = "A"\n'
        for text, part in (
            ("", "no requirement"),
            (head + "most = 1.0", "wanted id, metric"),
            (head + 'metric = "m"', "most or least"),
            (head + 'metric = "m"\nmost = 1.0\nleast = 0.0', "most or least"),
            (head + 'metric = "m"\nmost = 1.0\nshare = 1.5', "share 1.5"),
            (head + 'metric = "m"\nmost = nan', "finite"),
            (head + 'metric = "m"\nmost = 1.0\nother = 1', "other"),
            (2 * (head + 'metric = "m"\nmost = 1.0\n'), "twice"),
        ):
            path.write_text(text)
            with self.assertRaisesRegex(campaign_report.RequirementError, part):
                campaign_report.read_requirements(path)


class Arguments(InAFolder):
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
        out, program = self.folder, self.folder / "program"
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
