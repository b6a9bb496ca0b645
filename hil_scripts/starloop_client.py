"""Drive a closed-loop run of starloop from Python: a client of its control socket. Standard library only, Python 3.9+.

    from starloop_client import Starloop

    with Starloop.start("target/release/starloop", "configs/scenarios/acquisition.toml", seed=3) as loop:
        loop.step(until_s=10.0)
        loop.inject(do="gyro_dropout", for_s=2.0)
        width, height, pixels, info = loop.frame()
        print(loop.truth()["ra_deg"], loop.estimate()["sigma_rad"])
        loop.step(frames=5)
        print(loop.finish()["passed"])

Simulated time does not advance between calls. All times are seconds after the first exposure. The protocol, one line of
JSON each way, is described in src/run/wiring/control/protocol.rs. The program answers only a client that knows its token,
which it prints and writes to a file that only the user may read: this client reads that file. Run this file for a
demonstration:

    python3 hil_scripts/starloop_client.py --binary target/release/starloop configs/scenarios/acquisition.toml
"""

from __future__ import annotations

import argparse
import array
import base64
import collections
import json
import os
import re
import socket
import subprocess
import sys
import threading
from typing import Any, Dict, Iterable, NamedTuple, Optional, Union

try:
    import numpy
except ImportError:  # pixels come as array('H') then
    numpy = None

PROTOCOL = 2
"""Version of the protocol that this client speaks."""

LISTENING = re.compile(r"^control: listening on (?P<host>.*):(?P<port>\d+)\s*$")
TOKEN = re.compile(r"^control: token (?P<token>[0-9a-f]+), also in ")


class StarloopError(Exception):
    """A request that was refused, with the words of the program; the session goes on."""


class ConnectionLost(StarloopError):
    """The program went away or never came; with what it last said."""


class Frame(NamedTuple):
    """A frame as it went out."""

    width: int
    height: int
    pixels: Any
    """DN row by row from the top: a numpy array of shape (height, width), or array('H') without numpy."""
    info: Dict[str, Any]
    """Number, mid_exposure_s, faults, crc32, and all that is known about the frame under "meta"."""


class Starloop:
    """One run under control. Make it with `start` or `connect`; it is a context manager that ends the run."""

    def __init__(self, connection: socket.socket, program: Optional[_Program] = None, *, token: Optional[str] = None):
        self._connection = connection
        self._lines = connection.makefile("rb")
        self._program = program
        self._id = 0
        self._is_over = False
        self.exit_status: Optional[int] = None
        """Exit status of the program: 0 held, 4 an expectation did not hold; known after `finish`."""
        self.hello: Dict[str, Any] = {}
        """What is run: scenario, seed, zero_utc, duration_s, frames, width, height, heads."""
        try:
            self.hello = self.request("hello", token=token or token_of(connection))
            if self.hello["protocol"] != PROTOCOL:
                raise StarloopError(f"the program speaks protocol {self.hello['protocol']}, this client {PROTOCOL}")
        except BaseException:
            self.close()
            raise

    @classmethod
    def start(
        cls,
        binary: Union[str, os.PathLike],
        scenario: Union[str, os.PathLike],
        *,
        seed: Optional[int] = None,
        settings: Optional[Dict[str, Any]] = None,
        arguments: Iterable[str] = (),
        timeout_s: float = 60.0,
    ) -> "Starloop":
        """Starts `starloop run SCENARIO` and connects to it.

        `settings` are values to change, such as {"control.delay_ms": 300}; `arguments` go to the command line as they
        are, such as ["--out", "run"].
        """
        command = [os.fspath(binary), "run", os.fspath(scenario), "--clock", "virtual", "--quiet"]
        command += ["--control", "127.0.0.1:0"]
        if seed is not None:
            command += ["--seed", str(seed)]
        for key, value in (settings or {}).items():
            command += ["--set", f"{key}={toml_value(value)}"]
        program = _Program(command + list(arguments), timeout_s)
        try:
            connection = socket.create_connection(program.address, timeout=timeout_s)
        except BaseException:
            program.end()
            raise
        return cls(connection, program, token=program.token)

    @classmethod
    def connect(cls, host: str, port: int, timeout_s: float = 60.0, *, token: Optional[str] = None) -> "Starloop":
        """Connects to a program that was started with `--control`.

        Without `token`, the one in the file that the program has written is taken.
        """
        return cls(socket.create_connection((host, port), timeout=timeout_s), token=token)

    def request(self, name: str, **keys: Any) -> Dict[str, Any]:
        """Sends one request and returns its reply without "ok" and "id". Raises StarloopError when it is refused."""
        if self._is_over:
            raise StarloopError(f"{name}: the run is over")
        self._id += 1
        line = json.dumps({"id": self._id, "request": name, **keys}, allow_nan=False)
        # A step takes as long as it takes: only sending and connecting have a time limit.
        try:
            self._connection.settimeout(60.0)
            self._connection.sendall(line.encode() + b"\n")
            self._connection.settimeout(None)
            answer = self._lines.readline()
        except OSError as error:
            raise self._lost(f"{name}: {error}") from error
        if not answer.endswith(b"\n"):
            raise self._lost(f"{name}: the connection ended")
        reply = json.loads(answer)
        if reply.pop("id", None) != self._id:
            raise StarloopError(f"{name}: a reply to something else: {answer[:200]!r}")
        if not reply.pop("ok"):
            raise StarloopError(f"{name}: {reply['error']}")
        return reply

    def step(
        self, s: Optional[float] = None, *, frames: Optional[int] = None, until_s: Optional[float] = None
    ) -> Dict[str, Any]:
        """Advances simulated time by `s` seconds, by so many `frames` of the first head, or to `until_s`.

        Returns now_s, frames_out (in this step), frames_delivered (in all), mode and finished.
        """
        given = {"s": s, "frames": frames, "until_s": until_s}
        return self.request("step", **{key: value for key, value in given.items() if value is not None})

    def inject(self, event: Optional[Dict[str, Any]] = None, **keys: Any) -> Dict[str, Any]:
        """Adds a fault or command: the keys of [[event]] in a scenario file. Without at_s it begins now."""
        return self.request("inject", event={**(event or {}), **keys})

    def trigger(self, number: int, at_s: Optional[float] = None) -> Dict[str, Any]:
        """Lets the flight computer fire a numbered trigger over the bus, to act at `at_s`, or at once.

        Whether the stimulator took it is told by the events in `summary()`: trigger_taken, trigger_late, trigger_refused.
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("trigger", number=number, **given)

    def truth(self, at_s: Optional[float] = None) -> Dict[str, Any]:
        """True attitude, body rate and wheel speeds, now or within the last two seconds."""
        return self.request("truth") if at_s is None else self.request("truth", at_s=at_s)

    def state(self) -> Dict[str, Any]:
        """Counts of frames and events so far, the time and the mode; on either clock."""
        return self.request("state")

    def estimate(self) -> Dict[str, Any]:
        """What the flight computer thinks: attitude, sigma, mode, and what each tracker said last."""
        return self.request("estimate")

    def frame(self, head: int = 0) -> Frame:
        """The newest frame of a head, with its pixels."""
        info = self.request("frame", head=head)
        return Frame(info["width"], info["height"], pixels_of(info), info)

    def write_frame(self, path: Union[str, os.PathLike], head: int = 0) -> Dict[str, Any]:
        """Lets the program write the newest frame of a head as a new FITS file; `path` is relative to its output folder (`--out`)."""
        return self.request("frame", head=head, path=os.fspath(path))

    def summary(self) -> Dict[str, Any]:
        """The report so far."""
        return self.request("summary")["report"]

    def finish(self) -> Dict[str, Any]:
        """Ends the run where it stands and returns the final report; `exit_status` is known then."""
        reply = self.request("finish")
        self._is_over = True
        self.exit_status = reply["exit_status"]
        self._close()
        return reply["report"]

    def close(self) -> None:
        """Goes away. A run that was not finished ends with what was finished by then."""
        self._is_over = True
        self._close()

    def __enter__(self) -> "Starloop":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _close(self) -> None:
        self._lines.close()
        self._connection.close()
        if self._program:
            status = self._program.end()
            self.exit_status = status if self.exit_status is None else self.exit_status

    def _lost(self, what: str) -> ConnectionLost:
        self._is_over = True
        self._close()
        said = self._program.said() if self._program else ""
        return ConnectionLost(f"{what}{'; the program said: ' + said if said else ''}")


class _Program:
    """The program, its output drained so that it never waits for a reader."""

    def __init__(self, command: list, timeout_s: float):
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self._tail: collections.deque = collections.deque(maxlen=20)
        self._listening = threading.Event()
        self.address: Optional[tuple] = None
        self.token: Optional[str] = None
        self._reader = threading.Thread(target=self._drain, name="starloop stderr", daemon=True)
        self._reader.start()
        if not self._listening.wait(timeout_s) or self.token is None:
            self.end()
            raise ConnectionLost(f"{' '.join(command)} does not listen; it said: {self.said()}")

    def _drain(self) -> None:
        for line in self._process.stderr:
            if self.address is None and (found := LISTENING.match(line)):
                self.address = (found["host"].strip("[]"), int(found["port"]))
            elif self.token is None and (found := TOKEN.match(line)):
                self.token = found["token"]
                self._listening.set()
            else:
                self._tail.append(line.rstrip())
        self._listening.set()

    def said(self) -> str:
        """The last lines on standard error."""
        return "; ".join(self._tail)

    def end(self) -> int:
        """Waits for the program, which ends when its client is gone; stops it when it does not."""
        try:
            # One that never had a client would wait for it.
            self._process.wait(60.0 if self.address else 0.1)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(10.0)
        self._process.stderr.close()
        return self._process.returncode


def token_of(connection: socket.socket) -> str:
    """The token of the program at the other end, from the file that it has written for its user."""
    host, port = connection.getpeername()[:2]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    own = os.path.join(os.environ.get("TMPDIR") or "/tmp", f"starloop-{os.getuid()}")
    folder = os.path.join(runtime, "starloop") if os.path.isabs(runtime) else own
    path = os.path.join(folder, f"control-{host.replace(':', '_')}_{port}.token")
    try:
        with open(path, encoding="ascii") as file:
            return file.read().strip()
    except OSError as error:
        raise StarloopError(f"no token of {host}:{port}: {error}; give the one that the program has printed as token=") from error


def pixels_of(reply: Dict[str, Any]) -> Any:
    """Pixels of a frame reply: a numpy array of shape (height, width), or array('H') when there is no numpy."""
    data = base64.b64decode(reply["pixels_base64_u16_le"], validate=True)
    if len(data) != 2 * reply["width"] * reply["height"]:
        raise StarloopError(f"{len(data)} bytes of pixels for {reply['width']} x {reply['height']}")
    if numpy is not None:
        return numpy.frombuffer(data, dtype="<u2").reshape(reply["height"], reply["width"])
    pixels = array.array("H", data)
    if sys.byteorder == "big":
        pixels.byteswap()
    return pixels


def toml_value(value: Any) -> str:
    """A Python value as TOML, for `--set`: strings are quoted, lists and tables go inline."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value, allow_nan=False)


def demonstrate() -> None:
    """Steps a scenario, blanks its frames for a while, and prints what the flight computer makes of it."""
    parser = argparse.ArgumentParser(description=demonstrate.__doc__)
    parser.add_argument("scenario", help="scenario file")
    parser.add_argument("--binary", default="target/release/starloop", help="the program")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args()
    with Starloop.start(given.binary, given.scenario, seed=given.seed) as loop:
        print(f"{loop.hello['scenario']}: {loop.hello['camera']}, {loop.hello['duration_s']} s, seed {given.seed}")
        print(f"{'t, s':>7} {'mode':>16} {'RA, deg':>9} {'Dec, deg':>9} {'error, arcsec':>14}  tracker")
        for number in range(given.steps):
            if number == given.steps // 2:
                print(f"{'':7} -- frames blank for 3 s from here on")
                loop.inject(do="frame_blank", for_s=3.0)
            if loop.step(0.5)["finished"]:
                break
            estimate = loop.estimate()
            truth = loop.truth(estimate["at_s"])
            seen = estimate["heads"][0]
            told = f"{seen['stars']} stars, {seen['found_by']}" if "stars" in seen else seen.get("reason", "no frame yet")
            known = estimate["estimate"]
            error = f"{separation_arcsec(truth, known):14.2f}" if known else f"{'unknown':>14}"
            print(
                f"{truth['at_s']:7.2f} {estimate['mode']:>16} {truth['ra_deg']:9.4f} {truth['dec_deg']:+9.4f} {error}"
                f"  {told}"
            )
        report = loop.finish()
        for fault in report["faults"]:
            print(f"fault {fault['name']} from {fault['from_s']} s to {fault['until_s']} s: {fault['hits']} hit")


def separation_arcsec(one: Dict[str, Any], other: Dict[str, Any]) -> float:
    """Angle between two attitudes by their quaternions, arcsec."""
    from math import asin, degrees, sqrt

    a, b = one["sensor_from_icrf"], other["sensor_from_icrf"]
    nearest = min(sum((x - sign * y) ** 2 for x, y in zip(a, b)) for sign in (1, -1))
    return degrees(4.0 * asin(min(1.0, 0.5 * sqrt(nearest)))) * 3600.0


if __name__ == "__main__":
    demonstrate()
