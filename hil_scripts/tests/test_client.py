"""Tests of starloop.client against the program: python3 hil_scripts/tests/test_client.py"""

import os
import re
import socket
import stat
import subprocess
import tempfile
import threading
import unittest
import zlib
from pathlib import Path
from unittest import mock

from support import BINARY, ROOT
from starloop import client as starloop_client
from starloop.client import ConnectionLost, Starloop, StarloopError, toml_value

SCENARIO = ROOT / "configs/scenarios/acquisition.toml"
SHORT = {"duration_s": 3.0, "expect.window_s": 1.0, "bench.camera": "../cameras/small_tracker.toml"}


def start(**changes):
    return Starloop.start(BINARY, SCENARIO, **{"seed": 5, "settings": SHORT, **changes})


class AgainstTheProgram(unittest.TestCase):
    def test_steps_have_the_bits_of_the_run_in_one(self):
        def run(steps):
            with start() as loop:
                for length in steps:
                    loop.step(length)
                    loop.truth(), loop.estimate(), loop.summary()
                loop.step(until_s=loop.hello["duration_s"])
                report = loop.finish()
            return report["frames_crc32"], report["telemetry_crc32"]

        through = run([])
        self.assertEqual(run([0.3, 0.0501, 1.7]), through)
        with start(seed=6) as other:
            other.step(until_s=3.0)
            self.assertNotEqual(other.finish()["frames_crc32"], through[0], "control: another seed, other bits")

    def test_frames_come_with_their_pixels(self):
        with start() as loop:
            self.assertEqual((loop.hello["width"], loop.hello["seed"]), (256, 5))
            loop.step(frames=2)
            frame = loop.frame()
            self.assertEqual((frame.width, frame.height, frame.info["number"]), (256, 256, 1))
            crc32 = f"{zlib.crc32(frame.pixels.tobytes()):08x}"
            self.assertEqual(crc32, frame.info["crc32"], "the CRC-32 that the program found")
            with_numpy, starloop_client.numpy = starloop_client.numpy, None
            try:
                plain = loop.frame().pixels
            finally:
                starloop_client.numpy = with_numpy
            self.assertEqual((plain.typecode, len(plain)), ("H", 256 * 256))
            self.assertEqual(f"{zlib.crc32(plain.tobytes()):08x}", crc32, "and without numpy")

    def test_a_frame_is_written_below_the_output_folder_only(self):
        with tempfile.TemporaryDirectory() as folder, start(arguments=["--out", folder]) as loop:
            loop.step(frames=1)
            victim = Path(folder, "victim")
            victim.write_text("precious")
            for path in ("victim", str(victim), "../victim"):
                with self.assertRaisesRegex(StarloopError, "wanted a "):
                    loop.write_frame(path)
            self.assertEqual(victim.read_text(), "precious")
            written = loop.write_frame("one.fits")
            self.assertEqual(os.path.getsize(os.path.join(folder, "one.fits")), written["bytes"])

    def test_a_fault_is_injected_and_seen(self):
        with start() as loop:
            loop.step(until_s=1.0)
            placed = loop.inject(do="gyro_spike", rate_deg_h=[3600.0, 0.0, 0.0], for_s=1.0)
            self.assertEqual((placed["event"], placed["from_s"]), ("gyro_spike", 1.0))
            self.assertTrue(loop.step(until_s=3.0)["finished"])
            report = loop.finish()
            (fault,) = report["faults"]
            self.assertEqual(fault["name"], "gyro_spike")
            self.assertIn(fault["hits"], (9, 10), "gyro samples of a second at 10 Hz")
            self.assertIn(loop.exit_status, (0, 4))

    def test_refusals_are_exceptions_and_the_session_goes_on(self):
        with start() as loop:
            for wrong, part in (
                (lambda: loop.step(-1.0), "above 0"),
                (lambda: loop.step(), "exactly one"),
                (lambda: loop.step(until_s=99.0), "past the end"),
                (lambda: loop.inject(do="gyro_spik", for_s=1.0), "gyro_spike"),
                (lambda: loop.frame(head=3), "there are 1"),
                (lambda: loop.request("dance"), "wanted one of"),
            ):
                with self.assertRaises(StarloopError) as refused:
                    wrong()
                self.assertIn(part, str(refused.exception))
            self.assertEqual(loop.step(0.5)["frames_out"] >= 0, True)
            loop.finish()
            with self.assertRaises(StarloopError):
                loop.step(0.1)

    def test_a_program_that_does_not_start_is_reported_with_its_words(self):
        with self.assertRaises(ConnectionLost) as lost:
            start(settings={"control.delay_mss": 1})
        self.assertIn("did you mean `delay_ms`", str(lost.exception))

    def test_leaving_ends_the_program_with_status_1(self):
        with start() as loop:
            loop.step(0.5)
        self.assertEqual(loop.exit_status, 1)

    def test_connect_finds_a_program_that_runs(self):
        settings = [word for key, value in SHORT.items() for word in ("--set", f"{key}={toml_value(value)}")]
        command = [BINARY, "run", str(SCENARIO), "--clock", "virtual", "--quiet", "--control", "localhost:0", *settings]
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as program:
            port = int(program.stderr.readline().rsplit(":", 1)[1])
            token, path = re.match(r"control: token ([0-9a-f]{32}), also in (.*)\n", program.stderr.readline()).groups()
            self.assertEqual(stat.S_IMODE(os.stat(path).st_mode), 0o600, "readable by its user only")
            with self.assertRaisesRegex(StarloopError, "not that of this run"):
                Starloop.connect("127.0.0.1", port, token="0" * 32)
            self.assertNotEqual(token, "0" * 32, "control")
            with Starloop.connect("127.0.0.1", port) as loop:
                loop.step(until_s=3.0)
                loop.finish()
            self.assertEqual(program.wait(60), loop.exit_status)


class AgainstABrokenPeer(unittest.TestCase):
    def answer(self, reply):
        """A peer that answers the first line with `reply` and goes away."""
        listener = socket.create_server(("127.0.0.1", 0))

        def serve():
            connection, _ = listener.accept()
            connection.recv(4096)
            connection.sendall(reply)
            connection.close()
            listener.close()

        threading.Thread(target=serve, daemon=True).start()
        return Starloop.connect(*listener.getsockname(), token="00")

    def test_half_a_reply_is_a_lost_connection(self):
        with self.assertRaises(ConnectionLost):
            self.answer(b'{"id": 1, "ok": true, "pro')

    def test_another_protocol_is_refused(self):
        with self.assertRaisesRegex(StarloopError, "protocol 3"):
            self.answer(b'{"id": 1, "ok": true, "protocol": 3}\n')

    def test_a_reply_to_something_else_is_refused(self):
        with self.assertRaisesRegex(StarloopError, "something else"):
            self.answer(b'{"id": 9, "ok": true, "protocol": 2}\n')

    def test_a_missing_token_file_is_said_with_what_to_do(self):
        # A folder of its own: a program that was killed leaves its file, and the system gives its port again.
        with tempfile.TemporaryDirectory() as folder, socket.create_server(("127.0.0.1", 0)) as listener:
            with mock.patch.dict(os.environ, XDG_RUNTIME_DIR=folder):
                with self.assertRaisesRegex(StarloopError, "give the one that the program has printed as token="):
                    Starloop.connect(*listener.getsockname())


class Names(unittest.TestCase):
    def test_the_old_name_of_the_module_is_the_same_client(self):
        import starloop_client as old

        self.assertIs(old.Starloop, Starloop)
        self.assertIs(old.toml_value, toml_value)


class Toml(unittest.TestCase):
    def test_values(self):
        self.assertEqual(toml_value(True), "true")
        self.assertEqual(toml_value([1, 2.5]), "[1, 2.5]")
        self.assertEqual(toml_value({"do": "safe", "at_s": 1}), '{ do = "safe", at_s = 1 }')
        with self.assertRaises(ValueError):
            toml_value(float("nan"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
