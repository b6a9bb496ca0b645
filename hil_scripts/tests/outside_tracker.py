"""A star tracker outside that answers the frames of a running starloop: outside_tracker.py FRAMES HOST:PORT [options]

FRAMES is the file of a `shared_memory` sink, or `camera:ADDRESS`, a network camera (Aravis, in the system's Python).
HOST:PORT is where `[[tracker_in]]` listens: JSON in datagrams, or with --node CANopen on slcan over TCP. The stand-in
"solves" a frame by the attitude that its head in shared memory has, with noise; --cedar CAMERA solves its pixels with
cedar-solve (PyPI), which knows nothing else. Answers name their frame by its number, or with --by-time, as those to a
camera, by its time stamp.
"""

import argparse
import collections
import json
import random
import socket
import struct
import sys
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path

sys.path[1:1] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parents[1] / "measure")]

from starloop.shared_frames import SharedFrames

ARCSEC_PER_RAD = 206264.80624709636
TAI_LESS_UTC_S = 37
MS_PER_DAY = 86_400_000
SILENT_S = 5.0
"""A camera that sends nothing for so long has ended."""

Seen = collections.namedtuple("Seen", "number tai_ns truth shape pixels")


def product(a, b):
    """Hamilton product of two quaternions, scalar first."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


def shared(path, wait_s):
    """Frames of a ring in shared memory, as soon as a run has made it."""
    until = time.monotonic() + wait_s
    while True:
        try:
            ring = SharedFrames(path)
            break
        except (OSError, ValueError):
            if time.monotonic() > until:
                raise
            time.sleep(0.02)
    with ring:
        for head, pixels in ring.frames():
            shape = head["height_px"], head["width_px"]
            yield Seen(head["frame"], head["mid_exposure_tai_ns"], [head[key] for key in ("qw", "qx", "qy", "qz")], shape, pixels)


def of_camera(address, wait_s):
    """Frames of a network camera; without number and truth."""
    from aravis import Aravis, stream_of

    until = time.monotonic() + wait_s
    while True:
        try:
            camera = Aravis.Camera.new(address)
            break
        except Exception:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)
    camera.get_device().set_string_feature_value("PixelFormat", "Mono16")
    stream = stream_of(camera)
    camera.start_acquisition()
    while buffer := stream.timeout_pop_buffer(int(SILENT_S * 1e6)):
        if buffer.get_status().value_nick == "success":
            shape = buffer.get_image_height(), buffer.get_image_width()
            yield Seen(None, buffer.get_timestamp(), None, shape, bytes(buffer.get_image_data()))
        stream.push_buffer(buffer)


class Imitation:
    """The truth of a frame with noise."""

    STARS = 12

    def __init__(self, sigma_arcsec, off_arcsec, seed):
        self.off_rad = [off / ARCSEC_PER_RAD for off in off_arcsec]
        self.sigma_rad = [sigma / ARCSEC_PER_RAD for sigma in sigma_arcsec]
        self.dice = random.Random(seed)

    def solve(self, frame):
        half = [-0.5 * self.dice.gauss(off, sigma) for off, sigma in zip(self.off_rad, self.sigma_rad)]
        return product([1.0, *half], frame.truth), self.STARS


class Cedar:
    """cedar-solve on the pixels of each frame alone: lost in space."""

    TIMEOUT_MS = 400.0

    def __init__(self, camera):
        import cedar_tracker

        self.made, self.file, self.camera = cedar_tracker, camera, None
        self.tetra = cedar_tracker.solver()

    def solve(self, frame):
        import numpy

        self.camera = self.camera or self.made.Camera(self.file, frame.shape)
        image = numpy.frombuffer(frame.pixels, "<u2").reshape(frame.shape).astype(float)
        when = datetime(1970, 1, 1, tzinfo=timezone.utc) + timedelta(seconds=frame.tai_ns * 1e-9 - TAI_LESS_UTC_S)
        found = self.made.attitude_of(self.tetra, self.camera, image, self.TIMEOUT_MS, when)
        return (None, 0) if found is None else ([float(part) for part in found[0]], int(found[1]))


class Datagrams:
    """Answers in JSON, a datagram each."""

    def __init__(self, address, by_time):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(address)
        self.by_time = by_time

    def answer(self, frame, q, stars):
        is_by_time = self.by_time or frame.number is None
        key = {"tai_ns": frame.tai_ns} if is_by_time else {"frame": frame.number}
        try:
            self.socket.send(json.dumps({**key, "q_wxyz": q, "stars": stars}).encode())
        except ConnectionRefusedError:
            pass  # the run is over


class CanOpen:
    """A CANopen node on slcan: it waits for its start, and answers in up to three PDOs."""

    def __init__(self, address, node):
        self.socket, self.node = socket.create_connection(address, timeout=10.0), node
        self.socket.sendall(b"S6\rO\r")
        self.send(0x700, b"\0")
        said = b""
        while b"t000201%02X" % node not in said:
            more = self.socket.recv(4096)
            if not more:
                raise ConnectionError(f"got {said[-200:]!r}, wanted the start of node {node}")
            said += more

    def send(self, identifier, data):
        try:
            self.socket.sendall(b"t%03X%d%s\r" % (identifier + self.node, len(data), data.hex().upper().encode()))
        except (BrokenPipeError, ConnectionResetError):
            pass  # the run is over

    def drain(self):
        """Reads what others say on the bus: a client that does not read is dropped."""
        self.socket.setblocking(False)
        try:
            while self.socket.recv(65536):
                pass
        except (BlockingIOError, ConnectionResetError):
            pass
        self.socket.setblocking(True)

    def answer(self, frame, q, stars):
        self.drain()
        utc_ms = frame.tai_ns // 1_000_000 - TAI_LESS_UTC_S * 1000
        self.send(0x180, struct.pack("<BBHI", 2, int(q is not None), stars, utc_ms % MS_PER_DAY))
        if q is not None:
            self.send(0x280, struct.pack("<2f", *q[:2]))
            self.send(0x380, struct.pack("<2f", *q[2:]))


def arguments():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("frames")
    words.add_argument("address")
    words.add_argument("--sigma-arcsec", type=float, nargs=3, default=[5.0, 5.0, 40.0])
    words.add_argument("--off-arcsec", type=float, nargs=3, default=[0.0, 0.0, 0.0], help="a constant error")
    words.add_argument("--node", type=int)
    words.add_argument("--by-time", action="store_true")
    words.add_argument("--cedar", metavar="CAMERA")
    words.add_argument("--delay-ms", type=float, default=0.0, help="thinks for so long")
    words.add_argument("--skip", type=int, default=0, help="answers no frame whose number this divides")
    words.add_argument("--slow", type=int, default=0, help="thinks a second about each frame whose number this divides")
    words.add_argument("--wait-s", type=float, default=20.0)
    return words.parse_args()


def main():
    given = arguments()
    host, port = given.address.rsplit(":", 1)
    solver = Cedar(given.cedar) if given.cedar else Imitation(given.sigma_arcsec, given.off_arcsec, given.node or 1)
    kind, _, place = given.frames.rpartition("camera:")
    frames = of_camera(place, given.wait_s) if kind == "" and place != given.frames else shared(given.frames, given.wait_s)
    line, answered, lost = None, 0, 0
    for place, frame in enumerate(frames):
        line = line or (CanOpen((host, int(port)), given.node) if given.node else Datagrams((host, int(port)), given.by_time))
        number = place if frame.number is None else frame.number
        if given.skip and number % given.skip == 0:
            continue
        q, stars = solver.solve(frame)
        time.sleep(1.0 if given.slow and number % given.slow == 0 else given.delay_ms * 1e-3)
        line.answer(frame, q, stars)
        answered, lost = answered + 1, lost + (q is None)
    print(f"{answered} frames answered, {lost} without an attitude")


if __name__ == "__main__":
    main()
