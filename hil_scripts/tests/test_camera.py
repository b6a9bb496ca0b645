"""A camera that a client of the control socket commands: python3 hil_scripts/tests/test_camera.py

Settings of each exposure and the pixels they give, triggers, capture and replay, on both clocks.
"""

import math
import unittest

import numpy

from support import ARCSEC, BINARY, ROOT, InAFolder, about_y, starloop
from starloop.client import Starloop, StarloopError, attitude_sample

OUTSIDE = ROOT / "configs/benches/lockstep.toml"
INSIDE = ROOT / "configs/benches/loopback.toml"
#: Of `configs/cameras/small_tracker.toml`.
GAIN_E_PER_DN, READ_NOISE_E, BLACK_DN, READOUT_S = 25.1, 55.0, 100.0, 0.02
#: Nothing that differs from pixel to pixel or from frame to frame but shot and read noise.
PLAIN = {"camera.detector.prnu": 0.0, "camera.detector.dsnu_e_rms": 0.0}
#: A sky so bright that stars do not matter.
BRIGHT = {"camera.detector.dark_e_per_s": 80000.0, "camera.radiometry.limiting_mag": 3.5, **PLAIN}


def samples(rate_rad_s, until_s):
    """Attitude and rate of a body that turns about y, every 10 ms."""
    counts = range(-20, round(until_s * 100.0) + 20)
    return [attitude_sample(round(0.01 * k, 9), about_y(rate_rad_s * 0.01 * k), [0.0, rate_rad_s, 0.0]) for k in counts]


def outside(duration_s=2.0, rate_rad_s=0.0, arguments=(), **settings):
    """A run whose plant is the client, with all its samples."""
    loop = Starloop.start(BINARY, OUTSIDE, settings={"timing.duration_s": duration_s, **settings}, arguments=arguments)
    loop.attitude(samples(rate_rad_s, duration_s))
    return loop


def next_frame(loop):
    """The pixels above the black level, DN, and what is known of the frame."""
    loop.step(frames=1)
    frame = loop.frame()
    pixels = numpy.array(frame.pixels, dtype=float).reshape(frame.height, frame.width)
    return pixels - frame.info["meta"]["black_level_dn"], frame.info


def mean_and_variance(loop, pairs=4):
    """Mean, and variance by differences of pairs, DN, of the next frames."""
    frames = [next_frame(loop)[0] for _ in range(2 * pairs)]
    variances = [numpy.var(a - b) / 2.0 for a, b in zip(frames[::2], frames[1::2])]
    return float(numpy.mean(frames)), float(numpy.mean(variances))


def turned_off_arcsec(wxyz, rate_rad_s, at_s):
    wanted = about_y(rate_rad_s * at_s)
    return min(2.0 * math.dist(wxyz, [sign * part for part in wanted]) for sign in (1.0, -1.0)) / ARCSEC


class Settings(unittest.TestCase):
    def test_light_and_noise_follow_exposure_and_gain(self):
        got = {}
        with outside(10.0, **BRIGHT) as loop:
            for exposure_us, gain_db in ((20000, 0.0), (50000, 0.0), (50000, 6.0)):
                loop.camera(exposure_us=exposure_us, gain_db=gain_db)
                got[exposure_us, gain_db] = mean_and_variance(loop)
        factor = 10.0 ** (6.0 / 20.0)
        (short, _), (long, noise), (loud, loud_noise) = got.values()
        self.assertAlmostEqual(long / short / 2.5, 1.0, delta=0.01)
        self.assertAlmostEqual(loud / long / factor, 1.0, delta=0.01)
        self.assertAlmostEqual(loud_noise / noise / factor**2, 1.0, delta=0.02)
        for (exposure_us, gain_db), (mean_dn, variance_dn2) in got.items():
            self.assertAlmostEqual(mean_dn * GAIN_E_PER_DN / 10.0 ** (gain_db / 20.0) / (80000.0 * exposure_us * 1e-6), 1.0, delta=0.01)
            # Photon transfer: shot noise of what is there, read noise, and a twelfth for whole numbers.
            dn_per_e = 10.0 ** (gain_db / 20.0) / GAIN_E_PER_DN
            wanted = dn_per_e * mean_dn + (dn_per_e * READ_NOISE_E) ** 2 + 1.0 / 12.0
            self.assertAlmostEqual(variance_dn2 / wanted, 1.0, delta=0.015)
            without_read_noise = dn_per_e * mean_dn + 1.0 / 12.0
            self.assertGreater(abs(variance_dn2 / without_read_noise - 1.0), 0.1, "control")

    def test_settings_that_change_every_frame_match_each_frame(self):
        wanted = [(10000 + 7000 * k % 60000, k % 7, 90.0 + k) for k in range(24)]
        with outside(6.0, **BRIGHT) as loop:
            for number, (exposure_us, gain_db, black_dn) in enumerate(wanted):
                loop.camera(exposure_us=exposure_us, gain_db=gain_db, black_level_dn=black_dn)
                pixels, info = next_frame(loop)
                meta = info["meta"]
                self.assertEqual(info["number"], number)
                self.assertAlmostEqual(meta["exposure_s"] * 1e6, exposure_us, places=3)
                self.assertEqual((meta["gain_db"], meta["black_level_dn"]), (gain_db, black_dn))
                light = pixels.mean() * meta["gain_e_per_dn"] / meta["exposure_s"]
                self.assertAlmostEqual(light / 80000.0, 1.0, delta=0.01, msg=f"frame {number}: {meta}")

    def test_a_setting_acts_at_its_instant(self):
        with outside(2.0) as loop:
            loop.camera(at_s=0.45, exposure_us=10000)
            exposures = [next_frame(loop)[1]["meta"]["exposure_s"] for _ in range(8)]
        self.assertEqual(exposures, [0.1] * 5 + [0.01] * 3)

    def test_automatic_exposure_follows_the_light(self):
        """A bright field, and the same 30 times brighter."""
        with outside(20.0, **{"timing.frame_rate_hz": 20.0, "camera.exposure.exposure_s": 0.02, "camera.detector.dark_e_per_s": 2e5, **PLAIN}) as loop:
            loop.camera(exposure_auto="continuous")
            target = 0.25 * (4095.0 - BLACK_DN)
            for light in (1.0, 30.0):
                if light > 1.0:
                    loop.inject({"do": "stray_light", "at_s": loop.state()["now_s"], "for_s": 30.0, "e_per_s": 29.0 * 2e5})
                for _ in range(15):
                    pixels, info = next_frame(loop)
                self.assertAlmostEqual(pixels.mean() / target, 1.0, delta=0.05, msg=f"light {light}")
                self.assertAlmostEqual(info["meta"]["exposure_s"] * light, target * GAIN_E_PER_DN / 2e5, delta=0.01)

    def test_unsupported_settings_are_refused_and_change_nothing(self):
        with outside() as loop:
            for settings, word in (
                ({"exposure_us": 0}, "exposure_us"),
                ({"gain_db": 60.0}, "gain_db"),
                ({"gain_db": 6.0, "exposure_us": 5e6}, "exposure_us"),
                ({"frame_rate_hz": 1000.0}, "frame_rate_hz"),
                ({"regions": [[250, 0, 32, 32]]}, "regions"),
                ({"trigger_overlap": "sometimes"}, "read_out"),
                ({"colour": 1}, "colour"),
                ({"head": 3, "gain_db": 1.0}, "head"),
            ):
                with self.assertRaisesRegex(StarloopError, word):
                    loop.camera(**settings)
            self.assertEqual(loop.camera()["next"]["gain_db"], 0.0)
            meta = next_frame(loop)[1]["meta"]
            self.assertEqual((meta["exposure_s"], meta["gain_db"]), (0.1, 0.0))


class Triggers(unittest.TestCase):
    def test_a_trigger_starts_an_exposure_of_its_own_interval(self):
        """Attitude at mid-exposure of a slew of 1 deg/s is that of the trigger's time."""
        rate, delay_s, exposure_s = math.radians(1.0), 0.0015, 0.02
        with outside(3.0, rate) as loop:
            loop.camera(trigger_mode=True, trigger_delay_us=delay_s * 1e6, exposure_us=exposure_s * 1e6)
            for at_s in (0.0371, 0.2, 0.33333, 1.9):
                loop.camera_trigger(at_s=at_s)
                _, info = next_frame(loop)
                meta, mid_s = info["meta"], at_s + delay_s + exposure_s / 2.0
                self.assertEqual((meta["started_by"], meta["trigger_delay_s"]), ("control", delay_s))
                self.assertAlmostEqual(info["mid_exposure_s"], mid_s, places=8)
                self.assertLess(turned_off_arcsec(meta["attitude_wxyz"], rate, mid_s), 0.03)
                self.assertGreater(turned_off_arcsec(meta["attitude_wxyz"], rate, mid_s - delay_s), 1.0, "control")
            report = loop.finish()
        self.assertEqual(report["frames"]["delivered"], 4)
        delays = report["stages"]["trigger"]
        self.assertEqual(delays["count"], 4)
        for quantile in ("p50_ms", "p99_ms", "max_ms"):
            self.assertAlmostEqual(delays[quantile], delay_s * 1e3, delta=0.02 * delay_s * 1e3)

    def test_triggers_that_come_too_early_are_missed_and_counted(self):
        with outside(2.0) as loop:
            loop.camera_trigger(at_s=0.01)
            loop.camera(at_s=0.3, trigger_mode=True, exposure_us=50000, trigger_overlap="off")
            for at_s in (0.5, 0.52, 0.565, 0.6):
                loop.camera_trigger(at_s=at_s)
            report = loop.finish() if loop.step(until_s=2.0)["finished"] else self.fail("over")
        self.assertEqual(report["event_counts"]["camera_trigger_missed"], 2)
        self.assertEqual(report["event_counts"]["camera_trigger_ignored"], 1, "while exposures follow the frame rate")
        # Three at the frame rate, two of triggers.
        self.assertEqual(report["frames"]["delivered"], 5)

    def test_a_burst_and_the_highest_rate(self):
        with outside(2.0) as loop:
            loop.camera(trigger_mode=True, burst=3, exposure_us=30000)
            loop.camera_trigger(at_s=0.1)
            starts = [next_frame(loop)[1]["mid_exposure_s"] - 0.015 for _ in range(3)]
            for start, wanted in zip(starts, (0.1, 0.2, 0.3)):
                self.assertAlmostEqual(start, wanted, places=8)
            loop.camera(trigger_mode=False, frame_rate_hz=None)
            starts = [next_frame(loop)[1]["mid_exposure_s"] - 0.015 for _ in range(4)]
            for one, other in zip(starts, starts[1:]):
                self.assertAlmostEqual(other - one, 0.03, places=8, msg="readout of 20 ms within the exposure of 30 ms")
            loop.camera(exposure_us=5000)
            starts = [next_frame(loop)[1]["mid_exposure_s"] for _ in range(4)]
            self.assertAlmostEqual(starts[3] - starts[2], READOUT_S, places=8, msg="readouts do not meet")


class Heads(unittest.TestCase):
    def test_each_head_has_its_own_settings(self):
        with Starloop.start(BINARY, ROOT / "configs/benches/three_heads.toml", settings={"timing.duration_s": 1.0}) as loop:
            heads = loop.hello["heads"]
            self.assertGreater(heads, 1)
            loop.camera(head=1, exposure_us=12000, gain_db=3.0)
            loop.step(until_s=0.9)
            got = [loop.frame_facts(head)["meta"] for head in range(heads)]
        self.assertEqual((got[1]["exposure_s"], got[1]["gain_db"]), (0.012, 3.0))
        for head in (number for number in range(heads) if number != 1):
            self.assertNotEqual(got[head]["exposure_s"], 0.012)
            self.assertEqual(got[head]["gain_db"], 0.0)


def light_places(pixels, others):
    """Photocentres of the brightest single stars of an image, px, in it and in others: windows around the same pixels."""
    left, places = pixels.copy(), []
    for _ in range(40):
        row, column = numpy.unravel_index(numpy.argmax(left), left.shape)
        window = slice(row - 8, row + 9), slice(column - 8, column + 9)
        if 8 <= row < left.shape[0] - 8 and 8 <= column < left.shape[1] - 8 and numpy.all(numpy.isfinite(left[window])):
            places.append([photocentre(image[window]) for image in (pixels, *others)])
        left[window] = -numpy.inf
    return places


def photocentre(window):
    light = window - numpy.median(window)
    rows, columns = numpy.indices(light.shape)
    return (light * columns).sum() / light.sum(), (light * rows).sum() / light.sum()


class Truth(unittest.TestCase):
    #: Light alone: whole numbers of electrons, without patterns and read noise.
    LIGHT = {**PLAIN, "camera.detector.gain_e_per_dn": 1.0, "camera.detector.bits": 16, "camera.detector.read_noise_e_rms": 0.0,
             "camera.detector.dark_e_per_s": 0.0, "camera.detector.full_well_e": 65000.0, "camera.radiometry.limiting_mag": 5.5}

    def frames(self, backend, late_s=0.0):
        """Settings that change with every frame of a turn, readouts within exposures, and triggers."""
        rate, frames = math.radians(1.0), []
        with outside(4.0, rate, **self.LIGHT, **{"render.backend": backend, "noise_seed": 3}) as loop:
            loop.camera(frame_rate_hz=None)
            for exposure_us in (21000, 150000, 33333, 70000, 20000, 400000):
                loop.camera(exposure_us=exposure_us + late_s * 2e6)
                frames.append(next_frame(loop))
            loop.camera(trigger_mode=True, exposure_us=80000)
            for at_s in (1.3, 1.4123456):
                loop.camera_trigger(at_s=at_s + late_s)
                frames.append(next_frame(loop))
        return frames

    def test_reference_and_auto_agree_for_exposures_of_any_length(self):
        stars, largest, largest_late = 0, 0.0, 0.0
        for (wanted, info), (got, other), (late, _) in zip(self.frames("reference"), self.frames("cpu"), self.frames("cpu", 0.001)):
            self.assertEqual(info["mid_exposure_s"], other["mid_exposure_s"])
            self.assertEqual((info["meta"]["backend"], other["meta"]["backend"]), ("reference", "cpu"))
            for place, place_got, place_late in light_places(wanted, (got, late)):
                stars, largest = stars + 1, max(largest, math.dist(place, place_got))
                largest_late = max(largest_late, math.dist(place, place_late))
        self.assertGreater(stars, 40)
        self.assertLess(largest, 0.002, f"{stars} stars")
        self.assertGreater(largest_late, 0.002, "control: exposures whose middle is 1 ms later")


class Replays(InAFolder):
    def setUp(self):
        super().setUp()
        self.capture = self.folder / "capture"

    def replay(self):
        done = starloop("replay", self.capture)
        return done.returncode, done.stdout + done.stderr

    def assert_repeats(self, frames):
        """All frames of the capture are drawn again."""
        status, text = self.replay()
        self.assertEqual((status, text.strip()), (0, f"{frames} of {frames} frames bit-identical"))

    def flown(self, *arguments):
        settings = {"timing.duration_s": 3.0, "camera": str(ROOT / "configs/cameras/small_tracker.toml")}
        return Starloop.start(BINARY, INSIDE, settings=settings,
                              arguments=["--capture", str(self.capture), "--sink", "null", *arguments])

    def test_commanded_exposures_replay_bit_by_bit(self):
        with self.flown() as loop:
            loop.step(frames=3)
            loop.camera(exposure_us=30000, gain_db=4.5, black_level_dn=120)
            loop.step(frames=3)
            loop.camera(trigger_mode=True, trigger_delay_us=777)
            for at_s in (0.9, 1.2345):
                loop.camera_trigger(at_s=at_s)
            loop.step(until_s=1.5)
            loop.camera(trigger_mode=False, exposure_auto="continuous")
            loop.step(until_s=3.0)
            frames = loop.finish()["frames"]["delivered"]
        self.assert_repeats(frames)
        table = self.capture / "frames.csv"
        rows = table.read_text().splitlines()
        self.assertEqual([row.endswith(",") for row in rows[1:4]], [True] * 3, "not commanded so far")
        # Control: without what the camera was commanded the frames are others.
        table.write_text("\n".join([rows[0]] + [row.rsplit(",", 1)[0] + "," for row in rows[1:]]) + "\n")
        status, text = self.replay()
        self.assertNotEqual(status, 0, text)

    def test_lockstep_runs_replay_bit_by_bit_with_the_samples_that_were_sent(self):
        for form in ("pcapng", "candump"):
            self.capture = self.folder / form
            arguments = ["--capture", str(self.capture), "--capture-format", form, "--sink", "null"]
            with outside(2.0, 0.01, arguments) as loop:
                loop.jitter([0.0005 * k, 20.0 * math.sin(k), 0.0, 0.0] for k in range(4000))
                loop.step(until_s=0.72)
                loop.camera(exposure_us=30000)
                loop.step(until_s=2.0)
                frames = loop.finish()["frames"]["delivered"]
            self.assert_repeats(frames)
            table = self.capture / "samples.csv"
            rows = table.read_text().splitlines(keepends=True)
            changed = [self.turned(row) if row.startswith("attitude") else row for row in rows]
            table.write_text("".join(changed))
            self.assertNotEqual(self.replay()[0], 0, "control: other attitudes")
            table.write_text("".join(rows[:-1]))
            status, text = self.replay()
            self.assertIn("samples", text)
            self.assertNotEqual(status, 0, "control: a sample less")

    @staticmethod
    def turned(row):
        """A row of an attitude about a milliradian aside."""
        fields = row.split(",")
        w, x, y, z = map(float, fields[2:6])
        fields[2:6] = map(repr, (w - 0.0005 * x, x + 0.0005 * w, y + 0.0005 * z, z - 0.0005 * y))
        norm = math.sqrt(1.0 + 0.0005**2)
        fields[2:6] = (repr(float(field) / norm) for field in fields[2:6])
        return ",".join(fields)

    def test_commands_do_not_change_what_repeats(self):
        def crc32():
            with outside(1.5, 0.01) as loop:
                loop.camera(exposure_us=30000, gain_db=4.5)
                loop.camera(at_s=0.5, trigger_mode=True)
                loop.camera_trigger(at_s=0.8)
                loop.step(until_s=1.5)
                return loop.finish()["run_crc32"]

        self.assertEqual(crc32(), crc32())


if __name__ == "__main__":
    unittest.main()
