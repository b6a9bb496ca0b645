"""Triggers that start exposures on the real clock: python3 hil_scripts/tests/test_triggers.py

Edges of a trigger line, the control socket, a message of the bus and a network camera's client; the delays from command
to exposure are printed as a table, and measured only. The line is a named pipe with events of the kernel's form; where
the kernel has simulated GPIO chips (/sys/kernel/config/gpio-sim, writable), the same is done with one of those. Needs
aravis (apt) beside requirements_flight_computer.txt.
"""

import os
import time
import unittest
from pathlib import Path

from support import ROOT, starloop
import trigger_delays
from trigger_delays import LINE, PAUSE_S, Bench, attitude_errors_arcsec, delays_us, start_ns, table

GPIO_SIM = Path("/sys/kernel/config/gpio-sim")
#: Two readings of two clocks each, on a machine that does other things: far more than they are apart, far less than a frame.
CLOCKS_NS = 2_000_000


class Delays(unittest.TestCase):
    def test_every_source_starts_exposures_and_the_attitude_is_that_of_the_trigger(self):
        count = 25
        shots, frames, offset_ns, report = trigger_delays.measure(count)
        print(f"\n{table(shots, frames, offset_ns)}")
        for name, of_source in shots.items():
            self.assertEqual(len(frames[name]), count, f"{name}: {report['event_counts']}")
            for (before, after), row in zip(of_source, frames[name]):
                # The exposure starts within the call that triggers it.
                start = start_ns(row) - offset_ns
                self.assertGreaterEqual(start, before - CLOCKS_NS, name)
                self.assertLessEqual(start, after + CLOCKS_NS, name)
            swapped = [start_ns(row) - offset_ns for row in frames[name][1:]]
            outside = [not before <= start <= after + CLOCKS_NS for (before, after), start in zip(of_source, swapped)]
            self.assertTrue(all(outside), f"control: {name}, each trigger with the next exposure")
        rows = sorted(sum(frames.values(), []), key=start_ns)
        self.assertLess(max(attitude_errors_arcsec(rows)), 2.0, "0.6 ms of the turn")
        late = [{**row, "mid_exposure_tai_ns": int(row["mid_exposure_tai_ns"]) + 3_000_000 * (k > 0)} for k, row in enumerate(rows)]
        self.assertGreater(min(attitude_errors_arcsec(late)), 2.0, "control: exposures 3 ms later")
        # Those at the frame rate before the line took over are none: it arms the head from the start.
        self.assertEqual(report["stages"]["trigger"]["count"], 4 * count)
        self.assertEqual(sum(report["event_counts"].get(f"camera_trigger_{word}", 0) for word in ("missed", "ignored")), 0)
        self.assertEqual(len(delays_us(shots["bus"], frames["bus"], offset_ns)), count)


class Lines(unittest.TestCase):
    def test_the_width_of_a_pulse_is_the_exposure(self):
        widths = (0.004, 0.011, 0.0305, 0.06)
        with Bench(more='exposure = "trigger_width"') as bench:
            bench.wait_for_attitudes()
            stamps = []
            for width in widths:
                stamps.append(bench.line.pulse(width))
                time.sleep(PAUSE_S)
            bench.wait_for_frames(len(widths))
            report, rows = bench.finish(), bench.rows()
        self.assertEqual([row["started_by"] for row in rows], ["line"] * len(widths))
        for (rise, fall), row in zip(stamps, rows):
            self.assertAlmostEqual(float(row["exposure_s"]) * 1e9, fall - rise, delta=CLOCKS_NS)
        self.assertGreater(abs(float(rows[0]["exposure_s"]) * 1e9 - (stamps[2][1] - stamps[2][0])), CLOCKS_NS, "control")
        self.assertEqual(report["event_counts"].get("camera_trigger_missed", 0), 0)

    def test_edges_that_come_too_early_and_edges_that_are_lost_are_counted(self):
        with Bench(more='edge = "falling"') as bench:
            bench.loop.camera(exposure_us=50000, trigger_overlap="off")
            bench.wait_for_attitudes()
            bench.line.edge(True)
            now = time.clock_gettime_ns(time.CLOCK_REALTIME)
            # 50 ms of exposure and 20 ms of readout: the second one comes within them. Stamped apart, whenever they are written.
            for at_ms, is_rising in ((0, False), (10, True), (30, False), (40, True), (120, False)):
                time.sleep(max(0.0, (now - time.clock_gettime_ns(time.CLOCK_REALTIME)) * 1e-9 + at_ms * 1e-3))
                bench.line.edge(is_rising, at_ns=now + at_ms * 1_000_000)
            bench.wait_for_frames(2)
            # Frames are drawn while they are read out.
            time.sleep(PAUSE_S)
            before = bench.loop.state()["events"]
            bench.line.edge(True, lost=3)
            bench.line.edge(False)
            bench.wait_for_frames(3)
            report, rows = bench.finish(), bench.rows()
        self.assertEqual(before.get("camera_trigger_missed", 0), 1)
        self.assertEqual(before.get("trigger_edge_lost", 0), 0)
        self.assertEqual(report["event_counts"]["trigger_edge_lost"], 3)
        self.assertEqual((len(rows), report["event_counts"]["camera_trigger_missed"]), (3, 1))
        self.assertAlmostEqual(start_ns(rows[1]) - start_ns(rows[0]), 120_000_000, delta=CLOCKS_NS, msg="falling edges")

    def test_delay_and_burst_count_from_the_edge(self):
        with Bench() as bench:
            bench.loop.camera(exposure_us=20000, trigger_delay_us=7000, burst=3, frame_rate_hz=20)
            bench.wait_for_attitudes()
            stamps = []
            for _ in range(2):
                stamps.append(bench.line.pulse()[0])
                time.sleep(0.4)
            bench.wait_for_frames(6)
            report, rows = bench.finish(), bench.rows()
        starts = [start_ns(row) for row in rows]
        self.assertEqual(len(starts), 6, report["event_counts"])
        self.assertAlmostEqual(starts[3] - starts[0], stamps[1] - stamps[0], delta=CLOCKS_NS)
        for first, second in ((0, 1), (1, 2), (3, 4), (4, 5)):
            self.assertAlmostEqual(starts[second] - starts[first], 50_000_000, delta=10)
        self.assertAlmostEqual(report["stages"]["trigger"]["p50_ms"], 57.0, delta=1.5, msg="7, 57 and 107 ms after its edge")

    def test_a_line_that_is_not_armed_and_another_head_are_left_alone(self):
        with Bench(more="armed = false") as bench:
            bench.wait_for_attitudes()
            bench.line.pulse()
            until = time.monotonic() + 20.0
            while not bench.loop.state()["events"].get("camera_trigger_ignored") and time.monotonic() < until:
                time.sleep(0.05)
            report, rows = bench.finish(), bench.rows()
        self.assertEqual(report["event_counts"]["camera_trigger_ignored"], 1)
        self.assertEqual({row["started_by"] for row in rows}, {"rate"})

    def refusal(self, *words, text):
        done = starloop("run", *words, *text)
        self.assertNotEqual(done.returncode, 0)
        return done.stdout + done.stderr

    def test_impossible_triggers_are_refused_in_a_sentence(self):
        bench = str(ROOT / "configs/benches/loopback.toml")
        line = ["--set", 'trigger_line=[{chip="gpiochip_none",line=1}]', "--duration", "1", "--sink", "null"]
        said = self.refusal("--clock", "virtual", text=[bench, *line])
        self.assertIn("a GPIO line", said)
        self.assertIn("--clock real", said)
        said = self.refusal("--clock", "real", text=[bench, *line])
        self.assertIn("/dev/gpiochip_none", said)
        self.assertIn("gpiodetect", said)
        line[1] = 'trigger_line=[{chip="gpiochip_none",line=1,head=2}]'
        self.assertIn("trigger_line[0].head is 2", self.refusal("--clock", "real", text=[bench, *line]))


class SimulatedChip:
    """A chip that the kernel simulates: a line that is pulled up and down through sysfs."""

    def __init__(self, name="starloop"):
        self.folder = GPIO_SIM / name
        bank = self.folder / "bank0"
        bank.mkdir(parents=True)
        (bank / "num_lines").write_text("8")
        (self.folder / "live").write_text("1")
        device = (self.folder / "dev_name").read_text().strip()
        self.chip = (bank / "chip_name").read_text().strip()
        self.pull = Path(f"/sys/devices/platform/{device}/{self.chip}/sim_gpio{LINE}/pull")

    def pulse(self, width_s=0.001):
        for word in ("pull-up", "pull-down"):
            self.pull.write_text(word)
            time.sleep(width_s)

    def close(self):
        (self.folder / "live").write_text("0")
        (self.folder / "bank0").rmdir()
        self.folder.rmdir()


# Without such chips in this kernel there is nothing to run: the class is not there, and nothing is left out of what is listed.
if GPIO_SIM.is_dir() and os.access(GPIO_SIM, os.W_OK):

    class KernelLines(unittest.TestCase):
        def test_edges_of_a_simulated_chip_start_exposures(self):
            chip = SimulatedChip(f"starloop{os.getpid()}")
            self.addCleanup(chip.close)
            with Bench(chip=f"/dev/{chip.chip}") as bench:
                bench.loop.camera(exposure_us=20000)
                bench.wait_for_attitudes()
                calls = []
                for _ in range(10):
                    calls.append(trigger_delays.dated(chip.pulse))
                    time.sleep(PAUSE_S)
                bench.wait_for_frames(10)
                report, rows = bench.finish(), bench.rows()
            self.assertEqual([row["started_by"] for row in rows], ["line"] * 10)
            least = max(before - start_ns(row) for (before, _), row in zip(calls, rows))
            most = min(after - start_ns(row) for (_, after), row in zip(calls, rows))
            self.assertLessEqual(least, most, "one distance of the clocks puts every exposure into its pulse")
            self.assertEqual(report["event_counts"].get("trigger_edge_lost", 0), 0)


if __name__ == "__main__":
    unittest.main()
