"""Tests of host_setup.sh on a made-up machine, and of what a run asks of this one.

python3 hil_scripts/tests/test_host_setup.py
"""

import os
import time
import unittest
from pathlib import Path

from support import BINARY, SCRIPTS, InAFolder, Running, bench_text, folder_for, ran

SCRIPT = SCRIPTS / "packaging/host_setup.sh"
# Output of iproute2 for an adapter that was never set up; afterwards, the words that a set-up adds.
DETAILS = """3: can0: <NOARP,ECHO{up}> mtu {mtu} qdisc pfifo_fast state X mode DEFAULT group default qlen {qlen}
    link/can  promiscuity 0 minmtu 0 maxmtu 0
    can{fd} state ERROR-ACTIVE restart-ms {restart_ms}
          {bitrates}clock 80000000
"""
RAW = {"up": "", "mtu": 16, "qlen": 10, "fd": "", "restart_ms": 0, "bitrates": ""}
SET = {
    "up": ",UP,LOWER_UP",
    "mtu": 72,
    "qlen": 1000,
    "fd": " <FD>",
    "restart_ms": 100,
    "bitrates": "bitrate 500000 sample-point 0.875\n          tq 12 prop-seg 69\n          dbitrate 2000000 dsample-point 0.75\n          ",
}
# Answers as ip does, from a file; notes what it is to set.
IP = """#!/bin/bash
case "$*" in
    "-o link show type can") [[ -s $FAKE/details ]] && echo "3: can0: <NOARP> mtu 16" ;;
    "-o link show type vcan") ;;
    "-details link show can0") cat "$FAKE/details" ;;
    "link set "*) echo "$*" >>"$FAKE/set"; [[ $* == *" up" ]] && cp "$FAKE/after" "$FAKE/details"; true ;;
    *) exit 1 ;;
esac
"""


class HostSetup(unittest.TestCase):
    def setUp(self):
        self.root = folder_for(self)
        self.put("bin/ip", IP).chmod(0o755)
        self.put("details", DETAILS.format(**RAW))
        self.put("after", DETAILS.format(**SET))
        self.rmem = self.put("proc/sys/net/core/rmem_max", "212992\n")
        cpus = "sys/devices/system/cpu"
        self.governors = [self.put(f"{cpus}/cpu{n}/cpufreq/scaling_governor", "powersave\n") for n in range(2)]
        self.ftdi = self.put("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n")
        self.limits = self.root / "etc/security/limits.d/60-starloop.conf"

    def put(self, path, text):
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def run_script(self, *arguments):
        path = f"{self.root / 'bin'}:{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "FAKE": str(self.root), "STARLOOP_HOST_ROOT": str(self.root)}
        return ran(SCRIPT, "--user", "ann", *arguments, env=environment)

    def test_a_look_changes_nothing_and_says_what_would(self):
        before = {file: file.read_bytes() for file in self.root.rglob("*") if file.is_file()}
        done = self.run_script()
        self.assertEqual(done.returncode, 3, done.stdout + done.stderr)
        for reported in [
            "down bitrate  dbitrate  restart-ms 0 txqueuelen 10, wanted up bitrate 500000 dbitrate 2000000",
            "ip link set can0 txqueuelen 1000 type can bitrate 500000 restart-ms 100 dbitrate 2000000 fd on",
            "212992 bytes, wanted 4194304",
            "real-time limits of ann",
            "powersave, wanted performance",
            "16 ms, wanted 1 ms",
            "5 not as wanted",
        ]:
            self.assertIn(reported, done.stdout)
        after = {file: file.read_bytes() for file in self.root.rglob("*") if file.is_file()}
        self.assertEqual(before, after)

    def test_applied_once_all_is_as_wanted(self):
        done = self.run_script("--apply")
        self.assertEqual((done.returncode, done.stderr), (0, ""), done.stdout)
        sets = (self.root / "set").read_text().splitlines()
        settings = "type can bitrate 500000 restart-ms 100 dbitrate 2000000 fd on"
        self.assertEqual(sets, ["link set can0 down", f"link set can0 txqueuelen 1000 {settings}", "link set can0 up"])
        self.assertEqual(self.rmem.read_text(), "4194304\n")
        self.assertIn("rmem_max = 4194304", (self.root / "etc/sysctl.d/60-starloop.conf").read_text())
        self.assertEqual(self.limits.read_text(), "ann - rtprio 50\nann - memlock unlimited\n")
        self.assertEqual({file.read_text() for file in self.governors}, {"performance\n"})
        self.assertEqual(self.ftdi.read_text(), "1\n")
        again = self.run_script("--check")
        self.assertEqual(again.returncode, 0, again.stdout)
        self.assertIn("all as wanted", again.stdout)

    def test_a_user_of_another_name_and_classic_can_are_seen(self):
        self.run_script("--apply")
        self.assertIn("differs", self.run_script("--user", "bob").stdout)
        done = self.run_script("--dbitrate", "0")
        self.assertIn("dbitrate 2000000", done.stdout)
        self.assertIn("fd off", done.stdout)

    def test_an_absent_interface_cannot_be_set(self):
        done = self.run_script("--apply", "--can", "can7")
        self.assertEqual(done.returncode, 3, done.stdout)
        self.assertIn("FAILED  CAN interface can7", done.stdout)

    def test_wrong_command_lines_are_refused(self):
        for arguments, said in [(["--bitrate", "fast"], "fast"), (["--bitrate"], "wants a value"), (["--now"], "--now")]:
            done = self.run_script(*arguments)
            self.assertEqual(done.returncode, 2, done.stdout)
            self.assertIn(said, done.stderr)
        self.assertIn("--restart-ms", self.run_script("--help").stdout)


class DrawingThreads(InAFolder):
    def threads(self, clock, processors):
        """Returns scheduler and processors of the frame thread and of those that draw with it, and what the run was refused."""
        bench = self.written("bench.toml", bench_text("threads") + f"[budget]\naffinity = {processors}\n")
        words = ["run", str(bench), "--backend", "cpu", "--sink", "null", "--duration", "600", "--clock", clock]
        with Running(BINARY, *words, cwd=self.folder) as program:
            tasks = Path(f"/proc/{program.process.pid}/task")
            is_drawing = lambda task: (task / "comm").read_text().startswith("draw ")
            program.wait_for("^bench ")
            frame_thread = program.process.pid
            ends = time.monotonic() + 5.0
            while clock == "real" and os.sched_getaffinity(frame_thread) != set(processors) and time.monotonic() < ends:
                time.sleep(0.01)  # it enters last
            threads = [frame_thread, *(int(task.name) for task in tasks.iterdir() if is_drawing(task))]
            found = [(os.sched_getscheduler(thread), os.sched_getaffinity(thread)) for thread in threads]
        return found, "".join(program.said)

    def test_they_have_the_priority_and_the_processors_of_the_bench(self):
        processors = sorted(os.sched_getaffinity(0))[:2]
        found, said = self.threads("real", processors)
        self.assertEqual(len(found), len(processors), f"one for each processor, with the frame thread: {said}")
        for policy, allowed in found:
            self.assertEqual(allowed, set(processors))
        for policy, _ in found[1:]:
            if "drawing threads: first-in-first-out" not in said:
                self.assertEqual(policy, os.SCHED_FIFO)
        self.assertNotIn("already been initialized", said)

    def test_one_processor_needs_no_thread_beside_the_frame_thread(self):
        first = min(os.sched_getaffinity(0))
        found, said = self.threads("real", [first])
        self.assertEqual(len(found), 1, said)
        self.assertEqual(found[0][1], {first})

    def test_simulated_time_needs_neither(self):
        found, _ = self.threads("virtual", [0])
        self.assertEqual(len(found), 1, "control: threads without a name of their own")
        self.assertEqual(found[0][1], os.sched_getaffinity(0))


if __name__ == "__main__":
    unittest.main()
