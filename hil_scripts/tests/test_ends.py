"""Tests of how starloop ends: python3 hil_scripts/tests/test_ends.py

Signals, losses, full and closed standard streams.
"""

import json
import os
import random
import re
import signal
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

from support import BINARY, CAMERA, PATIENCE_S, ROOT, InAFolder, Running, bench_text, ran, starloop, summary_of, until

LOST = 5
RECORDER = '[sink]\nkind = "recorder"\nfits = true\n'
# A program started by one that ignores a signal (such as nohup) ignores it too: the programs below start with the defaults.
CAUGHT = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SIGNALS = ((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129))


def default_signals():
    """Restores what signals do at the start of a program, whatever this one was started with."""
    for number in CAUGHT:
        signal.signal(number, signal.SIG_DFL)


class Case(InAFolder):
    def bench(self, more=RECORDER):
        return self.written("bench.toml", bench_text("ends") + more)

    def run_words(self, *words, bench=RECORDER):
        return ["run", self.bench(bench), "--backend", "cpu", "--out", str(self.out), "--quiet", *words]

    def start(self, *words, **options):
        """Starts the program; `said` has what it says on standard error, `process` the rest."""
        return self.enterContext(Running(BINARY, *words, cwd=self.folder, **{"preexec_fn": default_signals, **options}))

    def done(self, *words, **options):
        return starloop(*words, cwd=self.folder, timeout=PATIENCE_S, **options)

    def after_frames(self, program, count=3):
        path = self.out / "frames.csv"
        rows = lambda: path.read_text().count("\n") if path.exists() else 0
        until("frames", lambda: program.process.poll() is not None or rows() > count)
        self.assertIsNone(program.process.poll(), "it runs")

    def summary(self):
        return summary_of(self.out)

    def parts(self):
        return [str(path) for path in self.folder.rglob("*.part")]


class Signals(Case):
    def test_every_signal_leaves_a_complete_output_folder(self):
        for number, status in SIGNALS:
            with self.subTest(signal=number), tempfile.TemporaryDirectory() as scratch:
                self.folder = Path(scratch)
                self.out = self.folder / "run"
                ring, capture = self.folder / "ring", self.folder / "capture"
                ring_sink = f'[[extra_sink]]\nkind = "shared_memory"\npath = "{ring}"\nslots = 4\n'
                words = self.run_words("--duration", "600", "--capture", str(capture), bench=RECORDER + ring_sink)
                program = self.start(*words)
                self.after_frames(program)
                self.assertTrue(ring.exists())
                program.stop(number)
                self.assertEqual(program.process.returncode, status, program.said)
                summary = self.summary()
                self.assertEqual(summary["losses"], [])
                delivered = summary["frames"]["delivered"]
                self.assertGreaterEqual(delivered, 3)
                self.assertEqual(len(list(self.out.glob("frame_*.fits"))), delivered)
                self.assertIsNotNone(json.loads((capture / "session.json").read_text())["end"])
                self.assertFalse(ring.exists(), "the ring is removed")
                self.assertEqual(self.parts(), [])

    def test_a_link_of_a_killed_run_is_taken_over_and_removed_at_the_end(self):
        line = self.folder / "line"
        gateway = f'[link]\nkind = "simulated"\nwire = "can_fd"\nslcan_pty = "{line}"\n'
        words = self.run_words("--duration", "600", "--sink", "null", bench=gateway + RECORDER)
        for number in (signal.SIGKILL, signal.SIGTERM):
            program = self.start(*words)
            until("the link", lambda: program.process.poll() is not None or line.is_symlink() and line.exists())
            self.assertIsNone(program.process.poll(), "it runs")
            program.stop(number)
            self.assertEqual(line.is_symlink(), number == signal.SIGKILL, "control: SIGKILL cannot be caught")

    def test_a_second_signal_ends_the_program_at_once(self):
        # A bus that cannot print its addresses: the pipe is not read, and is full.
        readable, writable = os.pipe()
        os.set_blocking(writable, False)
        with self.assertRaises(BlockingIOError):
            while True:
                os.write(writable, bytes(4096))
        os.set_blocking(writable, True)
        line = self.folder / "line"
        program = self.start("bus", "--slcan-pty", str(line), stdout=writable)
        until("the link", lambda: program.process.poll() is not None or line.is_symlink())
        program.process.send_signal(signal.SIGTERM)
        time.sleep(0.01)
        # As timeout does, which sends to the program and to its group.
        program.process.send_signal(signal.SIGTERM)
        time.sleep(0.6)
        self.assertIsNone(program.process.poll(), "control: the first signal, sent twice, waits for the end of the command")
        program.stop(signal.SIGTERM)
        self.assertEqual(program.process.returncode, 143)
        os.close(readable)
        os.close(writable)

    def test_below_timeout_a_run_has_its_summary(self):
        done = ran("timeout", "2", BINARY, *self.run_words("--duration", "600"), cwd=self.folder)
        self.assertEqual(done.returncode, 124, done.stderr)
        self.assertEqual(self.summary()["verdict"], "INCOMPLETE", done.stderr)

    def test_early_signals_are_never_lost(self):
        dice = random.Random(7)
        for _ in range(15):
            words = self.run_words("--duration", "600", "--sink", "null")
            program = self.start(*words)
            # The status of a process lists the signals that it catches: from then on none is lost.
            self.catches(program, signal.SIGINT)
            time.sleep(dice.uniform(0.0, 0.4))
            program.stop(signal.SIGINT)
            self.assertEqual(program.process.returncode, 130, program.said)

    def catches(self, program, number):
        def is_caught():
            status = Path(f"/proc/{program.process.pid}/status").read_text()
            mask = re.search(r"SigCgt:\s*([0-9a-f]+)", status)
            return mask is not None and int(mask[1], 16) >> (number - 1) & 1 == 1

        until("its handlers", lambda: program.process.poll() is not None or is_caught())
        self.assertIsNone(program.process.poll(), "it runs")

    def test_hang_ups_stay_ignored_below_nohup(self):
        ignore = lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)
        program = self.start(*self.run_words("--duration", "600"), preexec_fn=ignore)
        self.after_frames(program, 1)
        program.process.send_signal(signal.SIGHUP)
        self.after_frames(program, 8)
        program.stop(signal.SIGTERM)
        self.assertEqual(program.process.returncode, 143, "control: this one is not ignored")

    def test_commands_that_write_files_leave_none_half_written(self):
        commands = [
            ["chart", "--out", "charts"],
            ["study", str(ROOT / "configs/scenarios/study.toml"), "--out", "study"],
            ["catalog", "synthesize", "--out", "layers", "--stars", "30000000"],
            ["campaign", "--hours", "100", "--out", "campaign.jsonl"],
            ["bus", "--slcan-pty", "line"],
        ]
        for words in commands:
            program = self.start(*words)
            self.catches(program, signal.SIGTERM)
            time.sleep(1.0)
            self.assertIsNone(program.process.poll(), f"{words}: wanted a command that takes longer")
            program.stop(signal.SIGTERM)
            self.assertEqual(program.process.returncode, 0 if words[0] == "bus" else 143, f"{words}: {program.said}")
            self.assertEqual(self.parts(), [], words)
        self.assertFalse((self.folder / "line").is_symlink())


class Losses(Case):
    def test_a_recorder_that_drops_frames_is_an_exit_status_and_one_line(self):
        recorder = 'kind = "recorder"\nfits = true\npng_every = 1\nqueue = 1\n'
        sinks = "[sink]\n" + recorder + ("[[extra_sink]]\n" + recorder) * 14
        # A PNG is packed in more than 2.5 ms on any machine, and takes longer than drawing its frame on a slow one.
        settings = ["timing.frame_rate_hz=400", "camera.exposure.exposure_s=0.001", "camera.exposure.readout_s=0.001"]
        words = ["--duration", "1"] + [word for setting in settings for word in ("--set", setting)]
        done = self.done(*self.run_words(*words, bench=sinks), status=LOST)
        self.assertEqual((done.stdout, done.stderr.count("\n")), ("", 1), done.stderr)
        self.assertRegex(done.stderr, r"lost: sink \(recorder\): \d+ of \d+ frames dropped")
        summary = self.summary()
        dropped = {row["place"]: row["dropped"] for row in summary["sinks"] if row["dropped"]}
        self.assertTrue(dropped)
        lost = {loss["name"].split()[0]: loss["count"] for loss in summary["losses"]}
        self.assertEqual(lost, dropped)

    def test_a_run_that_loses_nothing_is_status_0(self):
        done = self.done(*self.run_words("--clock", "virtual", "--duration", "0.5"))
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        self.assertEqual(self.summary()["losses"], [])

    def test_a_summary_that_cannot_be_written_is_a_loss(self):
        (self.out / "summary.json").mkdir(parents=True)
        done = self.done(*self.run_words("--clock", "virtual", "--duration", "0.5"))
        self.assertEqual((done.returncode, done.stdout), (LOST, ""), done.stderr)
        self.assertRegex(done.stderr, r"^starloop: lost: summary.json: not written: .*\n$")

    def test_slots_missed_while_the_program_was_stopped_are_not_the_sinks(self):
        program = self.start(*self.run_words("--duration", "6"))
        self.after_frames(program, 5)
        program.process.send_signal(signal.SIGSTOP)
        time.sleep(2.5)
        program.stop(signal.SIGCONT)
        misses = self.summary()["misses"]
        busy = misses.pop("sink_busy", misses.pop("sink busy", 0))
        self.assertGreater(sum(misses.values()), 10, f"{misses} {program.said}")
        self.assertLess(busy, 8, misses)


class Streams(Case):
    def to_full(self, *words, stream="stdout"):
        with open("/dev/full", "w") as full:
            streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, stream: full}
            return self.done(*words, capture_output=False, **streams)

    def test_a_full_output_is_an_error_and_no_panic(self):
        virtual = ("--clock", "virtual", "--duration", "0.3", "--sink", "null")
        commands = [
            ["--help"],
            ["check"],
            ["run", self.bench(), *virtual],
            ["snr", str(CAMERA)],
            ["psf", str(CAMERA)],
            ["catalog", "info"],
            ["catalog", "query", "--ra", "10", "--dec", "20", "--radius", "5"],
            ["bus", "--slcan-tcp", "0", "--duration", "0.1"],
        ]
        for words in commands:
            done = self.to_full(*words)
            self.assertEqual(done.returncode, 1, f"{words}: {done.stderr}")
            self.assertIn("cannot write to standard output: No space left on device", done.stderr, words)
            self.assertNotIn("panicked", done.stderr, words)

    def test_a_run_whose_messages_cannot_be_written_goes_to_its_end(self):
        words = self.run_words("--clock", "virtual", "--duration", "0.5")
        words.remove("--quiet")
        done = self.to_full(*words, stream="stderr")
        self.assertEqual(done.returncode, 1)
        self.assertIn("cannot write to standard error", done.stdout)
        self.assertEqual(self.summary()["frames"]["delivered"], 5)

    def test_a_reader_that_goes_away_ends_a_command_silently(self):
        commands = [
            ["catalog", "query", "--ra", "10", "--dec", "20", "--radius", "60"],
            ["snr", str(CAMERA)],
            ["check"],
            ["--help"],
        ]
        for words in commands:
            readable, writable = os.pipe()
            os.close(readable)
            done = self.done(*words, capture_output=False, stdout=writable, stderr=subprocess.PIPE)
            os.close(writable)
            self.assertEqual((done.returncode, done.stderr), (141, ""), words)


if __name__ == "__main__":
    unittest.main()
