"""Tests of the network camera's PTP features: python3 hil_scripts/tests/test_camera_ptp.py

PtpStatus is Slave with `ptp4l` (linuxptp) that follows another one over a pair of virtual interfaces, and the numbers are
those that `pmc` reads. Where the kernel gives no network namespaces, or no right to set a clock, a simulated clock that
answers management messages takes its place; it also plays what a real one seldom does. Needs camera_feed (as
test_network_camera.py), genicam (PyPI) and linuxptp (apt).
"""

import os
import re
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path

from support import InAFolder, ran
from gvcp_client import Client
from test_network_camera import PATIENCE_S, Camera

os.environ["PATH"] += ":/usr/sbin:/sbin"

FOLLOWER = "[global]\ntime_stamping software\nslaveOnly 1\nuds_address {}\n"
LEADER = "[global]\ntime_stamping software\npriority1 100\nuds_address {}\n"


def signed(identity):
    """The integer of GenApi that is a clock's identity."""
    return int.from_bytes(identity, "big", signed=True)


class PtpClient:
    """A camera's features, and waiting for its clock."""

    def __init__(self, camera):
        self.client = Client(camera.address)
        self.nodes = self.client.nodes()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.client.close()

    def get(self, name):
        return self.nodes.get_node(name).value

    def set(self, name, value):
        self.nodes.get_node(name).value = value

    def latch(self):
        self.nodes.get_node("PtpDataSetLatch").execute()

    def wait_for(self, status, patience_s=PATIENCE_S):
        until = time.monotonic() + patience_s
        while (reported := self.get("PtpStatus")) != status:
            assert time.monotonic() < until, f"PtpStatus is {reported}, wanted {status}"
            time.sleep(0.1)


class SimulatedClock:
    """Answers management messages as ptp4l does. `state`, `offset_ns` and the rest may change at any time."""

    OWN, PARENT, GRANDMASTER = bytes.fromhex("fa0b0cfffe0d0e0f"), bytes.fromhex("1a1b1cfffe1d1e1f"), bytes.fromhex("2a2b2cfffe2d2e2f")

    def __init__(self, path):
        self.state, self.offset_ns, self.delay_ns, self.accuracy, self.is_silent = 4, 0, 0, 0xFE, False
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.questions = 0
        threading.Thread(target=self.answer, daemon=True).start()

    def answer(self):
        while True:
            question, sender = self.socket.recvfrom(1500)
            assert question[0] & 15 == 13 and question[46] & 15 == 0, "GET"
            self.questions += 1
            data = {
                0x2000: bytes([1, 0, 0, 1, 128, 248, self.accuracy, 0, 0, 128]) + self.OWN + b"\0\0",
                0x2001: struct.pack(">Hqq", 1, self.offset_ns << 16, self.delay_ns << 16),
                0x2002: self.PARENT + bytes(16) + self.GRANDMASTER,
                0x2004: self.OWN + struct.pack(">HB", 1, self.state) + bytes(15),
            }[struct.unpack(">H", question[52:54])[0]]
            if not self.is_silent:
                answer = bytearray(question + data)
                answer[2:4], answer[46], answer[50:52] = struct.pack(">H", len(answer)), 2, struct.pack(">H", 2 + len(data))
                self.socket.sendto(answer, sender)


class Simulated(InAFolder):
    def test_state_and_numbers_are_those_of_the_clock(self):
        path = self.folder / "ptp4l"
        clock = SimulatedClock(path)
        with Camera(ptp_socket=path, recorded=False) as camera, PtpClient(camera) as ptp:
            self.assertEqual((ptp.get("PtpStatus"), ptp.get("PtpEnable"), clock.questions), ("Disabled", False, 0))
            ptp.set("PtpEnable", True)
            ptp.wait_for("Listening")
            self.assertEqual(ptp.get("PtpServoStatus"), "Unknown")
            clock.state, clock.offset_ns, clock.delay_ns, clock.accuracy = 9, -123, 4567, 0x21
            ptp.wait_for("Slave")
            self.assertEqual((ptp.get("PtpServoStatus"), ptp.get("PtpOffsetFromMaster")), ("Locked", 0), "before the latch")
            ptp.latch()
            names = ["PtpOffsetFromMaster", "PtpMeanPropagationDelay", "PtpClockAccuracy"]
            self.assertEqual([ptp.get(name) for name in names], [-123, 4567, "Within100ns"])
            names = ["PtpClockID", "PtpParentClockID", "PtpGrandmasterClockID"]
            clocks = [signed(clock) for clock in (clock.OWN, clock.PARENT, clock.GRANDMASTER)]
            self.assertEqual([ptp.get(name) for name in names], clocks)
            clock.offset_ns = 99
            clock.state = 8
            ptp.wait_for("Uncalibrated")
            self.assertEqual(ptp.get("PtpOffsetFromMaster"), -123, "of the latch")
            clock.is_silent = True
            ptp.wait_for("Faulty")
            clock.is_silent = False
            ptp.wait_for("Uncalibrated")
            ptp.set("PtpEnable", False)
            self.assertEqual(ptp.get("PtpStatus"), "Disabled")

    def test_without_a_clock_the_state_is_faulty(self):
        with Camera(ptp_socket="/nowhere/ptp4l", recorded=False) as camera, PtpClient(camera) as ptp:
            ptp.set("PtpEnable", True)
            self.assertEqual(ptp.get("PtpStatus"), "Initializing")
            ptp.wait_for("Faulty")


class Ptp4l:
    """Two clocks in network namespaces of their own, joined by a pair of virtual interfaces; the second follows."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.names = [f"starloop_{who}_{os.getpid()}" for who in ("leader", "follower")]
        self.clocks = []

    def __enter__(self):
        try:
            for name in self.names:
                self.ip("netns", "add", name)
            self.ip("-n", self.names[0], "link", "add", "ptp0", "type", "veth", "peer", "name", "ptp0", "netns", self.names[1])
            for number, name in enumerate(self.names):
                self.ip("-n", name, "addr", "add", f"10.77.0.{1 + number}/24", "dev", "ptp0")
                self.ip("-n", name, "link", "set", "ptp0", "up")
            for name, text in zip(self.names, (LEADER, FOLLOWER)):
                settings = self.folder / f"{name}.cfg"
                settings.write_text(text.format(self.folder / name))
                command = ["ip", "netns", "exec", name, "ptp4l", "-4", "-i", "ptp0", "-m", "-f", str(settings)]
                with open(self.folder / f"{name}.log", "w") as log:
                    self.clocks.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT))
        except (OSError, subprocess.CalledProcessError) as reason:
            self.__exit__()
            raise PermissionError(str(getattr(reason, "stderr", None) or reason)) from reason
        return self

    def __exit__(self, *_):
        for clock in self.clocks:
            clock.terminate()
            clock.wait()
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True)

    def ip(self, *words):
        subprocess.run(["ip", *words], check=True, capture_output=True, text=True)

    def follower(self):
        return self.folder / self.names[1]

    def reported(self):
        """Returns the follower's state as read by pmc, linuxptp's own client."""
        command = ["pmc", "-u", "-b", "0", "-s", str(self.follower()), "-i", str(self.folder / "pmc"),
                   "GET DEFAULT_DATA_SET", "GET PARENT_DATA_SET", "GET PORT_DATA_SET"]
        return ran(*command).stdout


class Linuxptp(InAFolder):
    def test_status_is_slave_with_ptp4l(self):
        if not shutil.which("ptp4l") or os.geteuid() != 0:
            print("\nptp4l cannot be started here (no linuxptp, or not root): the simulated clock is the test")
            return
        try:
            clocks = Ptp4l(self.folder).__enter__()
        except PermissionError as reason:
            print(f"\nno network namespaces here ({reason}): the simulated clock is the test")
            return
        try:
            with Camera(ptp_socket=clocks.follower(), recorded=False) as camera, PtpClient(camera) as ptp:
                ptp.set("PtpEnable", True)
                ptp.wait_for("Listening")
                ptp.wait_for("Slave", patience_s=2 * PATIENCE_S)
                ptp.latch()
                reported = clocks.reported()
                self.assertIn("SLAVE", reported)
                # GenApi's integers are signed.
                identity = lambda key: signed(bytes.fromhex(re.search(rf"{key}\s+([0-9a-f.]+)", reported)[1].replace(".", "")))
                self.assertEqual(ptp.get("PtpClockID"), identity("clockIdentity"))
                self.assertEqual(ptp.get("PtpGrandmasterClockID"), identity("grandmasterIdentity"))
                self.assertNotEqual(ptp.get("PtpClockID"), ptp.get("PtpGrandmasterClockID"), "control")
                self.assertEqual((ptp.get("PtpServoStatus"), ptp.get("PtpParentClockID")), ("Locked", ptp.get("PtpGrandmasterClockID")))
                delay_ns, offset_ns = ptp.get("PtpMeanPropagationDelay"), ptp.get("PtpOffsetFromMaster")
                print(f"\nptp4l: Slave, offset {offset_ns} ns, delay {delay_ns} ns")
                self.assertGreater(delay_ns, 0)
        finally:
            log = (self.folder / f"{clocks.names[1]}.log").read_text()
            clocks.__exit__()
            if sys.exc_info()[0]:
                print(log)


if __name__ == "__main__":
    unittest.main()
