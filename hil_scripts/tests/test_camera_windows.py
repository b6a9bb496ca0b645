"""Windows (regions) of an exposure: python3 hil_scripts/tests/test_camera_windows.py [--seconds 60]

Pixels of windows are those of the whole frame, bit by bit; windows follow stars; and on the real clock 20 windows of 32
x 32 pixels at 100 Hz, for 5 s, or for as long as --seconds says.
"""

import math
import sys
import time
import unittest

import numpy

from support import BINARY, ROOT
from starloop.client import Starloop, StarloopError
from test_camera import INSIDE, outside

CAMERAS = ROOT / "configs/cameras"
#: Frames per second of the comparisons: every shipped camera exposes and reads out within half of a period.
COMPARED_HZ = 2.0
#: Seconds of the run on the real clock, and its frames of windows per second.
RATE_SECONDS, RATE_HZ = 5.0, 100.0
#: Rate of whole frames.
WHOLE_HZ = 10.0


def image_of(loop):
    frame = loop.frame()
    return numpy.array(frame.pixels).reshape(frame.height, frame.width), frame.info


def in_windows(shape, windows):
    """True for each pixel of an image that is in a window."""
    inside = numpy.zeros(shape, dtype=bool)
    for left, top, width, height in windows:
        inside[top : top + height, left : left + width] = True
    return inside


def brightest(image, count, side, taken=()):
    """Returns windows of `side` pixels around the brightest pixels, at least a window apart from each other."""
    left, windows = image.astype(float), list(taken)
    while len(windows) < count + len(taken):
        row, column = numpy.unravel_index(numpy.argmax(left), left.shape)
        if left[row, column] < 0.0:
            break
        top, start = (min(max(at - side // 2, 0), size - side) for at, size in ((row, left.shape[0]), (column, left.shape[1])))
        windows.append([int(start), int(top), side, side])
        left[max(row - side, 0) : row + side, max(column - side, 0) : column + side] = -1.0
    return windows[len(taken) :]


def light_place(image, window):
    """Photocentre of the light of a window above its median, column and row."""
    left, top, width, height = window
    light = image[top : top + height, left : left + width].astype(float)
    light = numpy.clip(light - numpy.median(light) - 5.0 * numpy.std(light[light <= numpy.median(light)]) - 3.0, 0.0, None)
    rows, columns = numpy.indices(light.shape)
    return left + (light * columns).sum() / light.sum(), top + (light * rows).sum() / light.sum()


class Bits(unittest.TestCase):
    """Windows of a frame have the bits of the whole frame."""

    def frames(self, windows, rate_rad_s=0.02, backend="cpu", **settings):
        """Frames of a run in which windows are commanded in the middle of the first exposure, and taken back in that of the third."""
        images, timing = [], {"timing.frame_rate_hz": COMPARED_HZ}
        with outside(4.5 / COMPARED_HZ, rate_rad_s, **{**timing, "render.backend": backend, "noise_seed": 5, **settings}) as loop:
            exposure_s = loop.camera()["next"]["exposure_us"] * 1e-6
            for number in range(4):
                loop.step(until_s=number / COMPARED_HZ + 0.5 * exposure_s)
                if windows is not None and number in (0, 2):
                    loop.camera(regions=windows if number == 0 else [])
                loop.step(frames=1)
                images.append(image_of(loop))
        return images

    def compare(self, windows, **settings):
        whole, parts = self.frames(None, **settings), self.frames(windows, **settings)
        other = self.frames(windows, **{**settings, "noise_seed": 6})
        for number, ((wanted, info), (got, said), (another, _)) in enumerate(zip(whole, parts, other)):
            is_whole = number in (0, 3)
            self.assertEqual((info["number"], said["number"]), (number, number))
            self.assertEqual(said["meta"]["regions"], [] if is_whole else windows, f"frame {number}")
            inside = in_windows(wanted.shape, [] if is_whole else windows) | is_whole
            self.assertTrue(numpy.array_equal(got, numpy.where(inside, wanted, 0)), f"frame {number}, {settings}")
            self.assertFalse(numpy.array_equal(another, got), "control: another seed of the noise")
            if not is_whole:
                self.assertLess(said["meta"]["stars"], max(info["meta"]["stars"], 1), "truth of what is read out")
        return whole

    def windows_of(self, **settings):
        image, _ = self.frames(None, **settings)[1]
        side = 25
        height, width = image.shape
        odd = [[3, 7, 31, 2], [width - 9, height - 5, 9, 5], [0, height // 2, width, 1], [width // 2, 0, 1, height // 3]]
        return brightest(image, 10, side) + odd

    def test_shipped_cameras_read_out_the_same_bits(self):
        for name in ("small_tracker", "star_tracker_20deg", "cubesat_tracker", "chain_tracker"):
            with self.subTest(camera=name):
                camera = {"camera": str(CAMERAS / f"{name}.toml")}
                self.compare(self.windows_of(**camera), **camera)

    def test_every_backend_and_method_has_the_same_bits(self):
        for settings in (
            {"backend": "reference"},
            {"backend": "gpu"},
            {"render.method": "samples"},
            {"render.method": "effective-psf"},
            {"rate_rad_s": 0.2},
        ):
            with self.subTest(**settings):
                self.compare(self.windows_of(**settings), **settings)

    def test_charge_that_moves_is_that_of_the_whole_frame(self):
        moving = "camera.detector."
        for settings in (
            {moving + "charge_transfer.parallel_share": 1e-4, moving + "charge_transfer.serial_share": 1e-4},
            {moving + "image_lag.share": 0.05},
            {moving + "window.left_px": 32, moving + "window.top_px": 64, moving + "window.width_px": 128, moving + "window.height_px": 96},
        ):
            with self.subTest(**settings):
                self.compare(self.windows_of(**settings), **settings)

    def test_windows_that_overlap_are_their_pixels_together(self):
        self.compare([[20, 20, 40, 40], [50, 50, 40, 40], [20, 20, 40, 40]])


class Refusals(unittest.TestCase):
    def test_windows_off_the_sensor_and_too_many_are_refused_and_nothing_changes(self):
        with outside(1.0) as loop:
            good = [[10, 10, 32, 32]]
            loop.camera(regions=good)
            for windows, words in (
                ([[225, 0, 32, 32]], "256 x 256"),
                ([[0, 225, 32, 32]], "256 x 256"),
                ([[0, 0, 0, 32]], "256 x 256"),
                ([[0, 0, 8, 8]] * 33, "at most 32"),
                ([[-1, 0, 8, 8]], "at most 32"),
                ([[0, 0, 8]], "at most 32"),
                ("all", "at most 32"),
            ):
                with self.assertRaisesRegex(StarloopError, words):
                    loop.camera(regions=windows, gain_db=3.0)
            self.assertEqual(loop.camera()["next"]["regions"], good)
            self.assertEqual(loop.camera()["next"]["gain_db"], 0.0)
            loop.camera(regions=[[8 * k, 8 * k, 8, 8] for k in range(32)])
            loop.step(frames=1)
            image, info = image_of(loop)
            self.assertEqual(len(info["meta"]["regions"]), 32, "control: 32 are taken")
            self.assertEqual(numpy.count_nonzero(image), 32 * 64)

    def test_fewer_rows_make_more_frames_possible(self):
        with outside(1.0, **{"timing.frame_rate_hz": 10.0}) as loop:
            with self.assertRaisesRegex(StarloopError, "frame_rate_hz"):
                loop.camera(frame_rate_hz=100.0)
            loop.camera(regions=[[0, 0, 16, 16], [100, 100, 16, 16]], frame_rate_hz=100.0, exposure_us=5000)
            loop.step(frames=3)
            mids = []
            for _ in range(5):
                loop.step(frames=1)
                mids.append(loop.frame_facts()["mid_exposure_s"])
            for one, other in zip(mids, mids[1:]):
                self.assertAlmostEqual(other - one, 0.01, places=8)


class Following(unittest.TestCase):
    def test_windows_follow_the_stars_of_a_slew(self):
        """A client that computes each frame's windows from the two frames before keeps its stars in them."""
        rate, frames, side = math.radians(1.0), 14, 17
        with outside(2.0, rate, **{"camera.exposure.exposure_s": 0.05}) as loop:
            loop.step(frames=1)
            first, _ = image_of(loop)
            # 1 deg/s is 1.3 px from frame to frame.
            windows = brightest(first[16:-16, 16:-16], 6, side)
            windows = [[left + 16, top + 16, *size] for left, top, *size in windows]
            loop.step(frames=1)
            second, _ = image_of(loop)
            # Of each star: where it was first, one frame ago and now.
            tracks = [(place := light_place(first, window), place, light_place(second, window)) for window in windows]
            followed, moved = 0, 0.0
            for _ in range(frames - 2):
                expected = [tuple(2 * b - a for a, b in zip(*track[1:])) for track in tracks]
                kept = [(track, place) for track, place in zip(tracks, expected) if all(side < at < 256 - side for at in place)]
                windows = [[round(x) - side // 2, round(y) - side // 2, side, side] for _, (x, y) in kept]
                loop.camera(regions=windows)
                loop.step(frames=1)
                image, info = image_of(loop)
                self.assertEqual(info["meta"]["regions"], windows)
                tracks = []
                for (track, (x, y)), window in zip(kept, windows):
                    place = light_place(image, window)
                    self.assertLess(math.dist(place, (x, y)), 1.0, "the star is where it was expected")
                    moved = max(moved, math.dist(place, track[0]))
                    tracks.append((track[0], track[2], place))
                    followed += 1
        self.assertGreater(followed, 40)
        self.assertGreater(moved, side / 2.0, "control: fixed windows would lose their stars")


class Rate(unittest.TestCase):
    """The cost of windows, on the real clock."""

    def run_at_rate(self, windows, rate_hz, seconds):
        """Returns the report of a run at a commanded rate, and the number of windows of its frames. At 50 ms a readout, whole
        frames come at up to 20 Hz; four rows of windows are read out in 6.25 ms."""
        settings = {
            "timing.duration_s": seconds,
            "timing.frame_rate_hz": WHOLE_HZ,
            "camera.exposure.exposure_s": 0.005,
            "camera.exposure.readout_s": 0.05,
            "timing.deadline_policy": "late",
            "flight_computer.slew.start_s": 0.5,
            "flight_computer.slew.duration_s": seconds + 30.0,
            "render.backend": "cpu",
        }
        with Starloop.start(BINARY, INSIDE, clock="real", settings=settings, arguments=["--sink", "null"]) as loop:
            if windows:
                loop.camera(regions=windows, frame_rate_hz=rate_hz)
            sizes, number = [], -1
            until = time.monotonic() + seconds + 30.0
            while not loop.state()["finished"] and time.monotonic() < until:
                time.sleep(0.2)
                try:
                    facts = loop.frame_facts()
                except StarloopError:
                    continue
                if facts["number"] != number:
                    number = facts["number"]
                    sizes.append(len(facts["meta"]["regions"]))
            return loop.finish(), sizes

    def test_twenty_windows_at_a_hundred_frames_a_second(self):
        windows = [[90 + 180 * (k % 5), 60 + 230 * (k // 5), 32, 32] for k in range(20)]
        report, sizes = self.run_at_rate(windows, RATE_HZ, RATE_SECONDS)
        frames, stages = report["frames"], report["stages"]
        # Those before the command came at the other rate.
        self.assertGreater(frames["scheduled"], (RATE_SECONDS - 1.0) * RATE_HZ)
        self.assertGreater(sizes.count(20), 0.8 * len(sizes), "windows are read out")
        self.assertEqual(report["event_counts"].get("camera_refused", 0), 0)
        whole, none = self.run_at_rate([], WHOLE_HZ, min(RATE_SECONDS, 5.0))
        self.assertEqual(sum(none), 0, "control: whole frames")
        self.assertLess(whole["frames"]["scheduled"], 0.2 * RATE_SECONDS * RATE_HZ, "control: at the other rate")
        detector = [run["stages"]["detector"]["p50_ms"] for run in (report, whole)]
        late = {name: count for name, count in report["event_counts"].items() if name in ("late", "dropped", "held", "overloaded", "degraded")}
        print(f"{frames['scheduled']} frames at {RATE_HZ:g} Hz, 20 windows of 32 x 32 px: {frames['delivered']} delivered, {frames['late']} late; "
              f"events {late}; 50 %, 99 %, largest, ms:", file=sys.stderr)
        for name, stage in stages.items():
            print(f"  {name:14}" + "".join(f"{stage[key]:9.3f}" for key in ("p50_ms", "p99_ms", "max_ms")), file=sys.stderr)
        print(f"  detector, 50 %: {detector[0]:.3f} ms for the windows, {detector[1]:.3f} ms for whole frames", file=sys.stderr)


if __name__ == "__main__":
    if "--seconds" in sys.argv:
        at = sys.argv.index("--seconds")
        RATE_SECONDS = float(sys.argv[at + 1])
        del sys.argv[at : at + 2]
    unittest.main()
