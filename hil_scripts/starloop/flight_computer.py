#!/usr/bin/env python3
"""A flight computer in Python: slews the stimulator, and compares what it echoes with the commands.

  hil_scripts/starloop/flight_computer.py --interface slcan --channel socket://127.0.0.1:PORT --fd
  hil_scripts/starloop/flight_computer.py --interface socketcand --host 127.0.0.1 --port PORT --channel can0
  hil_scripts/starloop/flight_computer.py --interface socketcan --channel vcan0 --fd
  hil_scripts/starloop/flight_computer.py --serial /dev/ttyUSB0 --baud 921600

It shakes hands (HELLO, INFO, RUN), sends time marks and attitude, turns by --slew-deg from rest to rest, and reads
EXPOSURE and STATUS back: for each frame the right ascension, declination and roll that were rendered are compared with
its own attitude at the exposure time that EXPOSURE gives. Exit status: 0 when every frame is within --limit-arcsec, 4 when
one is not or too few came, 1 when the stimulator cannot be reached or refuses a command (a trigger that no fault or event
of the run waits for, for example).
"""
from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

if not __package__:  # called by its path
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from starloop.wire import CanTransport, SerialTransport, add_can_arguments, can_transport

Vector = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]
Rows = Tuple[Vector, Vector, Vector]

ARCSEC = math.radians(1 / 3600)
US = 1_000_000
RETRY_S = 0.5


# --- attitude: Hamilton quaternions, scalar first, passive: v_body = q v_icrf conj(q) ---


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product of two quaternions."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def matrix(q: Quaternion) -> Rows:
    """Rows: the body's axes in ICRF."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def matrix_quaternion(rows: Rows) -> Quaternion:
    """The quaternion of such rows, from whichever component is largest."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    candidates = [
        (1 + a + e + i, (1 + a + e + i, h - f, c - g, d - b)),
        (1 + a - e - i, (h - f, 1 + a - e - i, b + d, c + g)),
        (1 - a + e - i, (c - g, b + d, 1 - a + e - i, f + h)),
        (1 - a - e + i, (d - b, c + g, f + h, 1 - a - e + i)),
    ]
    _, q = max(candidates)
    norm = math.sqrt(sum(part * part for part in q))
    w, x, y, z = (part / norm for part in q)
    return w, x, y, z


def pointed(ra: float, dec: float, roll: float) -> Quaternion:
    """Body +Z at (ra, dec); -Y (image up) at position angle `roll`, east of north."""
    direction = (math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec))
    north = (-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec))
    east = (-math.sin(ra), math.cos(ra), 0.0)
    up = tuple(math.cos(roll) * n + math.sin(roll) * e for n, e in zip(north, east))
    y = (-up[0], -up[1], -up[2])
    x = (
        y[1] * direction[2] - y[2] * direction[1],
        y[2] * direction[0] - y[0] * direction[2],
        y[0] * direction[1] - y[1] * direction[0],
    )
    return matrix_quaternion((x, y, direction))


def pointing(q: Quaternion) -> Vector:
    """Right ascension, declination and roll of an attitude, rad."""
    _, y, z = matrix(q)
    ra, dec = math.atan2(z[1], z[0]), math.asin(max(-1.0, min(1.0, z[2])))
    north = (-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec))
    east = (-math.sin(ra), math.cos(ra), 0.0)
    up = tuple(-c for c in y)
    return ra, dec, math.atan2(sum(a * b for a, b in zip(up, east)), sum(a * b for a, b in zip(up, north)))


def wrapped_arcsec(angle: float) -> float:
    """The size of an angle, at most half a turn."""
    return abs(math.atan2(math.sin(angle), math.cos(angle))) / ARCSEC


class Slew:
    """From rest to rest about one body axis; the rate is (1 - cos) / 2 of time."""

    def __init__(self, initial: Quaternion, axis: Vector, angle: float, start_s: float, duration_s: float):
        norm = math.sqrt(sum(c * c for c in axis))
        self.initial, self.axis = initial, (axis[0] / norm, axis[1] / norm, axis[2] / norm)
        self.angle, self.start_s, self.duration_s = angle, start_s, duration_s

    def at(self, t_s: float) -> Tuple[Quaternion, Vector, Vector]:
        """Attitude, rate and acceleration (rad/s, rad/s^2, body axes) at `t_s` of the flight computer's clock."""
        u = min(max((t_s - self.start_s) / self.duration_s, 0.0), 1.0)
        turned = self.angle * (u - math.sin(2 * math.pi * u) / (2 * math.pi))
        rate = self.angle / self.duration_s * (1 - math.cos(2 * math.pi * u))
        acceleration = self.angle / self.duration_s**2 * 2 * math.pi * math.sin(2 * math.pi * u)
        # Body axes that turn by +w see the attitude multiplied by exp(-w t / 2) from the left.
        x, y, z = self.axis
        half = -math.sin(turned / 2)
        return (
            product((math.cos(turned / 2), half * x, half * y, half * z), self.initial),
            (rate * x, rate * y, rate * z),
            (acceleration * x, acceleration * y, acceleration * z),
        )


# --- the flight computer ---


# Settings of CAMERA, by the names that --camera takes.
CAMERA_KINDS = {
    "exposure": 1, "gain": 2, "black_level": 3, "frame_period": 4, "triggered": 5, "trigger_delay": 6, "trigger_overlap": 7,
    "burst": 8, "exposure_mode": 9, "auto_exposure": 10, "auto_gain": 11, "report": 12,
}
# Values of each page of CAMERA_STATUS.
CAMERA_PAGES = {0: ("StartedBy", "ExposureTime"), 1: ("Gain", "BlackLevel"), 2: ("TriggerDelay",)}


class Refused(Exception):
    """The stimulator refused a command; the text has the reason."""


class FlightComputer:
    """Sends what is due, and remembers what comes back."""

    def __init__(self, transport: Union[CanTransport, SerialTransport], slew: Slew, attitude_hz: float):
        self.transport, self.slew, self.attitude_hz = transport, slew, attitude_hz
        self.boot_ns = time.monotonic_ns()
        self.due_s = {"sync": 0.0, "attitude": 0.0, "heartbeat": 0.0}
        self.counter = self.sequence = self.token = 0
        self.frames: Dict[int, Dict[str, Any]] = {}
        self.exposures: Dict[int, Tuple[int, int]] = {}
        self.answers: Dict[int, Dict[str, Any]] = {}
        self.clock_page: Optional[Dict[str, Any]] = None
        self.mode: Optional[int] = None
        # Values of CAMERA_STATUS of each frame, by the whole number of the frame that the sender keeps modulo 256.
        self.camera_frames: Dict[int, Dict[str, Any]] = {}
        self.camera_frame: Optional[int] = None
        # A frame drawn from an older attitude is a prediction, and says so: it is counted, not compared.
        self.oldest_us, self.predicted_far = 100_000, 0

    def now_s(self) -> float:
        """This computer's clock, s."""
        return (time.monotonic_ns() - self.boot_ns) * 1e-9

    def fly(self, until_s: float) -> None:
        """Does what is due, and listens in between, until `until_s`."""
        while (now_s := self.now_s()) < until_s:
            if now_s >= self.due_s["sync"]:
                self.due_s["sync"] += 0.1
                self.mark_time()
            if now_s >= self.due_s["attitude"]:
                # A late attitude is sent with the time it is for; those missed meanwhile are left out.
                self.due_s["attitude"] = max(self.due_s["attitude"] + 1 / self.attitude_hz, now_s)
                self.send_attitude()
            if now_s >= self.due_s["heartbeat"]:
                self.due_s["heartbeat"] += 1.0
                self.transport.send("HEARTBEAT", {"State": 2, "Major": 1})
            wait_s = min(min(self.due_s.values()), until_s) - self.now_s()
            if received := self.transport.receive(max(wait_s, 0.0)):
                self.take_in(*received)

    def mark_time(self) -> None:
        """SYNC, and when it left. Without a report from the controller that is known as "not before it was handed over": a
        time that is early by a delay, as every mark's is, and never late, which the estimate of the clock could not bear."""
        before_ns = time.monotonic_ns()
        self.transport.send("SYNC", {"Counter": self.counter})
        seconds, rest_ns = divmod(before_ns - self.boot_ns, 10**9)
        fraction = (rest_ns << 24) // 10**9
        mark = {"Seconds": seconds, "Fraction": fraction * 2.0**-24, "Counter": self.counter}
        self.transport.send("TIME_FUP", mark)
        self.counter = (self.counter + 1) & 0xFF

    def send_attitude(self) -> None:
        """Sends the attitude of this instant, with rate and acceleration."""
        t_us = (time.monotonic_ns() - self.boot_ns) // 1000
        q, rate, acceleration = self.slew.at(t_us / US)
        self.transport.send(
            "ATT_FD",
            {
                "TimeTag": t_us % 2**32,
                "Seq": self.sequence,
                "RateValid": 1,
                "AccelerationValid": 1,
                **dict(zip(("Qw", "Qx", "Qy", "Qz"), q)),
                **dict(zip(("RateX", "RateY", "RateZ"), rate)),
                **dict(zip(("AccelerationX", "AccelerationY", "AccelerationZ"), acceleration)),
            },
        )
        self.sequence = (self.sequence + 1) & 0xFF

    def take_in(self, name: str, fields: Dict[str, Any]) -> None:
        """Keeps what a message of the stimulator says."""
        if name == "RSP":
            self.answers[fields["Token"]] = fields
        elif name == "EXPOSURE":
            # The frame's number has 8 bits: the newest is meant.
            self.exposures[fields["Frame"]] = (len(self.frames), fields["MidExposure"])
            self.frames[len(self.frames)] = {"mid_us": fields["MidExposure"], "age_us": fields["Age"]}
        elif name == "STATUS":
            self.receive_status(fields)
        elif name == "CAMERA_STATUS" and fields["Head"] == 0:
            self.receive_camera(fields)

    def receive_camera(self, fields: Dict[str, Any]) -> None:
        """Collects the pages of a frame of the first head."""
        if fields["Page"] not in CAMERA_PAGES:
            return
        last = self.camera_frame if self.camera_frame is not None else fields["Frame"]
        self.camera_frame = last + (fields["Frame"] - last + 128) % 256 - 128
        reported = self.camera_frames.setdefault(self.camera_frame, {})
        reported.update({name: fields[name] for name in CAMERA_PAGES[fields["Page"]]})

    def receive_status(self, fields: Dict[str, Any]) -> None:
        """Keeps a page of STATUS: pointing of a frame, mode, clock."""
        for page, angle in ((4, "RightAscension"), (5, "Declination"), (6, "Roll")):
            if fields["Page"] == page and fields[angle + "Frame"] in self.exposures:
                place, _ = self.exposures[fields[angle + "Frame"]]
                self.frames[place][angle] = math.radians(fields[angle])
        if fields["Page"] == 0:
            self.mode = fields["Mode"]
            if self.frames:
                self.frames[len(self.frames) - 1]["mode"] = fields["Mode"]
        elif fields["Page"] == 2:
            self.clock_page = fields

    def ask(self, what: str, **arguments: Any) -> Dict[str, Any]:
        """One command, said again with the same token until it is answered."""
        self.token = self.token % 255 + 1
        opcode = {"HELLO": 1, "INFO": 2, "RUN": 3, "STOP": 4, "TRIGGER": 6, "CAMERA": 7, "CAMERA_TRIGGER": 8}[what]
        for _ in range(10):
            self.transport.send("CMD", {"Opcode": opcode, "Token": self.token, **arguments})
            until_s = self.now_s() + RETRY_S
            while self.now_s() < until_s:
                self.fly(self.now_s() + 0.02)
                if answer := self.answers.pop(self.token, None):
                    if answer["Code"] != 0:
                        raise Refused(f"{what} was refused: {self.transport.codec.refusal(answer['Code'])}")
                    return answer
        raise TimeoutError(f"no answer to {what} within {10 * RETRY_S:.0f} s")

    def shake_hands(self) -> Tuple[Dict[str, Any], Dict[str, Any]]:
        """HELLO, INFO and RUN; the answers to the first two."""
        hello = self.ask("HELLO", Major=1, Minor=4)
        info = self.ask("INFO", InfoPage=0)
        self.ask("RUN")
        return hello, info

    def fire(self, number: int, at_s: Optional[float] = None) -> Dict[str, Any]:
        """Fires a trigger, to act at `at_s` of this computer's clock or at once; the answer."""
        if at_s is not None and abs(at_s - self.now_s()) > 3600:
            raise ValueError(f"the trigger is to act at {at_s:.1f} s; wanted within an hour of now: time tags wrap")
        # Zero says at once; the microsecond after it is as good.
        at_us = 0 if at_s is None else max(1, int(at_s * US) % 2**32)
        return self.ask("TRIGGER", TriggerNumber=number, TriggerTime=at_us)

    def set_camera(self, kind: str, value: int, head: int = 0) -> Dict[str, Any]:
        """Sets something of a camera head from its next exposure on; the answer."""
        return self.ask("CAMERA", CameraKind=CAMERA_KINDS[kind], CameraHead=head, CameraValue=value)

    def errors_arcsec(self) -> List[Tuple[float, float]]:
        """(mid-exposure s, largest of the three angles' errors) of each frame that showed the attitude."""
        found: List[Tuple[float, float]] = []
        self.predicted_far = 0
        for frame in self.frames.values():
            if frame.get("mode") != 1 or not {"RightAscension", "Declination", "Roll"} <= frame.keys():
                continue
            if frame["age_us"] > self.oldest_us:
                self.predicted_far += 1
                continue
            t_s = self.unwrapped_s(frame["mid_us"])
            ra, dec, roll = pointing(self.slew.at(t_s)[0])
            off = (
                wrapped_arcsec(frame["RightAscension"] - ra) * math.cos(dec),
                wrapped_arcsec(frame["Declination"] - dec),
                wrapped_arcsec(frame["Roll"] - roll),
            )
            found.append((t_s, max(off)))
        return found

    def unwrapped_s(self, t_us: int) -> float:
        """A time tag of 32 bits as this computer's time, s."""
        now_us = (time.monotonic_ns() - self.boot_ns) // 1000
        return (now_us - (now_us - t_us) % 2**32) / US


def trigger(text: str) -> Tuple[int, Optional[float]]:
    """`7` or `7@2.5`: a number, and seconds after the turn began."""
    number, _, at_s = text.partition("@")
    if not number.isascii() or not number.isdigit() or int(number) > 65535:
        raise argparse.ArgumentTypeError(f"the trigger is {number!r}; wanted a number from 0 to 65535")
    try:
        return int(number), float(at_s) if at_s else None
    except ValueError:
        raise argparse.ArgumentTypeError(f"the time is {at_s!r}; wanted seconds") from None


def camera(text: str) -> Tuple[str, int, Optional[float]]:
    """`exposure=20000` or `gain=600@2.5`: kind and value of CAMERA, and seconds after the turn began."""
    setting, _, at_s = text.partition("@")
    kind, _, value = setting.partition("=")
    if kind not in CAMERA_KINDS:
        raise argparse.ArgumentTypeError(f"the setting is {kind!r}; wanted one of {', '.join(CAMERA_KINDS)}")
    if not value.isascii() or not value.isdigit() or int(value) >= 2**32:
        raise argparse.ArgumentTypeError(f"the value of {kind} is {value!r}; wanted a whole number below 2^32")
    try:
        return kind, int(value), float(at_s) if at_s else None
    except ValueError:
        raise argparse.ArgumentTypeError(f"the time is {at_s!r}; wanted seconds") from None


def command_cameras(
    computer: FlightComputer, wanted: Sequence[Tuple[str, int, Optional[float]]], start_s: float
) -> None:
    """Gives the commands of --camera, each at its time, and prints the answers."""
    for kind, value, after_s in sorted(wanted, key=lambda one: -math.inf if one[2] is None else one[2]):
        if after_s is not None:
            computer.fly(start_s + after_s)
        computer.set_camera(kind, value)
        print(f"camera {kind}={value} was taken")


def print_camera_frames(computer: FlightComputer) -> None:
    """Prints a line for each frame whose pages of CAMERA_STATUS are complete."""
    for number, reported in sorted(computer.camera_frames.items()):
        if len(reported) == sum(map(len, CAMERA_PAGES.values())):
            print(f"camera frame {number}: " + " ".join(f"{name}={value:.10g}" for name, value in sorted(reported.items())))


def arguments() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_can_arguments(parser)
    parser.add_argument("--serial", metavar="PORT", help="a serial port instead of CAN")
    parser.add_argument("--baud", type=int, default=921600)
    parser.add_argument("--slew-deg", type=float, default=5.0, help="angle to turn (default 5)")
    parser.add_argument("--slew-s", type=float, default=8.0, help="seconds the turn takes (default 8)")
    parser.add_argument("--ra-deg", type=float, default=83.8)
    parser.add_argument("--dec-deg", type=float, default=-5.4)
    parser.add_argument("--roll-deg", type=float, default=20.0)
    parser.add_argument("--attitude-hz", type=float, default=50.0)
    parser.add_argument("--least-frames", type=int, default=20, help="fewer compared frames are a failure")
    parser.add_argument("--limit-arcsec", type=float, default=1.0)
    parser.add_argument("--trigger", type=trigger, metavar="NUMBER[@S]", action="append", default=[],
                        help="fire a trigger at once, or S seconds after the turn began; may be repeated; "
                        "a number that nothing in the run waits for is refused")
    parser.add_argument("--camera", type=camera, metavar="KIND=VALUE[@S]", action="append", default=[],
                        help="command the camera at once, or S seconds after the turn began, in the units of INTERFACE.md: "
                        "exposure=20000 (us), gain=600 (0.01 dB), report=1 (CAMERA_STATUS); may be repeated")
    parser.add_argument("--biased-deg", type=float, default=0.0, help="compare with a slew longer by this (control)")
    parsed = parser.parse_args()
    if (parsed.serial is None) == (parsed.interface is None):
        parser.error("one of --serial and --interface is needed")
    return parsed


def main() -> None:
    """Flies a turn and compares the echo; ends with the exit status."""
    given = arguments()
    transport: Union[CanTransport, SerialTransport]
    try:
        transport = SerialTransport(given.serial, given.baud) if given.serial else can_transport(given)
    except Exception as error:  # each interface of python-can has errors of its own
        sys.exit(f"flight_computer: cannot connect: {error}")
    initial = pointed(math.radians(given.ra_deg), math.radians(given.dec_deg), math.radians(given.roll_deg))
    # The axis leans against all three pointing angles.
    slew = Slew(initial, (0.3, 1.0, 0.2), math.radians(given.slew_deg), math.inf, given.slew_s)
    computer = FlightComputer(transport, slew, given.attitude_hz)
    try:
        hello, info = computer.shake_hands()
    except (Refused, TimeoutError) as error:
        sys.exit(f"flight_computer: {error}")
    same = info["DbcCrc32"] == transport.codec.dbc_crc32
    print(f"protocol {hello['Major']}.{hello['Minor']}, DBC CRC-32 {info['DbcCrc32']:08x} ({'the same' if same else 'ANOTHER'} file)")
    computer.fly(computer.now_s() + 1.0)
    slew.start_s = computer.now_s() + 0.5
    for number, after_s in given.trigger:
        try:
            answer = computer.fire(number, None if after_s is None else slew.start_s + after_s)
        except (Refused, TimeoutError, ValueError) as error:
            sys.exit(f"flight_computer: trigger {number}: {error}")
        print(f"trigger {number} was taken{', late' if answer['TriggeredLate'] else ''}")
    try:
        command_cameras(computer, given.camera, slew.start_s)
    except (Refused, TimeoutError) as error:
        sys.exit(f"flight_computer: camera: {error}")
    computer.fly(slew.start_s + given.slew_s + 1.0)
    print_camera_frames(computer)
    slew.angle += math.radians(given.biased_deg)
    # Frames exposed before the turn was planned saw the same attitude at rest.
    errors = computer.errors_arcsec()
    turning = [off for t_s, off in errors if slew.start_s < t_s < slew.start_s + given.slew_s]
    worst = max((off for _, off in errors), default=math.inf)
    if computer.predicted_far:
        print(f"{computer.predicted_far} frames were drawn from attitudes older than 100 ms, according to EXPOSURE")
    print(f"slewed {given.slew_deg} deg in {given.slew_s} s; {len(errors)} frames compared, {len(turning)} while turning")
    print(f"echoed right ascension, declination, roll: largest error {worst:.4f} arcsec (limit {given.limit_arcsec})")
    if computer.clock_page:
        page = computer.clock_page
        print(f"the stimulator sees this clock drift by {page['Drift']:.1f} ppm, residual {page['Residual']} ns")
    transport.close()
    if len(errors) < given.least_frames or not turning or worst > given.limit_arcsec or not same:
        sys.exit(4)


if __name__ == "__main__":
    main()
