"""starloop on a kernel with CAN, against can-utils: python3 hil_scripts/tests/test_vcan.py

Without vcan0 the script starts itself again inside user-mode Linux (uml_vcan.sh); exit status 125 and the reason where
that is unavailable. STARLOOP_NO_VCAN=1 skips every test. The tests take interfaces down, set the system's clock and
flood the bus: they run as root on a machine of their own, which the guest is.
"""

import os
import re
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

from support import BINARY, ROOT, Running, output, starloop, until

NO_VCAN = os.environ.get("STARLOOP_NO_VCAN") == "1"
# Promises of the suite, and the filters.
CHECKS = 10


def link_check(*arguments, **options):
    return starloop("link-check", "--kind", "socketcan", *arguments, **options)


class Lines(Running):
    """A program whose lines, errors among them, are read as they come."""

    def __init__(self, *command):
        super().__init__(*command, stderr=subprocess.STDOUT)
        self.first = 0

    def read(self):
        return "".join(self.printed[self.first :])

    def wait_for(self, pattern):
        until(lambda: f"{pattern!r} in {self.read()[-2000:]!r}", lambda: re.search(pattern, self.read()))


class Echo(Lines):
    """The program at one end of an interface, sending back what arrives."""

    def __init__(self, interface, *arguments):
        command = [BINARY, "link-check", "--kind", "socketcan", "--interface", interface, "--echo", "--duration", "600"]
        super().__init__(*command, *arguments)
        self.wait_for(f"ready {interface}\n")

    def counters(self):
        lines = [line for line in self.read().splitlines(keepends=True) if "=" in line and line.endswith("\n")]
        return {key: float(value) for key, value in re.findall(r"(\w+)=([-\d.]+)", lines[-1])} if lines else {}

    def wait_counters(self, **wanted):
        def holds():
            counters = self.counters()
            return all(counters.get(key) == value for key, value in wanted.items())

        until(lambda: f"{wanted}, got {self.counters()}", holds)
        return self.counters()


class Dump(Lines):
    """candump, stamped frames in its log format."""

    def __init__(self, interface):
        super().__init__("candump", "-L", f"{interface},0:0,#FFFFFFFF")
        self.interface = interface
        # candump does not report when it is ready: a frame of ours shows it.
        until(lambda: "candump receives", lambda: output("cansend", interface, "7FF#") == "" and "7FF#" in self.read())
        # It may have taken several, and some are still to be read: the next frame is behind them all.
        output("cansend", interface, "7FE#")
        until(lambda: "candump receives the last of its own", lambda: "7FE#" in self.read())
        self.first = len(self.printed)

    def frames(self):
        """Frames in the notation of cansend. Some kernels mark FD frames with flag 4, which says no more than ## does."""
        frames = [line.split()[2] for line in self.read().splitlines() if line.count(" ") == 2]
        return [re.sub("##(.)", lambda flags: f"##{int(flags[1], 16) & ~4:X}", frame) for frame in frames]

    def wait_frames(self, wanted):
        until(lambda: f"{wanted}, got {self.frames()}", lambda: len(self.frames()) >= len(wanted))
        # A later frame is here, so unwanted ones would be here too.
        return self.frames()


class OnVcan(unittest.TestCase):
    def setUp(self):
        if NO_VCAN:
            self.skipTest("STARLOOP_NO_VCAN=1")


class Suite(OnVcan):
    def hold(self, *arguments):
        done = link_check(*arguments, status=0)
        self.assertEqual(done.stdout.count("held  "), CHECKS, done.stdout)
        self.assertIn("0 unstamped", done.stdout)
        print(f"{' '.join(arguments)}\n{done.stdout}", end="")

    def test_classic_can_keeps_every_promise(self):
        self.hold("--interface", "vcan0")

    def test_can_fd_keeps_every_promise(self):
        self.hold("--interface", "vcan0", "--fd")

    def test_ends_without_a_cable_break_the_promises(self):
        done = link_check("--interface", "vcan0", "--peer", "vcan1")
        self.assertEqual(done.returncode, 4, "control: two interfaces that are not connected")
        self.assertIn("BROKEN", done.stdout)


class Refusals(OnVcan):
    def refused(self, *arguments):
        return link_check(*arguments, status=1).stderr

    def test_an_absent_interface(self):
        self.assertRegex(self.refused("--interface", "can9"), "can9.*No such device.*ip link add vcan0 type vcan")

    def test_an_interface_that_is_no_can(self):
        self.assertRegex(self.refused("--interface", "lo"), "is it a CAN interface")

    def test_an_interface_that_is_down(self):
        output("ip", "link", "set", "vcan1", "down")
        try:
            self.assertRegex(self.refused("--interface", "vcan1"), "vcan1.*Network is down.*ip link set")
        finally:
            output("ip", "link", "set", "vcan1", "up")

    def test_can_fd_on_an_interface_for_classic_can(self):
        output("ip", "link", "set", "vcan1", "down")
        output("ip", "link", "set", "vcan1", "mtu", "16")
        output("ip", "link", "set", "vcan1", "up")
        try:
            self.assertRegex(self.refused("--interface", "vcan1", "--fd"), "MTU is 16, wanted 72.*dbitrate")
            self.assertEqual(link_check("--interface", "vcan1").returncode, 0, "classic CAN goes")
        finally:
            output("ip", "link", "set", "vcan1", "down")
            output("ip", "link", "set", "vcan1", "mtu", "72")
            output("ip", "link", "set", "vcan1", "up")


class AgainstCanUtils(OnVcan):
    def test_frames_go_both_ways_as_they_are(self):
        sent = ["123#", "7FF#1122334455667788", "001##0AA", "123##1" + "5A" * 64]
        # Identifiers of 29 bits, one of a number that is there with 11.
        sent += ["00000123#", "1FFFFFFF#1122334455667788", "18FF0305##1" + "5A" * 48]
        # The dump first: its probing frames are not to be sent back.
        with Dump("vcan0") as dump, Echo("vcan0", "--fd") as echo:
            for number, frame in enumerate(sent, 1):
                output("cansend", "vcan0", frame)
                # Its answer is out before the next one goes in: candump sees them in turn.
                echo.wait_counters(received=number, sent=number, unsent=0)
            # FD frames leave with the bit rate switch, whatever they came with.
            returned = [frame.replace("##0", "##1") for frame in sent]
            wanted = [frame for pair in zip(sent, returned) for frame in pair]
            self.assertEqual(dump.wait_frames(wanted), wanted)

    def test_the_kernel_keeps_out_what_is_no_data_frame(self):
        with Echo("vcan0", "--fd") as echo:
            for frame in ["00000123#R", "123#R", "123#01"]:
                output("cansend", "vcan0", frame)
            counters = echo.wait_counters(received=1)
            self.assertEqual((counters["sent"], counters["errors"]), (1, 0))

    def test_error_frames_are_counted_and_not_passed_on(self):
        with Echo("vcan0") as echo:
            output("cansend", "vcan0", "20000008#0000040000000000")  # protocol violation: a stuffing error
            echo.wait_counters(errors=1, bus_off=0)
            output("cansend", "vcan0", "20000004#0001000000000000")  # the controller lost a frame
            echo.wait_counters(errors=2, overflows=1)
            output("cansend", "vcan0", "20000040#0000000000000000")
            echo.wait_counters(errors=3, bus_off=1, restarted=0)
            output("cansend", "vcan0", "20000100#0000000000000000")
            output("cansend", "vcan0", "123#01")
            counters = echo.wait_counters(restarted=1, received=1)
            self.assertEqual((counters["errors"], counters["bus_off"], counters["sent"]), (3, 1, 1))


class Losses(OnVcan):
    def talk(self, echo, interface, received):
        output("cansend", interface, "123#55")
        return echo.wait_counters(received=received, sent=received)

    def test_an_interface_taken_down_comes_back(self):
        with Echo("vcan1", "--fd") as echo:
            self.talk(echo, "vcan1", 1)
            for time_lost in (1, 2):
                output("ip", "link", "set", "vcan1", "down")
                echo.wait_counters(lost=time_lost, regained=time_lost - 1)
                output("ip", "link", "set", "vcan1", "up")
                echo.wait_counters(lost=time_lost, regained=time_lost)
                self.talk(echo, "vcan1", time_lost + 1)
            self.assertIsNone(echo.process.poll(), "still there")

    def test_an_interface_unplugged_comes_back(self):
        output("ip", "link", "add", "vcan2", "type", "vcan")
        output("ip", "link", "set", "vcan2", "mtu", "72", "up")
        with Echo("vcan2", "--fd") as echo:
            self.talk(echo, "vcan2", 1)
            output("ip", "link", "del", "vcan2")
            echo.wait_counters(lost=1, regained=0)
            time.sleep(0.5)  # some vain looks
            output("ip", "link", "add", "vcan2", "type", "vcan")
            output("ip", "link", "set", "vcan2", "mtu", "72", "up")
            echo.wait_counters(lost=1, regained=1)
            self.talk(echo, "vcan2", 2)
        output("ip", "link", "del", "vcan2")

    def test_a_lost_interface_is_waited_for_asleep(self):
        # Times of the CPU say little where ticks are counted and the host is busy; sleeps are counted exactly. A loop that
        # spins sleeps never, or far too often. The program looks up every 20 ms.
        with Echo("vcan1") as echo:
            output("ip", "link", "set", "vcan1", "down")
            try:
                echo.wait_counters(lost=1)
                before, since = self.sleeps(echo), time.monotonic()
                until(lambda: f"{self.sleeps(echo) - before} sleeps", lambda: self.sleeps(echo) - before >= 50)
                slept, span_s = self.sleeps(echo) - before, time.monotonic() - since
            finally:
                output("ip", "link", "set", "vcan1", "up")
            self.assertLess(slept, 50 + 4 * span_s / 0.02, f"in {span_s:.2f} s")

    @staticmethod
    def sleeps(echo):
        status = Path(f"/proc/{echo.process.pid}/status").read_text()
        return int(re.search(r"^voluntary_ctxt_switches:\s+(\d+)", status, re.MULTILINE)[1])

    def test_drops_of_the_kernel_are_counted_exactly(self):
        flood = 16_000
        with Echo("vcan0") as echo:
            echo.process.send_signal(signal.SIGSTOP)
            output("cangen", "vcan0", "-g", "0", "-I", "123", "-L", "8", "-D", "1122334455667788", "-n", str(flood))
            echo.process.send_signal(signal.SIGCONT)

            sent = flood

            def all_accounted_for():
                nonlocal sent
                counters = echo.counters()
                if counters and counters["received"] + counters["overflows"] == sent:
                    return True
                output("cansend", "vcan0", "124#")  # the kernel reports its count with the next frame
                sent += 1
                time.sleep(0.1)
                return False

            until(lambda: f"{sent} sent, {echo.counters()}", all_accounted_for)
            counters = echo.counters()
            self.assertGreater(counters["overflows"], 0, "the flood did not fill the buffer")
            self.assertLess(counters["overflows"], flood - 1000, "the buffer holds a burst of a thousand")
            print(f"{sent} frames: {counters}")


class Clock(OnVcan):
    """Steps of CLOCK_REALTIME, which the kernel's stamps are of."""

    def test_steps_of_the_systems_clock_spoil_no_stamp(self):
        steps_s = (3600, -7200, 3600, 5, -5, 0.25, -0.25)
        with Echo("vcan0") as echo:
            for number, step_s in enumerate(steps_s):
                for received in (2 * number + 1, 2 * number + 2):
                    output("cansend", "vcan0", "123#55")
                    counters = echo.wait_counters(received=received)
                    if abs(step_s) >= 5:
                        # A step that gets into a stamp shows as an age of its own size.
                        self.assertTrue(0 <= counters["age_us"] < 2.5e6, f"step {step_s} s: {counters}")
                    if received % 2:
                        time.clock_settime(time.CLOCK_REALTIME, time.time() + step_s)
            # Each step spoils the first stamp after it and no other.
            self.assertEqual(counters["unstamped"], len(steps_s), counters)


class Pulses(OnVcan):
    """The kernel's own pulses, of a timer (pps-ktimer) that ticks in steps of 10 ms."""

    def watch(self):
        return Lines(BINARY, "link-check", "--pps", "/sys/class/pps/pps0", "--duration", "8")

    def after_ms(self, pulses):
        return [float(ms) for ms in re.findall(r"after_ms=([\d.]+)", pulses)]

    def test_pulses_keep_their_distance_over_a_step_of_the_systems_clock(self):
        with self.watch() as pulses:
            pulses.wait_for("(pulse .*\n){2}")
            time.clock_settime(time.CLOCK_REALTIME, time.time() + 1800.0)
            pulses.wait_for("unreadable=0")
            time.clock_settime(time.CLOCK_REALTIME, time.time() - 1800.0)
        spans = self.after_ms(pulses.read())[1:]
        self.assertGreaterEqual(len(spans), 3, pulses.read())
        # A busy machine delays the timer; a step in a stamp is half an hour.
        self.assertTrue(all(500.0 < ms < 4000.0 for ms in spans), pulses.read())

    def test_a_missing_source_is_reported(self):
        done = starloop("link-check", "--pps", "/sys/class/pps/pps9", status=1)
        self.assertIn("ls /sys/class/pps", done.stderr)


class Flights(OnVcan):
    """The Python flight computer slews the stimulator over the kernel's CAN."""

    def fly(self, *arguments, wire, settings=()):
        # Imported here: python-can is needed for flights only.
        from test_flight import Stimulator, fly

        with Stimulator("socketcan.toml", "link.interface=vcan0", f"link.wire={wire}", *settings) as starloop:
            starloop.wait_for('bench "')
            status, said = fly("--interface", "socketcan", "--channel", "vcan0", *arguments)
            print(said, end="")
            return status, said, starloop.stop()

    def test_a_slew_over_can_fd(self):
        status, said, summary = self.fly("--fd", wire="can_fd")
        self.assertEqual(status, 0, said)
        self.assertIn("session_run 1", summary)

    def test_a_slew_over_classic_can(self):
        status, said, _ = self.fly(wire="can_classic")
        self.assertEqual(status, 0, said)

    def test_a_slew_with_identifiers_of_29_bits(self):
        long = ["link.id_bits=29", "link.id_base=0x18FF0000", "link.node=5"]
        place = ["--id-bits", "29", "--id-base", "0x18FF0000", "--node", "5"]
        for wire, fd in (("can_fd", ["--fd"]), ("can_classic", [])):
            status, said, _ = self.fly(*fd, *place, wire=wire, settings=long)
            self.assertEqual(status, 0, said)
        status, said, _ = self.fly("--fd", "--node", "5", wire="can_fd", settings=long)
        self.assertEqual(status, 1, "control: 11 bits")
        self.assertIn("no answer to HELLO", said)

    def test_a_flight_that_is_not_as_reported_is_seen(self):
        status, said, _ = self.fly("--fd", "--biased-deg", "0.0006", wire="can_fd")
        self.assertEqual(status, 4, said)


def main():
    if not NO_VCAN and not Path("/sys/class/net/vcan0").exists():
        script = str(ROOT / "hil_scripts/tests/uml_vcan.sh")
        os.environ.setdefault("UML_TIMEOUT_S", "1800")
        os.execv(script, [script, sys.executable, str(Path(__file__).resolve()), *sys.argv[1:]])
    unittest.main()


if __name__ == "__main__":
    main()
