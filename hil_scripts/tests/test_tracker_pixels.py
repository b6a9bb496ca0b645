"""A star tracker of other people in the loop, by pixels alone, on the real clock: python3 hil_scripts/tests/test_tracker_pixels.py

cedar-solve sees the frames of a spacecraft that points by it: by shared memory, and by a network camera from a tumble at an unknown
attitude to fine pointing. Needs aravis (gir1.2-aravis-0.8, python3-gi) and the environment of cedar-solve, which
test_tracker_report.py makes.
"""

import os
import unittest
from pathlib import Path

from support import ADDRESSES, ROOT, SYSTEM_PYTHON, TARGET
from test_tracker_in import TRACKER, Flight, bench_text, port_in

CEDAR = Path(os.environ.get("STARLOOP_CEDAR_ENVIRONMENT", TARGET / "cedar_environment"))
SMALL = ROOT / "configs/cameras/small_tracker.toml"


class CedarSolve(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if not (CEDAR / "bin/python").exists():
            raise unittest.SkipTest(f"{CEDAR} is not there; test_tracker_report.py makes it")
        [packages] = CEDAR.glob("lib/python3*/site-packages")
        os.environ["PYTHONPATH"] = f"{packages}:{os.environ.get('PYTHONPATH', '')}"

    def fly(self, frames, text, *arguments):
        def tracker(folder, bench):
            return SYSTEM_PYTHON, TRACKER, frames(folder), f"127.0.0.1:{port_in(bench)}", "--cedar", SMALL

        flight = Flight(self, text, [tracker], *arguments)
        status, summary, scenario = flight.ended()
        self.assertEqual((status, summary["verdict"]), (0, "ok"), flight.printed)
        return summary["answers"][0], scenario

    def test_by_shared_memory_it_points(self):
        row, scenario = self.fly(lambda folder: f"{folder}/frames", bench_text, "--duration", 40)
        self.assertLess(row["error_across_arcsec"], 40.0)
        self.assertLess(scenario["pointing"]["boresight_arcsec"], 60.0)

    def test_by_a_network_camera_it_comes_from_a_tumble_to_fine_pointing(self):
        address = next(ADDRESSES)

        def text(folder):
            lines = bench_text(folder, frame_rate_hz=2.0).splitlines()
            initial = lines.index("[plant.initial]")
            lines[initial + 1 : initial + 5] = ['attitude = "random"', "rate_deg_s = [0.3, -0.2, 0.25]"]
            swaps = {f'path = "{folder}/frames"': f'address = "{address}"', 'kind = "shared_memory"': 'kind = "network_camera"'}
            lines = [swaps.get(line, line) for line in lines]
            return "\n".join(line for line in lines if line) + "\nfine_pointing_within_s = 400.0\n"

        row, scenario = self.fly(lambda folder: f"camera:{address}", text, "--duration", 420)
        modes = [mode["to"] for mode in scenario["modes"]]
        self.assertEqual(modes[-1], "fine_pointing", modes)
        self.assertLess(scenario["fine_after_s"], 400.0)
        self.assertGreater(row["attitudes"], 0.5 * row["frames"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
