"""A camera that a flight computer commands over the bus, on the real clock: python3 hil_scripts/tests/test_camera_bus.py

flight_computer.py flies a bench through the slcan gateway and over a serial line, sets exposure and gain on the way,
and reads CAMERA_STATUS; the recorded frames must have those settings in their headers and that light in their pixels.
Needs python-can, cantools and pyserial (requirements_flight_computer.txt), and astropy (requirements.txt).
"""

import re
import tempfile
import unittest
from pathlib import Path

import numpy

from support import InAFolder
from test_flight import Gateways, Relay, Stimulator, fly, frames_of

#: An even light beside which stars do not matter, and nothing that differs from pixel to pixel.
LIGHT_E_PER_S = 200000.0
SETTINGS = [
    f"camera.detector.dark_e_per_s={LIGHT_E_PER_S}",
    "camera.radiometry.limiting_mag=3.5",
    "camera.detector.prnu=0.0",
    "camera.detector.dsnu_e_rms=0.0",
    # A machine that is busy with other tests delays frames; their pixels are what counts here.
    "timing.deadline_policy=late",
]
#: What is commanded, by seconds after the turn began: exposure, us, and gain, 0.01 dB.
COMMANDS = ["report=1", "exposure=50000@1.0", "gain=600@2.5", "exposure=20000@4.0"]
WANTED = [(50000, 0.0), (50000, 6.0), (20000, 6.0)]
#: Light follows the settings to so much.
PROPORTION = 0.01


def reported(said):
    """Returns the values of CAMERA_STATUS, by frame number modulo 256."""
    frames = {}
    for number, rest in re.findall(r"^camera frame (-?\d+): (.*)$", said, re.MULTILINE):
        frames[int(number) % 256] = {name: float(value) for name, value in re.findall(r"(\w+)=(\S+)", rest)}
    return frames


class Commands(InAFolder):
    def check(self, status, said, folder):
        self.assertEqual(status, 0, said)
        for command in COMMANDS:
            self.assertIn(f"camera {command.partition('@')[0]} was taken", said)
        statuses = reported(said)
        frames = {number: (header, mean - header["BLACKLVL"]) for number, (header, mean) in frames_of(folder).items()}
        self.assertGreater(len(statuses), 20, said)
        seen = {}
        for number, (header, light_dn) in frames.items():
            setting = (round(header["EXPTIME"] * 1e6), header["GAIN_DB"])
            seen.setdefault(setting, []).append(light_dn)
            # The header's own gain and time: the pixels are those of the settings that the frame says.
            light = light_dn * header["GAIN"] / header["EXPTIME"]
            self.assertAlmostEqual(light / LIGHT_E_PER_S, 1.0, delta=PROPORTION, msg=f"frame {number}: {setting}")
            if len(frames) < 256 and number in statuses:
                status = statuses[number]
                self.assertEqual((status["ExposureTime"], status["Gain"]), setting, f"frame {number}")
                self.assertEqual(status["BlackLevel"], header["BLACKLVL"])
        self.assertEqual([setting for setting in seen if setting != (100000, 0.0)], WANTED, "in this order")
        mean = {setting: float(numpy.mean(light)) for setting, light in seen.items()}
        gain = 10.0 ** (6.0 / 20.0)
        self.assertAlmostEqual(mean[50000, 6.0] / mean[50000, 0.0] / gain, 1.0, delta=PROPORTION)
        self.assertAlmostEqual(mean[20000, 6.0] / mean[50000, 6.0] / 0.4, 1.0, delta=PROPORTION)
        self.assertGreater(abs(mean[50000, 6.0] / mean[50000, 0.0] - 1.0), 10 * PROPORTION, "control: the gain shows")
        self.assertGreater(abs(mean[20000, 6.0] / mean[50000, 6.0] - 1.0), 10 * PROPORTION, "control: the exposure shows")

    def arguments(self):
        return [word for command in COMMANDS for word in ("--camera", command)]

    def test_over_slcan(self):
        out = self.folder / "run"
        with Gateways(*SETTINGS, out=out) as starloop:
            status, said = fly(*starloop.slcan, *self.arguments())
            starloop.stop()
        self.check(status, said, out)

    def test_over_a_serial_line(self):
        relay = Relay()
        try:
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "run"
                with Stimulator("serial.toml", f"link.port={relay.paths[0]}", *SETTINGS, out=out) as starloop:
                    starloop.wait_for('bench "')
                    status, said = fly("--serial", relay.paths[1], *self.arguments())
                    starloop.stop()
                self.check(status, said, out)
        finally:
            relay.close()

    def test_unsupported_settings_are_refused_with_a_reason(self):
        with Gateways(*SETTINGS) as starloop:
            status, said = fly(*starloop.slcan, "--camera", "exposure=4000000000")
            self.assertEqual(status, 1, said)
            reason = "CameraRange (code 12): the value is outside the range of the camera"
            self.assertIn(f"flight_computer: camera: CAMERA was refused: {reason}\n", said)
            starloop.stop()

    def test_a_setting_that_is_none_is_refused_before_the_flight(self):
        for setting, part in [("colour=1", "wanted one of exposure, gain"), ("gain=-1", "wanted a whole number"), ("gain=1@soon", "wanted seconds")]:
            status, said = fly("--interface", "slcan", "--channel", "socket://127.0.0.1:1", f"--camera={setting}")
            self.assertEqual(status, 2, said)
            self.assertIn(part, said)


if __name__ == "__main__":
    unittest.main(verbosity=2)
