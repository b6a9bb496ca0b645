"""A star tracker outside that answers frames of a running starloop: outside_tracker.py FRAMES HOST:PORT [options]

FRAMES is the file of a `shared_memory` sink, HOST:PORT where `[[tracker_in]]` listens: UDP and JSON, or with --node slcan
over TCP and CANopen. The stand-in "solves" a frame by the attitude that is in its head, with noise; --cedar CAMERA solves
its pixels by cedar-solve (PyPI), which knows nothing else. Answers have the number of the frame, or with --by-time its
time stamp alone, as a camera on the network gives it.
"""

import argparse
import json
import random
import socket
import struct
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from starloop.shared_frames import SharedFrames

ARCSEC_PER_RAD = 206264.80624709636
TAI_LESS_UTC_S = 37
MS_PER_DAY = 86_400_000
STARS = 12


def product(a, b):
    """Hamilton product of two quaternions, scalar first."""
    (w, x, y, z), (s, i, j, k) = a, b
    return [w * s - x * i - y * j - z * k, w * i + x * s + y * k - z * j, w * j - x * k + y * s + z * i, w * k + x * j - y * i + z * s]


class StandIn:
    """The truth of a frame with noise."""

    def __init__(self, sigma_arcsec, seed=1):
        self.sigma_rad = [sigma / ARCSEC_PER_RAD for sigma in sigma_arcsec]
        self.dice = random.Random(seed)

    def solve(self, frame):
        half = [0.5 * self.dice.gauss(0.0, sigma) for sigma in self.sigma_rad]
        return product([1.0, *(-part for part in half)], [frame.head[key] for key in ("qw", "qx", "qy", "qz")]), STARS


class Cedar:
    """cedar-solve on the pixels: lost in space with each frame."""

    def __init__(self, camera):
        from cedar_tracker import CedarTracker

        self.tracker, self.camera = None, camera
        self.make = CedarTracker

    def solve(self, frame):
        import numpy

        shape = (frame.head["height_px"], frame.head["width_px"])
        if self.tracker is None:
            self.tracker = self.make(self.camera, shape)
        image = numpy.frombuffer(frame.pixels, numpy.uint16).reshape(shape).astype(float)
        return self.tracker.solve(image)


class UdpJson:
    """Answers in datagrams."""

    def __init__(self, address, by_time):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(address)
        self.by_time = by_time

    def answer(self, frame, q, stars):
        head = frame.head
        key = {"tai_ns": head["mid_exposure_tai_ns"]} if self.by_time else {"frame": head["frame"]}
        try:
            self.socket.send(json.dumps({**key, "q_wxyz": q, "stars": stars}).encode())
        except ConnectionRefusedError:
            pass  # the run is over


class SlcanCanOpen:
    """A CANopen node on slcan: three PDOs with each answer, once it is started."""

    def __init__(self, address, node):
        self.socket = socket.create_connection(address)
        self.socket.settimeout(5.0)
        self.node = node
        self.socket.sendall(b"O\r")
        self.send(0x700, b"\0")
        heard = b""
        while b"t0002" + b"01%02X" % node not in heard:
            more = self.socket.recv(256)
            if not more:
                raise ConnectionError(f"got {heard!r}, wanted the start of node {node}")
            heard += more
        self.socket.setblocking(False)

    def send(self, identifier, data):
        self.socket.setblocking(True)
        self.socket.sendall(b"t%03X%d%s\r" % (identifier + self.node, len(data), data.hex().upper().encode()))

    def answer(self, frame, q, stars):
        utc_ms = frame.head["mid_exposure_tai_ns"] // 1_000_000 - TAI_LESS_UTC_S * 1000
        state = struct.pack("<BBHI", 2, int(q is not None), stars, utc_ms % MS_PER_DAY)
        self.send(0x180, state)
        if q is not None:
            self.send(0x280, struct.pack("<2f", *q[:2]))
            self.send(0x380, struct.pack("<2f", *q[2:]))


def opened(path, wait_s):
    """The ring of frames, as soon as a run has made it."""
    until = time.monotonic() + wait_s
    while True:
        try:
            return SharedFrames(path)
        except (OSError, ValueError):
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("frames")
    words.add_argument("address")
    words.add_argument("--sigma-arcsec", type=float, nargs=3, default=[5.0, 5.0, 40.0])
    words.add_argument("--node", type=int, help="CANopen node on slcan; without it JSON over UDP")
    words.add_argument("--by-time", action="store_true")
    words.add_argument("--cedar", metavar="CAMERA", help="camera file of the frames")
    words.add_argument("--delay-ms", type=float, default=0.0, help="thinks for so long")
    words.add_argument("--skip", type=int, default=0, help="answers no frame whose number this divides")
    words.add_argument("--slow", type=int, default=0, help="thinks a second about each frame whose number this divides")
    words.add_argument("--wait-s", type=float, default=20.0)
    given = words.parse_args()
    host, port = given.address.rsplit(":", 1)
    address = host, int(port)
    solver = Cedar(given.cedar) if given.cedar else StandIn(given.sigma_arcsec)
    answered = lost = 0
    with opened(given.frames, given.wait_s) as ring:
        line = SlcanCanOpen(address, given.node) if given.node else UdpJson(address, given.by_time)
        for frame in ring.frames():
            number = frame.head["frame"]
            if given.skip and number % given.skip == 0:
                continue
            q, stars = solver.solve(frame)
            is_slow = given.slow and number % given.slow == 0
            time.sleep(1.0 if is_slow else given.delay_ms * 1e-3)
            line.answer(frame, q, stars)
            answered, lost = answered + 1, lost + (q is None)
        print(f"{answered} frames answered, {lost} without an attitude, {ring.missed} missed")


if __name__ == "__main__":
    main()
