"""A plant outside in lockstep, and control outside, through the Python client: python3 hil_scripts/tests/test_lockstep.py

The examples of starloop/client.py are executed too.
"""

import doctest
import math
import os
import tempfile
import time
import unittest
from pathlib import Path

from support import BINARY, ROOT, InAFolder, about_y, product, starloop
from starloop import client as starloop_client
from starloop.client import Starloop, StarloopError, attitude_sample, mrp_of_wxyz, wxyz_of_mrp

BENCH = ROOT / "configs/benches/lockstep.toml"
#: A flight inside that is over soon.
SMALL = {"duration_s": 3.0, "expect.window_s": 1.0, "bench.camera": "../cameras/small_tracker.toml"}
#: Where the attitude of a frame came from, while its sender is there.
LIVE = ("interpolated", "predicted")
#: Turn of the samples, rad/s about the body's y axis.
RATE = 0.01


def turned(t_s):
    """Attitude and rate: a body that is turned by +a about an axis has the quaternion (cos a/2, -sin a/2)."""
    return about_y(RATE * t_s), [0.0, RATE, 0.0]


def samples(count=130):
    return [attitude_sample(round(0.01 * k - 0.1, 9), *turned(round(0.01 * k - 0.1, 9))) for k in range(count)]


def start(**changes):
    return Starloop.start(BINARY, BENCH, **{"settings": {"timing.duration_s": 1.0}, **changes})


def frames(batch, steps, rows=None):
    """Flies a second in batches and steps of other sizes; number, CRC-32 and attitude of each frame."""
    rows, seen = rows or samples(), {}
    with start() as loop:
        steps, now_s = iter(steps), -1.0
        while now_s < 1.0:
            until_s = min(1.0, now_s + next(steps))
            while rows and rows[0][0] <= until_s:
                loop.attitude(rows[:batch])
                rows = rows[batch:]
            step = loop.step(until_s=until_s)
            now_s = until_s
            if loop.state()["frames"]["delivered"]:
                facts = loop.frame_facts()
                seen[facts["number"]] = (facts["crc32"], facts["meta"]["attitude_wxyz"], facts["mid_exposure_s"])
            if step["finished"]:
                break
        loop.finish()
    return {number: crc32 for number, (crc32, *_) in seen.items()}, seen


def cycle(*lengths):
    while True:
        yield from lengths


class PlantOutside(unittest.TestCase):
    def test_batches_and_steps_of_any_size_give_the_same_bits(self):
        crc32, seen = frames(1, cycle(0.05))
        self.assertEqual(sorted(crc32), list(range(10)))
        self.assertEqual(frames(1000, cycle(0.05))[0], crc32)
        odd = frames(17, cycle(0.033, 0.1, 0.0007))[0]
        self.assertGreaterEqual(len(odd), 9, "a step to the end may bring two frames")
        self.assertEqual(odd, {number: crc32[number] for number in odd})
        for number, (_, wxyz, mid_s) in seen.items():
            wanted, _ = turned(mid_s)
            nearest = min(math.dist(wxyz, [sign * part for part in wanted]) for sign in (1.0, -1.0))
            self.assertLess(math.degrees(2.0 * nearest) * 3600.0, 1e-3, f"frame {number}")
            conjugated = [wanted[0], *(-part for part in wanted[1:])]
            self.assertGreater(math.degrees(2.0 * math.dist(wxyz, conjugated)) * 3600.0, 50.0, "control")
        moved = samples()
        moved[60] = attitude_sample(moved[60][0], turned(moved[60][0] + 0.01)[0], turned(0.0)[1])
        self.assertNotEqual(frames(17, cycle(0.05), moved)[0], crc32, "control: one other sample, other bits")

    def test_bad_samples_are_refused_and_counted_and_the_session_goes_on(self):
        with start() as loop:
            self.assertIn("attitude", loop.hello["requests"])
            loop.attitude(samples())
            loop.step(until_s=0.3)
            good = attitude_sample(1.5, (1, 0, 0, 0), (0, 0, 0))
            for rows, part in (
                ([attitude_sample(0.3, (1, 0, 0, 0), (0, 0, 0))], "an old attitude is never shown as a new one"),
                ([good, attitude_sample(1.6, (1, 0, 0, 0.1), (0, 0, 0))], r"samples\[1\] has a quaternion of norm 1.00498"),
                ([good, good], "of this instant already"),
                ([[1.0, 2.0]], "has 2 numbers"),
            ):
                with self.assertRaisesRegex(StarloopError, part):
                    loop.attitude(rows)
            with self.assertRaises(ValueError):
                loop.attitude([attitude_sample(1.5, (1, 0, 0, math.nan), (0, 0, 0))])
            with self.assertRaisesRegex(StarloopError, "unit is \"mile\""):
                loop.observer([(1.0, 7000, 0, 0, 0, 7, 0)], unit="mile")
            self.assertEqual(loop.state()["events"]["sample_refused"], 1 + 1 + 2 + 1 + 1)
            loop.step(until_s=1.0)
            self.assertEqual(loop.frame_facts()["meta"]["origin"], "interpolated")
            loop.finish()

    def test_long_lists_go_in_several_requests(self):
        with start() as loop:
            rows = [attitude_sample(round(1e-4 * k, 9), *turned(1e-4 * k)) for k in range(5000)]
            self.assertEqual(loop.attitude(rows)["taken"], 5000)
            self.assertEqual(loop.jitter((0.001 * k, 0.1, 0.2, 0.0) for k in range(900))["waiting"], 5900)

    def test_a_plant_inside_takes_no_samples(self):
        with Starloop.start(BINARY, ROOT / "configs/scenarios/acquisition.toml", settings=SMALL) as loop:
            with self.assertRaisesRegex(StarloopError, 'wanted a bench with plant.kind = "outside"'):
                loop.attitude(samples())

    def test_mrp_and_quaternion_are_each_others_inverse(self):
        # The case of the convention: turned by +a about x, q = (cos a/2, -sin a/2, 0, 0), sigma = (tan a/4, 0, 0).
        a = 0.7
        for got, wanted in zip(wxyz_of_mrp((math.tan(a / 4), 0, 0)), (math.cos(a / 2), -math.sin(a / 2), 0, 0)):
            self.assertAlmostEqual(got, wanted, places=15)
        for got, wanted in zip(mrp_of_wxyz(wxyz_of_mrp((0.1, -0.2, 0.3))), (0.1, -0.2, 0.3)):
            self.assertAlmostEqual(got, wanted, places=15)


class ThreeHeads(unittest.TestCase):
    HEADS = [[1.0, 0.0, 0.0, 0.0], [0.92387953, 0.38268343, 0.0, 0.0], [0.92387953, -0.19134172, 0.33141357, 0.0]]

    def bench(self, folder):
        heads = "".join(f"[[head]]\nsensor_from_body = {head}\n" for head in self.HEADS)
        path = Path(folder) / "three.toml"
        camera = ROOT / "configs/cameras/small_tracker.toml"
        path.write_text(f'name = "three"\ncamera = "{camera}"\nseed = 1\n[plant]\nkind = "outside"\n[plant.tracker]\n'
                        f'[timing]\nframe_rate_hz = 10.0\nduration_s = 1.0\n[sink]\nkind = "null"\n{heads}')
        return path

    def test_each_head_shows_the_attitude_that_was_sent(self):
        with tempfile.TemporaryDirectory() as folder, Starloop.start(BINARY, self.bench(folder)) as loop:
            loop.attitude(samples())
            loop.step(until_s=0.9)
            facts = [loop.frame_facts(head) for head in range(3)]
            found = [loop.tracker(head) for head in range(3)]
            self.assertEqual(loop.hello["heads"], 3)
            with self.assertRaisesRegex(StarloopError, "3"):
                loop.frame_facts(3)
        for head, reported in zip(self.HEADS, facts):
            wanted = product(head, turned(reported["mid_exposure_s"])[0])
            off = min(math.dist(reported["meta"]["attitude_wxyz"], [sign * part for part in wanted]) for sign in (1.0, -1.0))
            # The mountings of the file have eight digits.
            self.assertLess(math.degrees(2.0 * off) * 3600.0, 0.02)
        self.assertEqual(len({reported["crc32"] for reported in facts}), 3, "three images")
        for reported in found:
            wanted, _ = turned(reported["mid_exposure_s"])
            off = min(math.dist(reported["body_from_icrf"], [sign * part for part in wanted]) for sign in (1.0, -1.0))
            self.assertTrue(reported["valid"])
            self.assertLess(math.degrees(2.0 * off) * 3600.0, 60.0, "each tracker finds the body's attitude")


class ControlOutside(unittest.TestCase):
    def test_wheels_want_a_hand_over(self):
        with Starloop.start(BINARY, ROOT / "configs/scenarios/acquisition.toml", settings=SMALL) as loop:
            with self.assertRaisesRegex(StarloopError, "wanted a hand-over"):
                loop.wheels([0.01, 0.0, 0.0, 0.0])
            self.assertEqual(loop.control(by="outside", trackers="outside")["control"], "outside")
            before = loop.step(until_s=1.0) and loop.truth()
            loop.wheels([0.01, 0.0, 0.0, 0.0])
            with self.assertRaisesRegex(StarloopError, "wanted those of 4"):
                loop.wheels([0.01])
            loop.torque([0.05, 0.0, 0.0], for_s=0.5, at_s=1.2)
            after = loop.step(until_s=2.0) and loop.truth()
            speeds = [b - a for a, b in zip(before["wheel_speeds_rad_s"], after["wheel_speeds_rad_s"])]
            self.assertAlmostEqual(speeds[0], 0.01 / 1.6e-3, delta=1.0)
            self.assertLess(max(abs(speed) for speed in speeds[1:]), 1.0, "control: the others coast")


    def test_the_real_clock_takes_commands_and_no_samples_of_a_plant_inside(self):
        scenario, settings = ROOT / "configs/scenarios/acquisition.toml", {**SMALL, "duration_s": 20.0}
        with Starloop.start(BINARY, scenario, clock="real", settings=settings) as loop:
            self.assertEqual(loop.hello["clock"], "real")
            with self.assertRaisesRegex(StarloopError, "come by its link, or from inside"):
                loop.attitude(samples())
            with self.assertRaisesRegex(StarloopError, "wanted a hand-over"):
                loop.wheels([0.0, 0.0, 0.0, 0.0])
            self.assertEqual(loop.control(by="outside")["control"], "outside")
            self.assertEqual(loop.wheels([0.01, 0.0, 0.0, 0.0])["control"], "outside")
            self.assertEqual(loop.control(by="inside")["control"], "inside", "control: it can be given back")
            loop.finish()


class RealTime(InAFolder):
    """A plant outside on the real clock: samples by the run's time, as they come."""

    def fly(self, folder, seconds, edit=lambda rows, t_s: rows):
        """Sends a slew a sample each 20 ms; the facts of the newest frame after each, and the state in the end."""
        out = Path(folder) / "out"
        arguments = ["--capture", str(Path(folder) / "capture"), "--out", str(out), "--sink", "null"]
        settings = {"timing.duration_s": seconds + 1.5, "render.backend": "cpu"}
        seen, refusals = {}, []
        with Starloop.start(BINARY, BENCH, clock="real", settings=settings, arguments=arguments) as loop:
            zero = time.monotonic() - loop.hello["now_s"]
            while (t_s := time.monotonic() - zero) < seconds:
                try:
                    loop.attitude(edit([attitude_sample(t_s, *turned(t_s))], t_s))
                except StarloopError as refusal:
                    refusals.append(str(refusal))
                if loop.state()["frames"]["delivered"]:
                    facts = loop.frame_facts()
                    seen[facts["number"]] = facts
                time.sleep(0.02)
            time.sleep(1.2)
            last, state = loop.frame_facts(), loop.state()
            loop.finish()
        return seen, last, state, refusals

    def test_frames_show_what_is_sent_in_time_and_a_sender_that_stops_is_an_event(self):
        seen, last, state, _ = self.fly(self.folder, 3.0)
        shown = [facts for facts in seen.values() if facts["meta"]["origin"] in LIVE and facts["mid_exposure_s"] > 0.3]
        self.assertGreater(len(shown), 10, [facts["meta"]["origin"] for facts in seen.values()])
        mounting = None
        for facts in shown:
            q, _ = turned(facts["mid_exposure_s"])
            got = facts["meta"]["attitude_wxyz"]
            # The sensor's axes turn with the body's: the product with the inverse is the mounting, in every frame the same.
            fixed = product(got, [q[0], -q[1], -q[2], -q[3]])
            mounting = mounting or fixed
            off = min(max(abs(a - s * b) for a, b in zip(fixed, mounting)) for s in (1, -1))
            self.assertLess(off, 1e-7, facts["number"])
            later, _ = turned(facts["mid_exposure_s"] + 0.05)
            self.assertGreater(max(abs(a - b) for a, b in zip(later, q)), 1e-5, "control: 50 ms are seen")
        events = state["events"]
        stale = [events.get(name, 0) for name in ("attitude_held", "blank", "attitude_missing")]
        self.assertGreater(sum(stale), 5, events)
        self.assertNotIn(last["meta"]["origin"], LIVE, "a sender that stopped is not shown as new")
        self.assertIn("bit-identical", starloop("replay", self.folder / "capture", status=0).stdout)

    def test_old_and_jumping_samples_are_refused_and_counted(self):
        def spoilt(rows, t_s):
            if 1.0 < t_s < 1.1:
                return [attitude_sample(t_s - 60.0, *turned(0.0))]
            if 1.2 < t_s < 1.3:
                return [attitude_sample(t_s, [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0])]
            if 1.4 < t_s < 1.5:
                return [[t_s, 1.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0]]
            return rows

        seen, _, state, refusals = self.fly(self.folder, 2.5, spoilt)
        self.assertTrue(refusals and all("norm 1.00498" in refusal for refusal in refusals), refusals)
        self.assertGreaterEqual(state["events"]["sample_refused"], 3, state["events"])
        shown = [facts for facts in seen.values() if facts["meta"]["origin"] in LIVE]
        first = shown[0]["meta"]["attitude_wxyz"]
        for facts in shown:
            along = abs(sum(a * b for a, b in zip(facts["meta"]["attitude_wxyz"], first)))
            self.assertGreater(along, math.cos(0.02), "no frame shows the half turn")


class Examples(unittest.TestCase):
    def test_every_method_has_an_example_that_runs(self):
        names = {**vars(starloop_client), "binary": BINARY, "small": {**SMALL, "tracker.delay_ms": 20.0}}
        flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        finder, runner, here = doctest.DocTestFinder(recurse=True), doctest.DocTestRunner(optionflags=flags), os.getcwd()
        os.chdir(ROOT)
        try:
            tests = [test for test in finder.find(starloop_client, globs=names) if test.examples]
            report = []
            failed = sum(runner.run(test, out=report.append).failed for test in tests)
        finally:
            os.chdir(here)
        self.assertEqual(failed, 0, "".join(report))
        shown = {test.name.rsplit(".", 1)[-1] for test in tests}
        wanted = {"attitude", "observer", "jitter", "event", "tracker", "control", "wheels", "torque", "tracker_attitude"}
        self.assertEqual(wanted - shown, set(), "methods without an example")


if __name__ == "__main__":
    unittest.main(verbosity=2)
