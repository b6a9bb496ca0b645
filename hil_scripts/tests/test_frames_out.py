"""One run that feeds files, a camera on the network and a browser at once: python3 hil_scripts/tests/test_frames_out.py

A bench of 1024 x 1024 px at 10 Hz with a recorder and a network camera, and the live view beside them. Aravis grabs,
and is then stopped in the middle of a stream; somebody connects to the live view and never reads. No sink may cost a
frame. Needs what `test_network_camera.py` needs.
"""

import json
import signal
import socket
import time
import unittest
import urllib.request
from pathlib import Path

from support import ADDRESSES, BINARY, ROOT, InAFolder, Running, summary_of
from page import fits_of
from test_network_camera import PATIENCE_S, WHOLE, Grab, shifted, unpacked

FRAMES = 120
BENCH = """
name = "frames out"
camera = "{root}/configs/cameras/star_tracker_20deg.toml"
link = "{root}/configs/links/simulated_can_fd.toml"

[timing]
frame_rate_hz = 10.0
duration_s = {seconds}
start_utc = "2026-03-01T00:00:00Z"

[flight_computer]
kind = "simulated"
attitude_hz = 100.0
ra_deg = 84.05
dec_deg = -1.2

[sink]
kind = "recorder"
directory = "{folder}/run"
queue = 40

[[extra_sink]]
kind = "network_camera"
address = "{address}"
pixel_format = "Mono12"
packet_bytes = 9000
queue = 40
frames_queued = 16
"""


class Run(Running):
    """`starloop run --monitor` until its end."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.address = next(ADDRESSES)
        bench = self.folder / "bench.toml"
        bench.write_text(BENCH.format(root=ROOT, folder=folder, address=self.address, seconds=FRAMES / 10))
        super().__init__(BINARY, "run", bench, "--out", self.folder / "run", "--monitor", "0")
        self.page = self.wait_for(r"http://([0-9.]+):(\d+)/")

    def get(self, path):
        with urllib.request.urlopen(self.page.group(0) + path, timeout=PATIENCE_S) as answer:
            return answer.read()

    def result(self):
        self.ended(3 * PATIENCE_S)
        assert self.process.returncode == 0, "".join(self.said)
        return summary_of(self.folder / "run")


class Everything(InAFolder):
    def test_a_stalled_client_costs_no_other_client_a_frame(self):
        run = Run(self.folder)
        deaf = socket.create_connection((run.page.group(1), int(run.page.group(2))))
        deaf.sendall(b"GET /frame.png HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        wanted = {"chunks": True, "frames": 15, "socket_bytes": 4 << 20}
        reported = Grab(run.address, **wanted).result()
        seen = json.loads(run.get("state.json"))
        picture = run.get("frame.png")
        stalled = Grab(run.address, frames=1000, images=False)
        stalled.wait_until_streaming()
        time.sleep(0.5)
        stalled.process.send_signal(signal.SIGSTOP)
        summary = run.result()
        stalled.process.send_signal(signal.SIGCONT)
        stalled.kill()
        deaf.close()
        self.check(summary)
        self.assertTrue(picture.startswith(b"\x89PNG"))
        self.assertIsNotNone(seen["frame"])
        self.bit_exact(reported["frames"], self.folder / "run")

    def check(self, summary):
        frames = summary["frames"]
        self.assertEqual(frames["scheduled"], FRAMES)
        events = summary["event_counts"]
        for what in ("sink_busy", "sink_dropped", "sink_refused", "sink_lost"):
            self.assertEqual(events.get(what, 0), 0, f"{what}: {events}")
        self.assertEqual([line["sink"] for line in summary["sinks"]], ["recorder", "network_camera"])
        for line in summary["sinks"]:
            self.assertEqual((line["frames"], line["dropped"]), (frames["delivered"], 0), line)
        self.assertEqual(summary["sinks"][1]["counts"].get("frames_dropped", 0), 0, summary["sinks"][1])

    def bit_exact(self, grabbed, run):
        self.assertEqual(len(grabbed), 15)
        for frame in grabbed:
            self.assertEqual(frame["status"], WHOLE)
            number = frame["integer"]["ChunkFrameID"]
            recorded = fits_of(run / f"frame_{number:06}.fits")[1]
            got = unpacked(frame["data"], "Mono12", frame["size"])
            self.assertTrue((got == shifted(recorded, "Mono12")).all(), f"frame {number}")
            # The negative control: the frame after it is another one.
            other = fits_of(run / f"frame_{number + 1:06}.fits")[1]
            self.assertFalse((got == shifted(other, "Mono12")).all())


if __name__ == "__main__":
    unittest.main(verbosity=2)
