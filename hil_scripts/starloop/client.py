"""Drive a closed-loop run of starloop from Python: a client of its control socket. Standard library only, Python 3.9+.

    from starloop.client import Starloop

    with Starloop.start("target/release/starloop", "configs/scenarios/acquisition.toml", seed=3) as loop:
        loop.step(until_s=10.0)
        loop.inject(do="gyro_dropout", for_s=2.0)
        width, height, pixels, info = loop.frame()
        print(loop.truth()["ra_deg"], loop.estimate()["sigma_rad"])
        loop.step(frames=5)
        print(loop.finish()["passed"])

A simulator outside is the plant of a bench with plant.kind = "outside" (lockstep, src/guide/lockstep.md): it sends attitudes
ahead of the steps, of any instants, and every run repeats bit for bit:

    with Starloop.start("target/release/starloop", "configs/benches/lockstep.toml") as loop:
        loop.attitude([attitude_sample(0.01 * k, (1, 0, 0, 0), (0, 0, 0)) for k in range(30)])
        loop.step(until_s=0.25)
        print(loop.tracker()["valid"], loop.frame_facts()["meta"]["attitude_wxyz"])

Simulated time does not advance between calls. All times are seconds after the first exposure. The protocol, one line of
JSON each way, is described in src/run/wiring/control/protocol.rs. The program answers only a client that knows its token,
which it prints and writes to a file that only the user may read: this client reads that file. Run this file for a
demonstration:

    python3 hil_scripts/starloop/client.py --binary target/release/starloop configs/scenarios/acquisition.toml
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
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Union

try:
    import numpy
except ImportError:  # pixels come as array('H') then
    numpy = None  # type: ignore[assignment, unused-ignore]

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


LINE_BYTES = 60_000
"""Longest line that is sent: the program takes 65,536 bytes."""

Row = Sequence[float]
"""Numbers of one instant; the first is seconds after the first exposure."""


def attitude_sample(
    t_s: float, q_wxyz: Row, rate_rad_s: Row, acceleration_rad_s2: Optional[Row] = None
) -> List[float]:
    """Returns a row for `Starloop.attitude`.

    `q_wxyz` turns ICRF axes into body axes, v_body = q v_icrf q*: the conjugate of what Basilisk, Orekit, ROS and SciPy write.

    >>> attitude_sample(0.5, (1, 0, 0, 0), (0, 0, 0.01))
    [0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01]
    """
    row = [t_s, *q_wxyz, *rate_rad_s, *(acceleration_rad_s2 if acceleration_rad_s2 is not None else ())]
    return [float(number) for number in row]


def wxyz_of_mrp(sigma_bn: Row) -> List[float]:
    """Returns the quaternion of modified Rodrigues parameters as Basilisk writes them (sigma_BN).

    >>> wxyz_of_mrp((0.0, 0.0, 0.0))
    [1.0, 0.0, 0.0, 0.0]
    """
    s2 = sum(part * part for part in sigma_bn)
    return [(1.0 - s2) / (1.0 + s2), *(-2.0 * part / (1.0 + s2) + 0.0 for part in sigma_bn)]


def mrp_of_wxyz(q_wxyz: Row) -> List[float]:
    """Returns the modified Rodrigues parameters (sigma_BN of Basilisk) of a quaternion, of the shorter rotation.

    >>> mrp_of_wxyz((-1.0, 0.0, 0.0, 0.0))
    [0.0, 0.0, 0.0]
    """
    w, *xyz = (float(part) for part in q_wxyz)
    sign = -1.0 if w < 0.0 else 1.0
    return [-sign * part / (1.0 + sign * w) + 0.0 for part in xyz]


class Starloop:
    """One run under control. Make it with `start` or `connect`; it is a context manager that ends the run."""

    def __init__(self, connection: socket.socket, program: Optional[Program] = None, *, token: Optional[str] = None):
        self._connection = connection
        self._lines = connection.makefile("rb")
        self._program = program
        self._id = 0
        self._is_over = False
        self.exit_status: Optional[int] = None
        """Exit status of the program: 0 held, 4 an expectation did not hold; known after `finish`."""
        self.hello: Dict[str, Any] = {}
        """Facts of the run: scenario, seed, zero_utc, duration_s, frames, width, height, heads."""
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
        binary: Union[str, os.PathLike[str]],
        scenario: Union[str, os.PathLike[str]],
        *,
        seed: Optional[int] = None,
        clock: str = "virtual",
        settings: Optional[Dict[str, Any]] = None,
        arguments: Iterable[str] = (),
        timeout_s: float = 60.0,
    ) -> "Starloop":
        """Starts `starloop run SCENARIO` and connects to it.

        `clock` is "virtual", which moves with `step`, or "real", which goes on by itself. `settings` are values to change, such as {"control.delay_ms": 300}; `arguments` go to the command line as they
        are, such as ["--out", "run"].
        """
        command = [os.fspath(binary), "run", os.fspath(scenario), "--clock", clock, "--quiet"]
        command += ["--control", "127.0.0.1:0"]
        if seed is not None:
            command += ["--seed", str(seed)]
        for key, value in (settings or {}).items():
            command += ["--set", f"{key}={toml_value(value)}"]
        program = Program(command + list(arguments), timeout_s)
        try:
            assert program.address is not None, "it listens"
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
        return self._ask(name, "{", keys)

    def _ask(self, name: str, begin: str, keys: Dict[str, Any]) -> Dict[str, Any]:
        """Sends a request whose line begins with `begin`, which has keys that are JSON already."""
        if self._is_over:
            raise StarloopError(f"{name}: the run is over")
        self._id += 1
        line = begin + json.dumps({"id": self._id, "request": name, **keys}, allow_nan=False)[1:]
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
        reply: Dict[str, Any] = json.loads(answer)
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

        Whether the stimulator took it is shown by the events in `summary()`: trigger_taken, trigger_late, trigger_refused.
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("trigger", number=number, **given)

    def event(self, event: Optional[Dict[str, Any]] = None, **keys: Any) -> Dict[str, Any]:
        """The same as `inject`: adds a fault or command, now or at its at_s.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.event(do="frame_blank", at_s=0.5, for_s=0.2)["from_s"]
        0.5
        """
        return self.request("event", event={**(event or {}), **keys})

    def attitude(self, samples: Iterable[Row]) -> Dict[str, Any]:
        """Sends attitudes of a plant outside, of any instants after the run's present: see `attitude_sample`.

        They wait, and reach the run at their own instants: batches of any size give the same frames. A long list goes in
        several requests; a request with a bad or old sample is refused as a whole. Returns taken, waiting and
        attitude_until_s, the instant of the last attitude that waits.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.attitude(attitude_sample(0.01 * k, (1, 0, 0, 0), (0, 0, 0)) for k in range(21))["taken"]
        ...     loop.step(until_s=0.1)["now_s"]
        ...     try:
        ...         _ = loop.attitude([attitude_sample(0.05, (1, 0, 0, 0), (0, 0, 0))])
        ...     except StarloopError as refused:
        ...         "an old attitude is never shown" in str(refused)
        21
        0.1
        True
        """
        return self._send_samples("attitude", samples)

    def observer(self, samples: Iterable[Row], unit: str = "km") -> Dict[str, Any]:
        """Sends states of the observer: rows of t_s, position and velocity in ICRF axes, by `unit` "km" (km/s) or "m" (m/s).

        They are relative to the body that the bench's observer is about. See `attitude` for when they are taken.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.observer([(0.0, 7000.0, 0.0, 0.0, 0.0, 7.5, 0.0)])["waiting"]
        1
        """
        return self._send_samples("observer", samples, unit=unit)

    def jitter(self, samples: Iterable[Row], unit: str = "arcsec") -> Dict[str, Any]:
        """Sends jitter of the line of sight beside the attitude: rows of t_s and a rotation vector about the body axes.

        `unit` is "arcsec" or "rad". See `attitude` for when they are taken.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.jitter([(0.001 * k, 0.2, -0.1, 0.0) for k in range(1000)])["waiting"]
        1000
        """
        return self._send_samples("jitter", samples, unit=unit)

    def _send_samples(self, name: str, samples: Iterable[Row], **keys: Any) -> Dict[str, Any]:
        rows = [json.dumps([float(number) for number in row], allow_nan=False) for row in samples]
        total, first = 0, 0
        taken: Dict[str, Any] = {}
        while first < len(rows) or not taken:
            size, last = 0, first
            while last < len(rows) and (size + len(rows[last]) < LINE_BYTES or last == first):
                size, last = size + len(rows[last]) + 2, last + 1
            taken = self._ask(name, f'{{"samples": [{", ".join(rows[first:last])}], ', keys)
            total, first = total + taken["taken"], last
        return {**taken, "taken": total}

    def tracker(self, head: int = 0) -> Dict[str, Any]:
        """Returns the result of a head's built-in star tracker for the newest frame that it has processed.

        valid, stars, frame and mid_exposure_s; with an attitude also sensor_from_icrf, body_from_icrf, ra_deg, dec_deg,
        roll_deg, residual_rms_px and found_by; else reason.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.tracker()["valid"]
        ...     _ = loop.attitude(attitude_sample(0.01 * k, (1, 0, 0, 0), (0, 0, 0)) for k in range(60))
        ...     _ = loop.step(until_s=0.5)
        ...     seen = loop.tracker()
        ...     seen["valid"], seen["frame"], round(seen["mid_exposure_s"], 6)
        False
        (True, 3, 0.35)
        """
        return self.request("tracker", head=head)

    def camera(self, head: int = 0, at_s: Optional[float] = None, **settings: Any) -> Dict[str, Any]:
        """Sets what the next exposures of a head are taken with: from the first one that starts at or after `at_s`, or now.

        Settings: exposure_us, gain_db, black_level_dn, frame_rate_hz (None: as fast as exposure and readout allow), regions
        (lists of left, top, width, height), trigger_mode, trigger_source, trigger_delay_us, trigger_overlap, burst,
        exposure_mode, exposure_auto, gain_auto. Returns the settings of the next exposure.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     loop.camera(exposure_us=20000, gain_db=6)["next"]["exposure_us"]
        20000.0
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("camera", head=head, **given, **settings)

    def camera_trigger(self, head: int = 0, at_s: Optional[float] = None) -> Dict[str, Any]:
        """Starts an exposure of a camera that waits for triggers (`camera(trigger_mode=True)`), at `at_s`, or now.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     _ = loop.camera(trigger_mode=True)
        ...     loop.camera_trigger(at_s=0.25)["next"]["start_s"]
        0.25
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("camera_trigger", head=head, **given)

    def control(self, by: Optional[str] = None, trackers: Optional[str] = None) -> Dict[str, Any]:
        """Hands the wheels of a spacecraft inside, or the sight of its stars, over to "outside" or back to "inside".

        >>> with Starloop.start(binary, "configs/scenarios/acquisition.toml", settings=small) as loop:
        ...     loop.control(by="outside")["control"]
        'outside'
        """
        given = {"by": by, "trackers": trackers}
        return self.request("control", **{key: value for key, value in given.items() if value is not None})

    def wheels(self, torques_n_m: Row, at_s: Optional[float] = None) -> Dict[str, Any]:
        """Drives the wheels of a spacecraft inside: each motor's torque on its rotor, until the next such request.

        The body feels the opposite. The wheels must be handed over first.

        >>> with Starloop.start(binary, "configs/scenarios/acquisition.toml", settings=small) as loop:
        ...     _ = loop.control(by="outside")
        ...     _ = loop.wheels([0.01, 0.0, 0.0, -0.01])
        ...     _ = loop.step(until_s=0.5)
        ...     len(loop.truth()["wheel_speeds_rad_s"])
        4
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("wheels", torques_n_m=[float(torque) for torque in torques_n_m], **given)

    def torque(self, torque_n_m: Row, for_s: float, at_s: Optional[float] = None) -> Dict[str, Any]:
        """Turns a spacecraft inside by a torque on its body (body axes), now or from `at_s` on, on top of all others.

        >>> with Starloop.start(binary, "configs/scenarios/acquisition.toml", settings=small) as loop:
        ...     _ = loop.torque([0.1, 0.0, 0.0], for_s=0.5)
        ...     loop.step(until_s=0.5)["now_s"]
        0.5
        """
        given = {} if at_s is None else {"at_s": at_s}
        return self.request("torque", torque_n_m=[float(part) for part in torque_n_m], for_s=for_s, **given)

    def tracker_attitude(
        self, at_s: float, body_from_icrf: Row, sigma_arcsec: Union[float, Row]
    ) -> Dict[str, Any]:
        """Gives an attitude of a tracker outside, with the time of its mid-exposure, to the estimator inside.

        It comes beside those of the trackers inside; control(trackers="outside") switches them off.

        >>> with Starloop.start(binary, "configs/scenarios/acquisition.toml", settings=small) as loop:
        ...     _ = loop.control(trackers="outside")
        ...     _ = loop.step(until_s=0.5)
        ...     _ = loop.tracker_attitude(0.45, (1, 0, 0, 0), sigma_arcsec=5.0)
        ...     _ = loop.step(until_s=0.7)
        ...     loop.estimate()["estimate"] is not None
        True
        """
        sigma = sigma_arcsec if isinstance(sigma_arcsec, (int, float)) else [float(part) for part in sigma_arcsec]
        wxyz = [float(part) for part in body_from_icrf]
        return self.request("tracker_attitude", at_s=at_s, body_from_icrf=wxyz, sigma_arcsec=sigma)

    def truth(self, at_s: Optional[float] = None) -> Dict[str, Any]:
        """True attitude, body rate and wheel speeds, now or within the last two seconds; of a plant outside, the attitude by its samples."""
        return self.request("truth") if at_s is None else self.request("truth", at_s=at_s)

    def state(self) -> Dict[str, Any]:
        """Counts of frames and events so far, the time and the mode; on either clock."""
        return self.request("state")

    def estimate(self) -> Dict[str, Any]:
        """Returns the state of the flight computer: attitude, sigma, mode, and the last result of each tracker."""
        return self.request("estimate")

    def frame(self, head: int = 0) -> Frame:
        """The newest frame of a head, with its pixels."""
        info = self.request("frame", head=head)
        return Frame(info["width"], info["height"], pixels_of(info), info)

    def frame_facts(self, head: int = 0) -> Dict[str, Any]:
        """Returns the facts of the newest frame of a head, with the CRC-32 of its pixels and without the pixels.

        >>> with Starloop.start(binary, "configs/benches/lockstep.toml") as loop:
        ...     _ = loop.attitude(attitude_sample(0.01 * k, (1, 0, 0, 0), (0, 0, 0)) for k in range(30))
        ...     _ = loop.step(frames=1)
        ...     facts = loop.frame_facts()
        ...     facts["number"], facts["meta"]["origin"], "pixels_base64_u16_le" in facts
        (0, 'interpolated', False)
        """
        return self.request("frame", head=head, pixels=False)

    def write_frame(self, path: Union[str, os.PathLike[str]], head: int = 0) -> Dict[str, Any]:
        """Lets the program write the newest frame of a head as a new FITS file; `path` is relative to its output folder (`--out`)."""
        return self.request("frame", head=head, path=os.fspath(path))

    def summary(self) -> Dict[str, Any]:
        """The report so far."""
        report: Dict[str, Any] = self.request("summary")["report"]
        return report

    def finish(self) -> Dict[str, Any]:
        """Ends the run once the frames that are drawn have gone out; returns the final report. `exit_status` is known then."""
        reply = self.request("finish")
        self._is_over = True
        self.exit_status = reply["exit_status"]
        self._close()
        report: Dict[str, Any] = reply["report"]
        return report

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


class Program:
    """The program, its output drained so that it never waits for a reader."""

    def __init__(self, command: List[str], timeout_s: float):
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self._tail: collections.deque[str] = collections.deque(maxlen=20)
        self._listening = threading.Event()
        self.address: Optional[tuple[str, int]] = None
        self.token: Optional[str] = None
        self._reader = threading.Thread(target=self._drain, name="starloop stderr", daemon=True)
        self._reader.start()
        if not self._listening.wait(timeout_s) or self.token is None:
            self.end()
            raise ConnectionLost(f"{' '.join(command)} does not listen; it said: {self.said()}")

    def _drain(self) -> None:
        assert self._process.stderr is not None, "it is a pipe"
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
            # Without a client the program would wait for one.
            self._process.wait(60.0 if self.address else 0.1)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(10.0)
        if self._process.stderr is not None:
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
    """Pixels of a frame reply: a numpy array of shape (height, width), or array('H') without numpy."""
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
            reported = f"{seen['stars']} stars, {seen['found_by']}" if "stars" in seen else seen.get("reason", "no frame yet")
            known = estimate["estimate"]
            error = f"{separation_arcsec(truth, known):14.2f}" if known else f"{'unknown':>14}"
            print(
                f"{truth['at_s']:7.2f} {estimate['mode']:>16} {truth['ra_deg']:9.4f} {truth['dec_deg']:+9.4f} {error}"
                f"  {reported}"
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
