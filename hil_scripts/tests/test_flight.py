"""flight_computer.py against `starloop run`, over gateways and a serial line: python3 hil_scripts/tests/test_flight.py

Needs python-can, cantools and pyserial (requirements_flight_computer.txt), and astropy (requirements.txt). test_vcan.py
flies over a kernel's CAN interface by the same functions.
"""

import math
import os
import pty
import re
import select
import sys
import threading
import tty
import unittest
from pathlib import Path

from astropy.io import fits

from support import BINARY, ROOT, SCRIPTS, InAFolder, Running, output, ran
from starloop import flight_computer

# A small camera: the flight is what counts. Frames at 10 Hz for longer than any flight takes.
SETTINGS = ["--set", "camera=../cameras/small_tracker.toml", "--set", "timing.duration_s=120"]
# A turn short enough for a test. A frame drawn from an attitude 100 ms old errs by jerk * t^3 / 6 = 0.5 arcsec then.
TURN = ["--slew-s", "6", "--least-frames", "15"]


class Stimulator(Running):
    """`starloop run` of a bench, to its end by Ctrl-C."""

    def __init__(self, bench, *settings, out=None):
        sink = ["--sink", "null"] if out is None else ["--out", out]
        words = [word for setting in settings for word in ("--set", setting)]
        super().__init__(BINARY, "run", ROOT / "configs/benches" / bench, *sink, "--details", *SETTINGS, *words)

    def stop(self):
        """The summary that it prints."""
        text = super().stop()
        assert self.process.returncode == 130, f"exit status {self.process.returncode}: {''.join(self.said)}"
        return text


class Gateways(Stimulator):
    """A run with gateways; `slcan` are the words for a flight computer behind that one, and `socketcand`."""

    def __init__(self, *settings, bench="gateways.toml", out=None):
        super().__init__(bench, "link.slcan_tcp=0", "link.socketcand=0", *settings, out=out)

    def __enter__(self):
        self.wait_for("socketcand at")
        self.gateways = dict(re.findall("(?m)^gateway: (.*) at (.*)$", "".join(self.said)))
        self.slcan = ["--interface", "slcan", "--channel", f"socket://{self.gateways['slcan (TCP)']}", "--fd"]
        host, port = self.gateways["socketcand"].rsplit(":", 1)
        self.socketcand = ["--interface", "socketcand", "--host", host, "--port", port, "--channel", "can0"]
        return self


def fly(*arguments):
    """One flight: exit status and what it said."""
    script = str(SCRIPTS / "starloop/flight_computer.py")
    done = ran(sys.executable, script, *TURN, *arguments, timeout=120)
    return done.returncode, done.stdout + done.stderr


ONLY_ITS_LIST = """
import importlib.metadata, re, runpy, sys

wanted, kept = [re.split("[=;]", line)[0].strip() for line in open(sys.argv[1]) if line[0] not in "#\\n"], set()
while wanted:
    name = re.sub("[-_.]+", "-", wanted.pop()).lower()
    if name not in kept:
        kept.add(name)
        needs = [need for need in importlib.metadata.requires(name) or () if "extra ==" not in need]
        wanted += [re.match("[A-Za-z0-9._-]+", need)[0] for need in needs]
        wanted = [other for other in wanted if any(True for _ in importlib.metadata.distributions(name=other))]
owners = importlib.metadata.packages_distributions()
foreign = {top for top, names in owners.items() if not kept & {re.sub("[-_.]+", "-", name).lower() for name in names}}

class Guard:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in foreign:
            raise ModuleNotFoundError(f"{name} is of none of {sorted(kept)}")

sys.meta_path.insert(0, Guard())
del sys.argv[:2]
runpy.run_path(sys.argv[0], run_name="__main__") if sys.argv[0].endswith(".py") else __import__(sys.argv[0])
"""
"""Runs a script, or imports a module, where only the packages of a list of requirements and what these need can be imported."""


def with_its_list(*words):
    """Runs a script in Python with the packages of requirements_flight_computer.txt only: exit status and output."""
    command = [sys.executable, "-c", ONLY_ITS_LIST, str(SCRIPTS / "requirements_flight_computer.txt"), *words]
    environment = {**os.environ, "PYTHONPATH": str(SCRIPTS)}
    done = ran(*command, env=environment, timeout=120)
    return done.returncode, done.stdout + done.stderr


class Relay:
    """Two pseudo terminals whose far ends are joined: what a null-modem cable is."""

    def __init__(self):
        self.pairs = [pty.openpty() for _ in range(2)]
        for _, slave in self.pairs:
            tty.setraw(slave)
        self.paths = [os.ttyname(slave) for _, slave in self.pairs]
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.carry)
        self.thread.start()

    def carry(self):
        masters = [master for master, _ in self.pairs]
        other = {masters[0]: masters[1], masters[1]: masters[0]}
        while not self.over.is_set():
            for readable in select.select(masters, [], [], 0.1)[0]:
                os.write(other[readable], os.read(readable, 4096))

    def close(self):
        self.over.set()
        self.thread.join()
        for fd in (fd for pair in self.pairs for fd in pair):
            os.close(fd)


def frames_of(folder):
    """Header and mean digital number of every recorded frame, by number."""
    found = {}
    for path in sorted(Path(folder).glob("frame_*.fits")):
        with fits.open(path) as units:
            found[units[0].header["FRAME"]] = (dict(units[0].header), float(units[0].data.mean()))
    return found


class TriggeredFaults(InAFolder):
    """Faults of a bench with an external flight computer."""

    def test_frames_from_the_trigger_on_carry_the_fault_in_the_header_and_in_the_light(self):
        with Gateways(bench="gateways_faults.toml", out=self.folder / "run") as starloop:
            status, said = fly(*starloop.slcan, "--trigger", "7@2.5")
            self.assertEqual(status, 0, said)
            self.assertIn("trigger 7 was taken", said)
            summary = starloop.stop()
        self.assertRegex(summary.splitlines()[0], r"^INCOMPLETE: \d+ of \d+ frames on time, 0 lost; .*stopped before its end; p99 latency ")
        self.assertIn("trigger_fired 1", summary)
        frames = frames_of(self.folder / "run")
        hit = [number for number, (header, _) in frames.items() if "stray_light" in str(header["FAULTS"])]
        lit = {number for number, (header, _) in frames.items() if header["FAULTS"] == "none"}
        self.assertGreater(len(hit), 20, "5 s at 10 Hz, less what the machine was late for")
        self.assertLess(max(hit) - min(hit), 51, "and no longer")
        before = [mean for number, (_, mean) in frames.items() if number in lit and number < min(hit)]
        self.assertGreater(len(before), 5, "control: frames before the trigger have no fault")
        first, last = frames[min(hit)][1], frames[max(hit)][1]
        self.assertGreater(last, first + 20.0, f"the light rises: {first} to {last} DN")
        self.assertLess(max(before), min(frames[number][1] for number in hit[5:]), "and is above what was before")


class Attitude(unittest.TestCase):
    def test_pointing_and_quaternion_are_inverse_and_the_turn_is_the_rates(self):
        for angles in [(1.4, -0.1, 0.35), (4.0, 1.2, -2.5), (0.1, -1.4, 3.0)]:
            q = flight_computer.pointed(*angles)
            for wanted, got in zip(angles, flight_computer.pointing(q)):
                self.assertAlmostEqual(math.remainder(wanted - got, 2 * math.pi), 0.0, places=12)
        slew = flight_computer.Slew(flight_computer.pointed(1.0, 0.5, 0.0), (0, 0, 2), math.radians(5), 0.0, 8.0)
        before, rate, _ = slew.at(4.0)
        after, _, _ = slew.at(4.0 + 1e-6)
        # Body +Z does not move in a turn about itself; body +X of ICRF moves by -w x X in body axes.
        moved = [(b - a) / 1e-6 for a, b in zip(column(before), column(after))]
        x, y, z = column(before)
        wanted = (y * rate[2], -x * rate[2], 0.0)
        for m, w in zip(moved, wanted):
            self.assertAlmostEqual(m, w, places=6)


def column(q):
    """The ICRF's first axis in body axes."""
    return [row[0] for row in flight_computer.matrix(q)]


class Flights(InAFolder):
    def check(self, status, said):
        self.assertEqual(status, 0, said)
        self.assertIn("(the same file)", said)
        self.assertIn("largest error", said)

    def test_slcan_with_can_fd(self):
        with Gateways() as starloop:
            status, said = fly(*starloop.slcan)
            self.check(status, said)
            summary = starloop.stop()
            self.assertRegex(summary, r"bus to history +\d{2,}", "latency from the bus into the history")
            self.assertIn("session_run 1", summary)

    def test_three_packages_are_enough(self):
        folder = SCRIPTS / "starloop"
        with Gateways() as starloop:
            self.check(*with_its_list(str(folder / "flight_computer.py"), *TURN, *starloop.slcan))
            status, said = with_its_list(str(folder / "bus_report.py"), *starloop.slcan, "--seconds", "0.5")
            self.assertEqual(status, 0, said)
        for other in ("astropy", "numpy"):
            status, said = with_its_list(other)
            self.assertNotEqual(status, 0, "control: other packages cannot be imported")
            self.assertIn(f"{other} is of none of", said)

    def test_trigger_that_nothing_waits_for_is_refused_with_its_reason(self):
        with Gateways() as starloop:
            status, said = fly(*starloop.slcan, "--trigger", "7")
            self.assertEqual(status, 1, said)
            reason = "UnknownTrigger (code 11): no fault or event of the run waits for this number"
            self.assertIn(f"flight_computer: trigger 7: TRIGGER was refused: {reason}\n", said)
            self.assertNotIn("was taken", said)
            summary = starloop.stop()
            self.assertIn("trigger_refused 1", summary)
            self.assertIn("triggers_refused 1", summary)
            self.assertNotIn("trigger_fired", summary)

    def test_a_flight_that_is_not_as_reported_is_seen(self):
        with Gateways() as starloop:
            # Two arcseconds more than was sent: the comparison must fail.
            status, said = fly(*starloop.slcan, "--biased-deg", "0.0006")
            self.assertEqual(status, 4, said)

    def test_socketcand_with_classic_can_at_another_node(self):
        node = ["link.wire=can_classic", "link.node=5", "link.id_base=128"]
        with Gateways(*node) as starloop:
            self.check(*fly(*starloop.socketcand, "--node", "5", "--id-base", "128"))

    def test_slcan_with_identifiers_of_29_bits(self):
        ids = ["link.id_bits=29", "link.id_base=0x18FF0000", "link.node=5"]
        with Gateways(*ids) as starloop:
            self.check(*fly(*starloop.slcan, "--node", "5", "--id-base", "0x18FF0000", "--id-bits", "29"))
            # Identifiers of another length are not this node's.
            status, said = fly(*starloop.slcan, "--node", "5")
            self.assertEqual(status, 1, said)
            self.assertIn("no answer to HELLO", said)

    def test_serial_line(self):
        relay = Relay()
        try:
            with Stimulator("serial.toml", f"link.port={relay.paths[0]}") as starloop:
                starloop.wait_for('bench "')
                self.check(*fly("--serial", relay.paths[1]))
        finally:
            relay.close()

    def test_a_serial_line_in_c(self):
        kit, relay = ROOT / "firmware_protocol" / "c", Relay()
        program = self.folder / "serial_flight"
        warnings = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
        built = ran("cc", *warnings, "-o", program, kit / "serial_flight.c", kit / "starloop_protocol.c", "-lm")
        self.assertEqual(built.returncode, 0, built.stderr)
        try:
            with Stimulator("serial.toml", f"link.port={relay.paths[0]}") as starloop:
                starloop.wait_for('bench "')
                done = ran(program, relay.paths[1], timeout=60)
                self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                self.assertRegex(done.stdout, r"^\d{2,} exposures reported, 0 packets refused")
            alone = ran(program, relay.paths[1], timeout=60)
            self.assertEqual((alone.returncode, alone.stdout), (1, ""), "control: without a stimulator")
        finally:
            relay.close()

    def test_a_trigger_that_is_none_is_refused_before_the_flight(self):
        for trigger, part in [("65536", "0 to 65535"), ("-1", "0 to 65535"), ("x@1", "0 to 65535"), ("7@soon", "wanted seconds")]:
            status, said = fly("--interface", "slcan", "--channel", "socket://127.0.0.1:1", f"--trigger={trigger}")
            self.assertEqual(status, 2, said)
            self.assertIn(part, said)

    def test_an_absent_peer_is_reported_plainly(self):
        status, said = fly("--interface", "slcan", "--channel", "socket://127.0.0.1:1")
        self.assertEqual(status, 1)
        self.assertIn("cannot connect", said)
        self.assertNotIn("Traceback", said)

    def test_the_bus_report_has_load_and_latency(self):
        with Gateways() as starloop:
            script = str(SCRIPTS / "starloop/bus_report.py")
            said = output(sys.executable, script, *starloop.slcan, "--seconds", "2", "--ask")
            self.assertRegex(said, r"STATUS +\d+\.\d +\d+\.\d\d")
            self.assertRegex(said, r"command to response, \d+ times: p50 [\d.]+ ms")


if __name__ == "__main__":
    unittest.main(verbosity=2)
