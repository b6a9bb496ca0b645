"""Star trackers outside in the loop, on the real clock: python3 hil_scripts/tests/test_tracker_in.py

`outside_tracker.py` answers frames that it reads from shared memory or from a network camera, and the spacecraft inside
flies by it. Controls: a tracker that is off by a known angle takes the boresight there; late and missing answers are in
events, counts and verdict; without a tracker nothing points. The full form has three heads on three lines.
"""

import json
import sys
import unittest
from pathlib import Path

import support
from support import BINARY, ROOT, Running, folder_for, free_port, summary_of

BENCH = ROOT / "configs/benches/tracker_in.toml"
TRACKER = ROOT / "hil_scripts/tests/outside_tracker.py"
PATIENCE_S = 900.0
BUSY = """
late_answers_at_most = 40
dropped_frames_at_most = 100
"""
"""The price of a busy machine: it makes frames and answers late."""
EXPOSURE_MS = 100.0
THINKS_MS = 60.0
OFF_ARCSEC = 300.0
UNTIL_ANSWERED = 10


def bench_text(folder, more="", **changes):
    """The shipped bench with its frames below the folder, and other values of some keys."""
    text = BENCH.read_text().replace('"../', f'"{ROOT}/configs/')
    changes = {"path": f'"{folder}/frames"', "listen": free_port(), "missing_answers_at_most": 10, **changes}
    lines = []
    for line in text.splitlines():
        key = line.split(" = ")[0]
        lines.append(f"{key} = {changes.pop(key)}" if key in changes else line)
    assert not changes, f"no line of the bench has {changes}"
    return "\n".join(lines) + BUSY + more


class Flight:
    """A run with its trackers; `ended` has its exit status, its summary and its scenario's report."""

    def __init__(self, case, text, trackers, *arguments):
        self.folder = folder_for(case)
        self.out = self.folder / "run"
        bench = self.folder / "bench.toml"
        bench.write_text(text(self.folder) if callable(text) else text)
        self.run = Running(BINARY, "run", bench, "--out", self.out, *arguments)
        self.trackers = [Running(*words(self.folder, bench.read_text())) for words in trackers]

    def ended(self):
        printed = self.run.ended(PATIENCE_S)
        self.said = [tracker.ended(PATIENCE_S) for tracker in self.trackers]
        for tracker in self.trackers:
            assert tracker.process.returncode == 0, "".join(tracker.said)
        self.printed = printed
        scenario = self.out / "scenario.json"
        return self.run.process.returncode, summary_of(self.out), json.loads(scenario.read_text())


def port_in(text, number=0):
    """The port of a tracker of a bench."""
    return [line.split(" = ")[1].split()[0] for line in text.splitlines() if line.startswith("listen = ")][number]


def imitation(*options):
    """The words that start the stand-in on shared memory and UDP."""
    return lambda folder, text: (sys.executable, TRACKER, f"{folder}/frames", f"127.0.0.1:{port_in(text)}", *options)


class Answers(unittest.TestCase):
    """All runs fly at once: they take no time of the machine, only of the clock."""

    @classmethod
    def setUpClass(cls):
        thinks = ("--delay-ms", THINKS_MS)
        off = ("--off-arcsec", OFF_ARCSEC, 0.0, 0.0)
        wanted = {
            "good": ([imitation(*thinks)], 40),
            "off": ([imitation(*off, "--by-time")], 40),
            "poor": ([imitation("--skip", 4, "--slow", 13)], 12),
            "none": ([], 8),
        }
        cls.flights = {name: Flight(cls, bench_text, trackers, "--duration", s) for name, (trackers, s) in wanted.items()}
        cls.ended = {name: flight.ended() for name, flight in cls.flights.items()}
        cls.printed = {name: flight.printed for name, flight in cls.flights.items()}

    def answers(self, name):
        [row] = self.ended[name][1]["answers"]
        return row

    def test_a_spacecraft_points_by_the_answers_and_their_latency_is_counted(self):
        status, summary, scenario = self.ended["good"]
        row = self.answers("good")
        self.assertEqual((status, summary["verdict"]), (0, "ok"), self.printed["good"])
        self.assertGreater(row["answers"], row["frames"] - UNTIL_ANSWERED)
        self.assertGreater(scenario["attitudes_used"], 0.8 * row["answers"])
        self.assertEqual((row["attitudes"], row["of_no_frame"], row["damaged"]), (row["answers"], 0, 0))
        # Half an exposure, drawing, the tracker; the rest is a busy machine's.
        self.assertGreater(row["latency"]["p50_ms"], EXPOSURE_MS / 2 + THINKS_MS)
        self.assertLess(row["latency"]["p50_ms"], EXPOSURE_MS / 2 + THINKS_MS + 100.0)
        self.assertGreaterEqual(row["since_sent"]["p50_ms"], THINKS_MS)
        self.assertLess(row["since_sent"]["p50_ms"], row["latency"]["p50_ms"] - EXPOSURE_MS / 2 + 1.0)
        self.assertGreaterEqual(row["latency"]["max_ms"], row["latency"]["p99_ms"])
        # The stand-in's noise: 5 arcsec about x and y each, 40 about the boresight.
        self.assertAlmostEqual(row["error_across_arcsec"], 7.1, delta=1.5)
        self.assertAlmostEqual(row["error_about_arcsec"], 40.0, delta=8.0)
        self.assertIn(f"{row['answers']} answers to {row['frames']} frames", self.printed["good"])
        self.assertIn("<td>answer</td>", (self.flights["good"].out / "report.html").read_text())

    def test_control_a_tracker_that_is_off_takes_the_boresight_there(self):
        status, summary, scenario = self.ended["off"]
        self.assertEqual((status, summary["verdict"]), (4, "FAILED"))
        self.assertAlmostEqual(scenario["pointing"]["boresight_arcsec"], OFF_ARCSEC, delta=100.0)
        self.assertAlmostEqual(scenario["knowledge"]["boresight_arcsec"], OFF_ARCSEC, delta=10.0)
        self.assertAlmostEqual(self.answers("off")["error_across_arcsec"], OFF_ARCSEC, delta=3.0)

    def test_late_and_missing_answers_are_events_counts_and_reasons(self):
        status, summary, _ = self.ended["poor"]
        row, events = self.answers("poor"), summary["event_counts"]
        self.assertEqual((events["answer_late"], events["answer_missing"]), (row["late"], row["missing"]))
        self.assertGreaterEqual(row["late"], 3)
        self.assertGreater(row["missing"], 10)
        self.assertEqual(row["frames"], row["answers"] + row["missing"] + row["not_judged"])
        self.assertIn(status, (4, 6))
        [missing] = [reason for reason in summary["reasons"] if reason["kind"] == "answer_missing"]
        self.assertEqual((missing["word"], missing["count"]), ("INCOMPLETE", row["missing"]))
        self.assertIn("late answers of trackers outside (late_answers_at_most = 40)", " ".join(summary["limits_used"]))
        lines = [event for event in summary["last_events"] if event["kind"] == "answer_late"]
        self.assertTrue(all(event["frame"] is not None for event in lines) and lines)

    def test_control_without_a_tracker_nothing_points(self):
        status, summary, scenario = self.ended["none"]
        row = self.answers("none")
        self.assertEqual((row["answers"], row["missing"] + row["not_judged"]), (0, row["frames"]))
        self.assertEqual((status, scenario["attitudes_used"]), (4, 0))
        self.assertIn("answer_missing", [reason["kind"] for reason in summary["reasons"]])

    def test_the_virtual_clock_and_a_second_tracker_of_a_head_are_refused(self):
        folder = folder_for(self)
        bench = folder / "bench.toml"
        bench.write_text(bench_text(folder))
        done = support.starloop("run", bench, "--clock", "virtual", status=2)
        self.assertIn("[[tracker_in]], a star tracker outside", done.stderr)
        bench.write_text(bench_text(folder) + '[[tracker_in]]\nlink = "tcp"\nlisten = 0\n')
        done = support.starloop("check", bench, status=(1, 2))
        self.assertIn("one tracker for each head", done.stderr)


THREE = """
[[head]]
sensor_from_body = [0.92387953, 0.38268343, 0.0, 0.0]
[[head]]
sensor_from_body = [0.92387953, -0.19134172, 0.33141357, 0.0]
[[head]]
sensor_from_body = [0.92387953, -0.19134172, -0.33141357, 0.0]
[[tracker_in]]
head = 1
protocol = "canopen"
link = "slcan_tcp"
listen = {slcan}
[[tracker_in]]
head = 2
protocol = "canopen"
link = "bus"
node_id = 100
[[event]]
do = "tracker_off"
head = 0
at_s = 10.0
for_s = 5.0
"""


class Heads(unittest.TestCase):
    """Three heads, each with a tracker on another line."""

    def test_three_trackers_on_three_lines_fly_one_spacecraft(self):
        slcan, bus = free_port(), free_port()
        more = THREE.format(slcan=slcan)

        def tracker(head, port, *options):
            return lambda folder, text: (
                sys.executable, TRACKER, f"{folder}/frames_head{head}", f"127.0.0.1:{port or port_in(text)}", *options)

        trackers = [tracker(0, None, "--by-time"), tracker(1, slcan, "--node", 96), tracker(2, bus, "--node", 100)]
        flight = Flight(self, lambda folder: bench_text(folder, more), trackers, "--duration", 40, "--set", f"link.slcan_tcp={bus}")
        status, summary, scenario = flight.ended()
        self.assertEqual((status, summary["verdict"]), (0, "ok"), flight.printed)
        rows = {row["place"]: row for row in summary["answers"]}
        self.assertEqual({row["head"]: row["protocol"] for row in rows.values()}, {0: "json", 1: "canopen", 2: "canopen"})
        for row in rows.values():
            self.assertGreater(row["answers"], row["frames"] - UNTIL_ANSWERED, row)
            self.assertAlmostEqual(row["error_across_arcsec"], 7.1, delta=1.5)
        # The spacecraft was deaf to the first one for five seconds.
        [off] = scenario["faults"]
        self.assertAlmostEqual(off["hits"], 25, delta=8)
        self.assertLess(scenario["attitudes_used"], sum(row["answers"] for row in rows.values()) - off["hits"] + 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
