"""Flies the real hour of soak.py: from soak_flight import fly

Everything that is found is written into a folder, so that `soak_account` can judge it later, and again.
"""

import json
import os
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path

from running import PATIENCE_S, Running
from soak_bench import BIT_RATES, REAL_SINKS, bench_text, fault_schedule, outside_schedule
from soak_clients import LiveView, RecorderReader, Samples, SerialPlug, bus_node, camera_client
from starloop.client import Starloop, StarloopError

#: Share of the bus that is taken.
BUS_SHARE = 0.9
#: Seconds from one look at the process to the next.
SAMPLE_S = 10.0
PATTERNS = {
    "control": r"control: listening on 127\.0\.0\.1:(\d+)",
    "token": r"control: token (\S+?),? ",
    "monitor": r"live view: (\S+)",
    "gateway": r"gateway: slcan \(TCP\) at 127\.0\.0\.1:(\d+)",
}
"""Addresses as the program prints them."""


def camera_address():
    """Returns an address of this run: several runs on one machine do not meet."""
    return f"127.{1 + os.getpid() // 250 % 250}.{1 + os.getpid() % 250}.1"


def command_of(binary, folder, bench):
    return [str(binary), "run", str(bench), "--clock", "real", "--json", "--out", str(folder / "run"), "--report",
            str(folder / "timing"), "--monitor", "0", "--control", "127.0.0.1:0"]  # fmt: skip


class Outside:
    """Carries out what happens to the program from outside; `done` lists it with the seconds of the run."""

    def __init__(self, program, camera, bus, serial, view):
        self.program, self.camera, self.bus, self.serial, self.view = program, camera, bus, serial, view
        self.done, self.threads = [], []

    def begin(self, at_s, word, for_s):
        self.done.append((at_s, word, for_s))
        thread = threading.Thread(target=getattr(self, word), args=(for_s,), daemon=True)
        self.threads = [one for one in self.threads if one.is_alive()] + [thread]
        thread.start()

    def join(self):
        for thread in self.threads:
            thread.join(PATIENCE_S)

    def serial_unplugged(self, for_s):
        self.serial.unplug()
        time.sleep(for_s)
        self.serial.plug()

    def bus_node_reconnects(self, for_s):
        self.bus.stop()
        time.sleep(for_s)
        self.bus.begin()

    def camera_client_stops(self, for_s):
        self.restart_camera(self.camera.stop, for_s)

    def camera_client_killed(self, for_s):
        self.restart_camera(self.camera.kill, for_s)

    def restart_camera(self, ending, for_s):
        if self.camera.process is not None:
            ending()
            time.sleep(for_s)
            self.camera.begin()

    def monitor_pauses(self, for_s):
        self.view.paused_until = time.monotonic() + for_s

    def program_paused(self, for_s):
        os.kill(self.program.process.pid, signal.SIGSTOP)
        time.sleep(for_s)
        os.kill(self.program.process.pid, signal.SIGCONT)


def steer(control, injected, outside, planned, say):
    """Injects faults and disturbs the program at their times, until the run is over; returns the injected events."""
    taken, refused, said_s = [], [], 0.0
    injected, planned = list(injected), list(planned)
    while True:
        try:
            state = control.state()
        except StarloopError as error:
            # After the last frame the run has ended, and soon the connection ends.
            if "the run is over" in str(error) or "the connection ended" in str(error):
                return taken, refused
            raise
        now_s = state["now_s"]
        if state["finished"]:
            return taken, refused
        while injected and injected[0]["at_s"] <= now_s:
            event = {key: value for key, value in injected.pop(0).items() if key != "at_s"}
            try:
                taken.append({**control.inject(event), "do": event["do"]})
            except StarloopError as error:
                refused.append({**event, "error": str(error)})
        while planned and planned[0][0] <= now_s:
            outside.begin(*planned.pop(0))
        if now_s - said_s > 60.0:
            said_s = now_s
            say(f"{now_s:.0f} s: frames {state['frames']}, events {sum(state['events'].values())}")
        time.sleep(0.1)


def fly(binary, folder, seconds, seed, say=print):
    """Flies a run of so many seconds and leaves in `folder` what it and its clients found."""
    folder = Path(folder).absolute()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    events, injected = fault_schedule(seed, seconds)
    planned, address = outside_schedule(seed, seconds), camera_address()
    serial = SerialPlug(folder / "serial")
    bench = folder / "bench.toml"
    bench.write_text(bench_text(seed, seconds, events, sinks=REAL_SINKS.format(address=address), serial_port=serial.path))
    begun = time.time()
    program = Running(*command_of(binary, folder, bench), stdin=subprocess.DEVNULL)
    samples = Samples(program.process.pid, min(SAMPLE_S, seconds / 20.0)).begin()
    try:
        address_of = {name: program.wait_for(pattern)[1] for name, pattern in PATTERNS.items()}
        recorder = RecorderReader(folder / "run").begin()
        view, camera = LiveView(address_of["monitor"]).begin(), camera_client(address, folder).begin()
        bus = bus_node(address_of["gateway"], BUS_SHARE, BIT_RATES, folder).begin()
        outside = Outside(program, camera, bus, serial.begin(), view)
        control = Starloop.connect("127.0.0.1", int(address_of["control"]), token=address_of["token"])
        taken, refused = steer(control, injected, outside, planned, say)
        view.end()
        outside.join()
        camera.stop()
        bus.stop()
        control.close()
        status = program.process.wait(PATIENCE_S)
    finally:
        program.__exit__()
        (folder / "report.json").write_text("".join(program.printed))
        (folder / "log.txt").write_text("".join(program.said))
    for worker in (samples, recorder, view, serial):
        worker.end()
    found = {
        "seconds": seconds, "seed": seed, "begun_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(begun)),
        "wall_s": time.time() - begun, "exit_status": status,
        "samples": samples.rows, "planned_events": events, "injected": taken, "injected_refused": refused,
        "outside": outside.done, "monitor": {"asked": view.asked, "failed": view.failed, "pictures": len(view.pictures),
                                             "events": list(view.events.values())},
        "recorder": {"frames": sorted(recorder.frames.items()), "wrong": recorder.wrong, "bytes": recorder.bytes},
        "camera": {"files": [path.name for path in camera.files], "errors": camera.errors},
        "bus": {"files": [path.name for path in bus.files]},
        "serial": {"plugged": serial.plugged, "sent": serial.sent, "read": serial.read},
        "worker_errors": {type(worker).__name__: worker.error for worker in (samples, recorder, view, serial) if worker.error},
    }  # fmt: skip
    (folder / "found.json").write_text(json.dumps(found))
    return folder
