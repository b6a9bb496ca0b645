"""Tests of the display against an X server's own memory: python3 hil_scripts/tests/test_display.py

Xvfb keeps its screen in a file (-fbdir) in the format of xwd; it is read here, and every pixel is compared with greys
that are worked out here. Window managers: none, evilwm (which knows full-screen windows) and twm (which does not).

Needs: xvfb, xdotool, x11-xserver-utils (xrandr), evilwm, twm, and a Vulkan driver. STARLOOP_BINARY names the program (default
target/release/starloop), built with --features display.
"""

import datetime
import math
import os
import random
import re
import shutil
import socket
import struct
import subprocess
import tempfile
import time
import unittest
import zlib
from pathlib import Path

import support
from support import BINARY, InAFolder, starloop, summary_of

SIDE = 256  # a square with each luminance once
PATIENCE_S = 60


def display(*arguments, **options):
    """Runs the command that shows images."""
    return starloop("display", *arguments, timeout=PATIENCE_S, **options)


def needed(*programs):
    """Skips a test, and says so, where a program is missing."""
    missing = [program for program in programs if not shutil.which(program)]
    if missing:
        print(f"SKIPPED: {', '.join(missing)} not installed", flush=True)
    return unittest.skipIf(missing, f"{missing} not installed")


def write_png(path, width, height, luminances):
    """A PNG of 16 bit greys."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = (luminances[y * width : (y + 1) * width] for y in range(height))
    body = b"".join(b"\0" + struct.pack(f">{width}H", *row) for row in rows)
    header = struct.pack(">2I5B", width, height, 16, 0, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + parts)
    return path


def linear_grey(luminance):
    """The nearest of 256 greys, in whole numbers; halves go up."""
    return (2 * luminance * 255 + 65535) // (2 * 65535)


def gamma_grey(luminance, gamma):
    """By a table in single precision, as tables are."""
    (grey,) = struct.unpack("f", struct.pack("f", 255 * (luminance / 65535) ** (1 / gamma)))
    return math.floor(grey + 0.5)


class Screen:
    """An X server of its own, with or without a window manager."""

    def __init__(self, size=(SIDE, SIDE), manager=None, depth=24):
        self.kept = tempfile.TemporaryDirectory()
        self.folder = Path(self.kept.name)
        self.size = size
        reading, writing = os.pipe()
        geometry = f"{size[0]}x{size[1]}x{depth}"
        arguments = ["-screen", "0", geometry, "-fbdir", self.kept.name, "-nolisten", "tcp", "-noreset"]
        self.server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(writing), *arguments], pass_fds=[writing], stderr=subprocess.DEVNULL
        )
        os.close(writing)
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()
        self.environment = {**os.environ, "DISPLAY": f":{number}", "HOME": self.kept.name}
        self.environment.pop("WAYLAND_DISPLAY", None)
        self.number = number
        self.manager = None
        if manager:
            # The server's built-in font: no package of fonts is needed.
            names = ("Title", "Menu", "Icon", "IconManager", "Resize")
            (self.folder / ".twmrc").write_text("".join(f'{name}Font "fixed"\n' for name in names))
            arguments = [manager, "-fn", "fixed"] if manager == "evilwm" else [manager]
            self.manager = subprocess.Popen(
                arguments, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            time.sleep(1)
            assert self.manager.poll() is None, f"{manager} has ended"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for program in (self.manager, self.server):
            if program:
                program.terminate()
                program.wait(PATIENCE_S)
        self.kept.cleanup()

    def pixels(self):
        """The screen as (red, green, blue) by row and column, from the server's memory."""
        dump = (self.folder / "Xvfb_screen0").read_bytes()
        header = struct.unpack(">25I", dump[:100])
        size, _, _, _, width, height, _, byte_order, _, _, _, bits, stride, _, red, green, blue = header[:17]
        colours = header[19]
        assert bits == 32, bits
        start = size + 12 * colours
        order = ">" if byte_order else "<"

        def of(word, mask):
            return (word & mask) // (mask & -mask)

        rows = (struct.unpack_from(f"{order}{width}I", dump, start + y * stride) for y in range(height))
        return [[(of(word, red), of(word, green), of(word, blue)) for word in row] for row in rows]

    def xdotool(self, *arguments):
        done = subprocess.run(["xdotool", *arguments], env=self.environment, capture_output=True, text=True, timeout=60)
        return done.stdout.strip()

    def plug(self, is_in):
        """Switches the only monitor on or off, as if its cable were moved."""
        size = f"{self.size[0]}x{self.size[1]}"
        how = ["--mode", size] if is_in else ["--off"]
        subprocess.run(["xrandr", "--fb", size, "--output", "screen", *how], env=self.environment, check=True)

    def ask_to_close(self, window):
        """WM_DELETE_WINDOW, as window managers send it, over a connection of the test's own."""
        with socket.socket(socket.AF_UNIX) as server:
            server.connect(f"/tmp/.X11-unix/X{self.number}")
            server.sendall(struct.pack("<BxHHHH2x", ord("l"), 11, 0, 0, 0))

            def read(count):
                return server.recv(count, socket.MSG_WAITALL)

            read(4 * struct.unpack("<6xH", read(8))[0])

            def atom(name):
                padded = name + bytes(-len(name) % 4)
                server.sendall(struct.pack("<BBHHxx", 16, 0, 2 + len(padded) // 4, len(name)) + padded)
                return struct.unpack("<8xI20x", read(32))[0]

            protocols, delete = atom(b"WM_PROTOCOLS"), atom(b"WM_DELETE_WINDOW")
            event = struct.pack("<BBHIIII12x", 33, 32, 0, int(window), protocols, delete, 0)
            server.sendall(struct.pack("<BBHII", 25, 0, 11, int(window), 0) + event)
            atom(b"done")

    def window(self):
        """The program's window; the newest of its name."""
        return self.xdotool("search", "--name", "starloop display").split()[-1]


class Shown:
    """The program with its first image on the screen."""

    def __init__(self, screen, *arguments):
        self.program = subprocess.Popen(
            [BINARY, "display", "show", *map(str, arguments)],
            env=screen.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.description = self.program.stdout.readline()
        self.reported = self.program.stdout.readline()
        if "submitted" not in self.reported:
            raise AssertionError(f"not shown: {self.description}{self.reported}{self.program.communicate()[1]}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.program.poll() is None:
            self.program.kill()
        self.program.communicate()

    def send(self):
        self.program.stdin.write("\n")
        self.program.stdin.flush()

    def read(self):
        self.reported = self.program.stdout.readline()
        return self.reported

    def next(self):
        """The next image, once it is submitted."""
        self.send()
        return self.read()

    def finish(self):
        """Ends the input; what the program said, and its exit status."""
        output, errors = self.program.communicate(timeout=PATIENCE_S)
        return output, errors, self.program.returncode

    def end(self):
        """How the program ends by itself: what it said, and its exit status."""
        status = self.program.wait(PATIENCE_S)
        return self.program.stdout.read(), self.program.stderr.read(), status


def differences(pixels, wanted):
    """Places where the screen is not the wanted grey in all three colours, from the first pixel of `wanted`."""
    return [
        (x, y, pixels[y][x], grey)
        for y, row in enumerate(wanted)
        for x, grey in enumerate(row)
        if pixels[y][x] != (grey, grey, grey)
    ]


def settled_differences(screen, wanted, part=lambda pixels: pixels):
    """The differences once they have gone, or after a patient wait: the server paints some time after the submit."""
    found = None
    for _ in range(50):
        found = differences(part(screen.pixels()), wanted)
        if not found:
            break
        time.sleep(0.1)
    return found


def rows(luminances, width, grey=linear_grey):
    greys = [grey(luminance) for luminance in luminances]
    return [greys[at : at + width] for at in range(0, len(greys), width)]


@needed("Xvfb", "xdotool", "xrandr", "evilwm", "twm")
class OnAScreen(InAFolder):
    def setUp(self):
        super().setUp()
        self.every = list(range(65536))
        self.noise = random.Random(7).choices(range(65536), k=SIDE * SIDE)

    def png(self, name, luminances, width=SIDE):
        return write_png(self.folder / name, width, len(luminances) // width, luminances)

    def test_every_luminance_has_its_grey_with_and_without_a_window_manager(self):
        images = self.png("every.png", self.every), self.png("noise.png", self.noise)
        for manager, how in ((None, "full screen"), ("evilwm", "full screen"), ("twm", "without the window manager")):
            with self.subTest(manager=manager), Screen(manager=manager) as screen, Shown(screen, *images) as shown:
                self.assertIn(how, shown.description)
                self.assertEqual(settled_differences(screen, rows(self.every, SIDE))[:5], [])
                shown.next()
                wanted = rows(self.noise, SIDE)
                self.assertEqual(settled_differences(screen, wanted)[:5], [])
                wanted[100][7] ^= 1
                self.assertEqual(len(differences(screen.pixels(), wanted)), 1, "control: one bit of one pixel")
                _, errors, status = shown.finish()
                self.assertEqual((status, errors), (0, ""))

    def test_another_table_gives_other_greys(self):
        with Screen() as screen, Shown(screen, self.png("every.png", self.every), "--gamma", 2.2) as shown:
            wanted = rows(self.every, SIDE, lambda luminance: gamma_grey(luminance, 2.2))
            self.assertEqual(settled_differences(screen, wanted)[:5], [])
            wrong = differences(screen.pixels(), rows(self.every, SIDE))
            self.assertGreater(len(wrong), 60000, "control: the linear table is not what is shown")
            shown.finish()

    def test_the_marker_turns_over_with_each_frame(self):
        side, images = 16, [self.png(f"{n}.png", self.noise) for n in range(4)]
        marker = ("--marker-px", side, "--marker-corner", "bottom-right")
        with Screen() as screen, Shown(screen, *images, *marker) as shown:
            for number in range(4):
                wanted = rows(self.noise, SIDE)
                for row in wanted[-side:]:
                    row[-side:] = [0 if number % 2 else 255] * side
                self.assertEqual(settled_differences(screen, wanted)[:5], [], f"frame {number}")
                if number < 3:
                    shown.next()
            shown.finish()

    def test_a_window_of_its_own_size(self):
        image = self.png("small.png", self.noise[: 64 * 48], width=64)
        with Screen() as screen, Shown(screen, image, "--window") as shown:
            self.assertIn("a window of 64 x 48 px", shown.description)
            place = dict(
                line.split("=") for line in screen.xdotool("getwindowgeometry", "--shell", screen.window()).split()
            )
            wanted = rows(self.noise[: 64 * 48], 64)
            left, top = int(place["X"]), int(place["Y"])
            part = lambda pixels: [row[left : left + 64] for row in pixels[top : top + 48]]
            self.assertEqual(settled_differences(screen, wanted, part)[:5], [])
            shown.finish()

    def test_a_closed_window_ends_it_with_a_reason(self):
        image = self.png("every.png", self.every)
        closings = (
            ("asked", None, "window manager asked"),
            ("destroyed", None, "destroyed"),
            ("key", None, "Esc"),
            ("key", "evilwm", "Esc"),
        )
        for action, manager, reason in closings:
            with (
                self.subTest(action=action, manager=manager),
                Screen(manager=manager) as screen,
                Shown(screen, image) as shown,
            ):
                window = screen.window()
                if action == "asked":
                    screen.ask_to_close(window)
                elif action == "destroyed":
                    screen.xdotool("windowclose", window)
                else:
                    screen.xdotool("mousemove", "100", "100")
                    screen.xdotool("key", "Escape")
                _, errors, status = shown.end()
                self.assertEqual(status, 1)
                self.assertIn(reason, errors)

    def test_an_unplugged_monitor_is_waited_for(self):
        images = [self.png(f"{n}.png", [n * 257] * (SIDE * SIDE)) for n in range(1, 5)]
        with Screen() as screen, Shown(screen, *images) as shown:
            self.assertEqual(settled_differences(screen, [[1] * SIDE] * SIDE)[:5], [])
            screen.plug(False)
            time.sleep(2)
            shown.send()
            # This one is not seen: the program says so, and goes on to the next.
            self.assertIn("not seen", shown.read())
            screen.plug(True)
            time.sleep(2)
            shown.next()
            self.assertEqual(settled_differences(screen, [[3] * SIDE] * SIDE)[:5], [])
            output, errors, status = shown.finish()
            self.assertEqual((status, errors), (0, ""))
            for part in ("1 times the monitor went away", "1 times the monitor came back", "1 frames were not seen"):
                self.assertIn(part, output)

    def test_a_bench_shows_its_stars_where_its_truth_has_them(self):
        folder = self.folder
        starloop("calibrate", "display", "simulate", "--out", folder, timeout=PATIENCE_S, status=0)
        # The frames themselves are recorded beside, one per refresh; a slower refresh for a busy machine.
        bench = (folder / "bench.toml").read_text().replace("frame_rate_hz = 60.0", "frame_rate_hz = 10.0")
        bench += "\n[[extra_sink]]\nkind = \"recorder\"\nqueue = 64\n"
        (folder / "bench.toml").write_text(bench)
        with Screen(size=(640, 480)) as screen:
            words = ["run", str(folder / "bench.toml"), "--duration", "4", "--out", str(folder / "run"), "--quiet"]
            with subprocess.Popen([BINARY, *words], env=screen.environment, stderr=subprocess.PIPE, text=True) as run:
                # A window that comes or goes is seen in part: the look with the most light is a whole one.
                rows_of, most = [], 0
                while run.poll() is None:
                    pixels = screen.pixels()
                    total = sum(grey[0] for row in pixels for grey in row)
                    rows_of, most = (pixels, total) if total > most else (rows_of, most)
                complaint = run.stderr.read()
            self.assertEqual(run.returncode, 0, complaint)
        self.assertIn("640 x 480", complaint)
        summary = summary_of(folder / "run")
        lines = {line["sink"]: line for line in summary["sinks"]}
        self.assertGreater(lines["display"]["counts"]["presented"], 5)
        self.assertTrue(rows_of, "something was seen")
        # Every frame that was presented has its submit time, in order, with when its light is expected.
        submits = support.rows_of(folder / "run/submits.csv")
        counts = lines["display"]["counts"]
        self.assertEqual(len(submits) + counts.get("submits_lost", 0), counts["presented"])
        frames = [int(row["frame"]) for row in submits]
        self.assertEqual(frames, sorted(set(frames)))
        times = [int(row["submit_tai_ns"]) for row in submits]
        self.assertEqual(times, sorted(times))
        self.assertTrue(all(row["light_off_ns"] for row in submits), "the calibration has a latency")
        # Half a refresh of the frames is 50 ms here, and what the frame before took to be composed; frames shown as soon
        # as they are drawn would be further off. How much later they come is the machine's.
        self.assertGreater(min(int(row["light_off_ns"]) for row in submits), -95_000_000)
        truth = sorted((folder / "run").glob("**/frame_*.truth.csv"))[5].read_text().splitlines()
        columns = truth[0].split(",")
        stars = [dict(zip(columns, line.split(","))) for line in truth[1:]]
        stars = [(float(star["x_px"]), float(star["y_px"]), float(star["electrons"])) for star in stars]
        inside = [star for star in stars if 8 < star[0] < 632 and 8 < star[1] < 472]
        bright = sorted(inside, key=lambda star: -star[2])[:5]

        def light(x, y):
            column, row = round(x), round(y)
            return max(rows_of[b][a][0] for a in range(column - 1, column + 2) for b in range(row - 1, row + 2))

        self.assertEqual(len(bright), 5)
        for x, y, _ in bright:
            self.assertGreater(light(x, y), 100, f"a bright star at ({x}, {y})")
        # The negative control: where no star is, nothing is.
        empty = [(x, y) for x in range(20, 620, 40) for y in range(20, 460, 40)]
        empty = [(x, y) for x, y in empty if all(math.hypot(x - a, y - b) > 15 for a, b, _ in stars)]
        self.assertGreater(len(empty), 20)
        self.assertLess(sum(light(x, y) > 40 for x, y in empty), 2)

    def test_flips_and_a_photodiode_report_the_latency(self):
        submits, edges = self.folder / "submits.csv", self.folder / "edges.csv"
        flip = ("flip", "--out", submits, "--count", "30", "--period", "0.12", "--marker-px", "16")
        with Screen() as screen:
            display(*flip, env=screen.environment, status=0)
            again = display(*flip, env=screen.environment)
            self.assertIn("submits.csv", again.stderr, "an earlier table is left alone")
        rows = support.rows_of(submits)
        self.assertGreater(len(rows), 20)
        colours = [row["marker_is_white"] for row in rows]
        self.assertTrue(all(a != b for a, b in zip(colours, colours[1:])), "it turns over each time")

        def unix_s(text):
            whole, _, fraction = text.removesuffix("Z").partition(".")
            return datetime.datetime.fromisoformat(whole + "+00:00").timestamp() + float("0." + fraction)

        def reported(delay_s, *arguments):
            lines = [f"{unix_s(row['submit_utc']) + delay_s:.6f}" for row in rows]
            edges.write_text("edge_s\n" + "\n".join(lines) + "\n")
            return display("latency", submits, "--edges", edges, *arguments)

        said = reported(0.0305).stdout
        (found,) = re.findall(r"latency_ms = ([0-9.]+)", said)
        self.assertAlmostEqual(float(found), 30.5, delta=0.01)
        # A patch in the last row of a panel that lights over 16 ms: the middle lights half of that sooner.
        said = reported(0.0305, "--marker-corner", "bottom-left", "--scan-ms", "16").stdout
        (found,) = re.findall(r"latency_ms = ([0-9.]+)", said)
        self.assertAlmostEqual(float(found), 22.5, delta=0.01)
        refused = reported(-1e4)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("flips with an edge", refused.stderr)

    def test_unsuitable_images_are_refused(self):
        small, every = self.png("small.png", [0] * 64 * 48, width=64), self.png("every.png", self.every)
        refusals = (
            ((small,), ("64 x 48", "256 x 256", "window = [64, 48]")),
            ((every, "--monitor", "HDMI-9"), ('named "HDMI-9"', "256 x 256 at 0, 0")),
            ((every, "--monitor", "3"), ("number 3",)),
            ((every, "--bits", "10"), ("10 bits are not offered", "Bgra8Unorm")),
            ((every, "--marker-px", "257"), ("257",)),
            ((every, "--gamma", "0"), ("gamma",)),
        )
        with Screen() as screen:
            for arguments, parts in refusals:
                with self.subTest(arguments=arguments[1:]):
                    done = display("show", *arguments, env=screen.environment, status=1)
                    for part in parts:
                        self.assertIn(part, done.stderr)

    def test_monitors_are_listed_by_the_names_that_choose_them(self):
        with Screen() as screen:
            listed = display("monitors", env=screen.environment).stdout
            self.assertIn("256 x 256 at 0, 0", listed)
            name = listed.split()[1]
            for choice in (name, "0"):
                with Shown(screen, self.png("every.png", self.every), "--monitor", choice) as shown:
                    self.assertEqual(settled_differences(screen, rows(self.every, SIDE))[:5], [])
                    shown.finish()

    def test_without_a_server_it_says_so(self):
        environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        for server in ({}, {"DISPLAY": ":4242"}):
            done = display("show", self.png("every.png", self.every), env={**environment, **server}, status=1)
            self.assertIn("set DISPLAY", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
