"""Everything that runs beside the program in soak.py: readers of its frames, its page, its cable and its bus, and a look at its memory.

Each is a thread with `begin`, `end` and a list of what it found. The node of the bus is a process of its own:

    python3 hil_scripts/measure/soak_clients.py PORT SHARE ARBITRATION_BPS DATA_BPS FILE
"""

import csv
import json
import os
import pty
import subprocess
import sys
import threading
import time
import tty
import urllib.request
import zlib
from pathlib import Path

from page import SYSTEM_PYTHON, fits_of
from starloop.bus_report import classic_s, fd_s
from starloop.wire import CanTransport, Codec, SerialTransport

HERE = Path(__file__).resolve().parent
#: An identifier that no message of starloop has, and that yields to all of them; the content of a background frame.
BACKGROUND_ID, BACKGROUND_BYTES = 0x7F0, 32


class Worker:
    """A thread that calls `step` every `period_s` until it is ended. An exception of a step is kept, and ends it."""

    period_s = 1.0

    def __init__(self):
        self.over, self.error = threading.Event(), None
        self.thread = threading.Thread(target=self._run, name=type(self).__name__, daemon=True)

    def begin(self):
        self.thread.start()
        return self

    def end(self):
        self.over.set()
        self.thread.join(60.0)
        return self

    def _run(self):
        try:
            while not self.over.wait(self.period_s):
                self.step()
        except Exception as error:  # noqa: BLE001 - the report names it
            self.error = f"{type(error).__name__}: {error}"


class Samples(Worker):
    """Memory, threads, descriptors and processor time of a process: rows of (s, RSS bytes, threads, descriptors, CPU s, load)."""

    def __init__(self, pid, period_s):
        super().__init__()
        self.pid, self.period_s, self.rows, self.begun = pid, period_s, [], time.monotonic()

    def step(self):
        folder = Path(f"/proc/{self.pid}")
        try:
            status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line)
            descriptors = len(os.listdir(folder / "fd"))
            ticks = (folder / "stat").read_text().rsplit(")", 1)[1].split()
        except (OSError, KeyError):
            return
        if "VmRSS" not in status:
            return
        cpu_s = (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
        rss = int(status["VmRSS"].split()[0]) * 1024
        self.rows.append((round(time.monotonic() - self.begun, 3), rss, int(status["Threads"]), descriptors, cpu_s, os.getloadavg()[0]))


class RecorderReader(Worker):
    """Reads each recorded frame once, compares its pixels with the CRC-32 of its row, and removes its files."""

    period_s = 0.25

    def __init__(self, folder, keep=False):
        super().__init__()
        self.folder, self.keep, self.frames, self.wrong, self.bytes = Path(folder), keep, {}, [], 0
        self.header, self.place, self.rest = None, 0, ""

    def step(self):
        path = self.folder / "frames.csv"
        if not path.exists():
            return
        with open(path, "rb") as file:
            file.seek(self.place)
            data = file.read()
        self.place += len(data)
        text = data.decode()
        *lines, self.rest = (self.rest + text).split("\n")
        for row in csv.reader(lines):
            if self.header is None:
                self.header = row
            elif row:
                self.take(dict(zip(self.header, row)))

    def take(self, row):
        """Reads the files of a row."""
        number = int(row["frame"])
        image = self.folder / f"frame_{number:06}.fits"
        crc32 = f"{zlib.crc32(fits_of(image)[1].tobytes()):08x}"
        if crc32 != row["pixel_crc32"] or number in self.frames:
            self.wrong.append(number)
        self.frames[number] = row["pixel_crc32"]
        self.bytes += image.stat().st_size
        if not self.keep:
            for ending in ("fits", "truth.csv", "png"):
                (self.folder / f"frame_{number:06}.{ending}").unlink(missing_ok=True)

    def end(self):
        super().end()
        if self.error is None:
            self.step()
        return self


class LiveView(Worker):
    """Looks at the page's state, picture and metrics as a browser does; keeps every event that it shows."""

    period_s = 0.5

    def __init__(self, url):
        super().__init__()
        self.url, self.events, self.asked, self.failed, self.pictures = url.rstrip("/"), {}, 0, 0, set()
        self.paused_until = 0.0

    def step(self):
        if time.monotonic() < self.paused_until:
            return
        self.asked += 1
        state = self.get("/state.json")
        if state is None:
            return
        for event in (json.loads(state).get("run") or {}).get("newest_events", []):
            self.events[event["utc"], event["kind"], event["frame"]] = event
        if self.asked % 4 == 0:
            self.get("/frame.png")
        if self.asked % 20 == 0:
            self.get("/metrics")

    def get(self, path):
        try:
            with urllib.request.urlopen(self.url + path, timeout=10.0) as answer:
                if number := answer.headers.get("starloop-frame"):
                    self.pictures.add(int(number))
                return answer.read()
        except OSError:
            self.failed += 1
            return None


class SerialPlug(Worker):
    """A serial line whose cable comes and goes: a pseudo-terminal under a name, and wheel speeds ten times a second."""

    period_s = 0.1

    def __init__(self, path):
        super().__init__()
        self.path, self.master, self.sent, self.read, self.plugged = Path(path), None, 0, 0, 0
        self.lock, self.packer = threading.Lock(), object.__new__(SerialTransport)
        self.packer.codec, self.packer.sequence, self.packer.line = Codec(), 0, self
        self.plug()

    def plug(self):
        with self.lock:
            self.master, slave = pty.openpty()
            tty.setraw(slave)
            os.set_blocking(self.master, False)
            self.path.unlink(missing_ok=True)
            self.path.symlink_to(os.ttyname(slave))
            self.slave, self.plugged = slave, self.plugged + 1

    def unplug(self):
        with self.lock:
            self.path.unlink(missing_ok=True)
            os.close(self.master)
            os.close(self.slave)
            self.master = None

    def step(self):
        with self.lock:
            if self.master is None:
                return
            try:
                self.read += len(os.read(self.master, 65536))
            except (BlockingIOError, OSError):
                pass
            speeds = {f"Speed{wheel}": 1500.0 + self.sent % 100 for wheel in range(4)}
            self.packer.send("WHEELS", speeds)

    def write(self, data):
        try:
            os.write(self.master, data)
            self.sent += 1
        except (BlockingIOError, OSError):
            pass

    def flush(self):
        pass


class Process:
    """A client in a process of its own that comes and goes; each time with a file of its own. It ends with its standard input."""

    def __init__(self, folder, name, command):
        self.folder, self.name, self.command = Path(folder), name, command
        self.files, self.errors, self.process = [], [], None

    def begin(self):
        path = self.folder / self.name.format(len(self.files))
        self.files.append(path)
        command, log = [*self.command, str(path)], open(path.with_suffix(".log"), "w")
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log, text=True)
        return self

    def stop(self):
        """Lets it end in order; a client that ends with an error has it in `errors`."""
        if self.process is not None:
            try:
                self.process.communicate("", timeout=60.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
            if self.process.wait() != 0:
                said = self.files[-1].with_suffix(".log").read_text().strip().splitlines()
                self.errors.append(said[-1] if said else f"status {self.process.returncode}")
            self.process = None

    def kill(self):
        """Ends it at once: a camera waits for its heartbeat in vain."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


def camera_client(address, folder):
    """A client of the network camera."""
    return Process(folder, "camera_{:03}.csv", [SYSTEM_PYTHON, str(HERE / "soak_camera.py"), address])


def bus_node(port, share, bit_rates, folder):
    """The process that fills the bus and measures its load."""
    words = [str(port), str(share), *map(str, bit_rates)]
    return Process(folder, "bus_{:03}.json", [sys.executable, str(HERE / "soak_clients.py"), *words])


def fill_bus(port, share, bit_rates, path):
    """Adds background frames until the bus is full to a share, and writes the load of each second, until standard input ends."""
    transport = CanTransport("slcan", f"socket://127.0.0.1:{port}", True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    message = transport.can.Message(arbitration_id=BACKGROUND_ID, data=bytes(range(BACKGROUND_BYTES)), is_extended_id=False,
                                    is_fd=True, bitrate_switch=True)  # fmt: skip
    filler = Filler(transport.bus, message, share, bit_rates)
    try:
        while not ended.is_set():
            filler.step()
    except transport.can.CanError as error:  # the run is over
        filler.ended_by = str(error)
    found = {"loads": filler.loads, "sent": filler.sent, "received": filler.received, "ended_by": filler.ended_by}
    Path(path).write_text(json.dumps(found))
    os._exit(0)


class Filler:
    """Background frames at a rate that fills the bus, found again each second from the load of all others."""

    def __init__(self, bus, message, share, bit_rates):
        self.bus, self.message, self.share, self.bit_rates = bus, message, share, bit_rates
        self.own_s, self.rate_hz, self.ended_by = fd_s(BACKGROUND_BYTES, message.is_extended_id, *bit_rates), 0.0, ""
        self.loads, self.sent, self.received = [], 0, 0
        self.begun = self.second = self.last = time.monotonic()
        self.busy_s, self.owed, self.own = 0.0, 0.0, 0

    def step(self):
        received = self.bus.recv(0.005)
        while received is not None:
            size = (len(received.data), received.is_extended_id)
            self.busy_s += fd_s(*size, *self.bit_rates) if received.is_fd else classic_s(*size, self.bit_rates[0])
            self.received += 1
            received = self.bus.recv(0.0)
        now = time.monotonic()
        self.owed = min(self.owed + (now - self.last) * self.rate_hz, 50.0)
        self.last = now
        while self.owed >= 1.0:
            self.bus.send(self.message)
            self.owed, self.own, self.sent = self.owed - 1.0, self.own + 1, self.sent + 1
        if now - self.second >= 1.0:
            self.note(now)

    def note(self, now):
        """Notes a second: when, the share of the others, its own; and sets the rate of the next."""
        others, own = (busy_s / (now - self.second) for busy_s in (self.busy_s, self.own * self.own_s))
        self.loads.append((round(now - self.begun, 2), round(others, 4), round(own, 4)))
        self.rate_hz = max(0.0, (self.share - others) / self.own_s)
        self.second, self.busy_s, self.own = now, 0.0, 0


if __name__ == "__main__":
    fill_bus(int(sys.argv[1]), float(sys.argv[2]), (float(sys.argv[3]), float(sys.argv[4])), sys.argv[5])
