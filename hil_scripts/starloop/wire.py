"""Messages of the wire protocol over python-can (classic and FD, coded by the DBC) and over a serial line (COBS).

A transport sends and receives `(name, fields)`: names and fields are those of firmware_protocol/dbc/starloop.dbc, in
its units. `send` returns the instant at which the message left as well as the transport knows, on this program's own
clock (time.monotonic_ns).

  CanTransport     needs python-can and cantools; `interface` and `channel` are python-can's
  SerialTransport  needs pyserial and cantools

An attitude is given as ATT_FD on every transport; on classic CAN it leaves as the equivalent group of frames.
"""
from __future__ import annotations

import argparse
import binascii
import struct
import time
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

import cantools

Fields = Mapping[str, Any]
"""Values of a message by the names of the DBC, in its units."""
Received = Tuple[str, Dict[str, Any]]
"""Name and fields of a message."""

HERE = Path(__file__).resolve()
PLACES = (HERE.with_name("starloop.dbc"), HERE.parents[2] / "firmware_protocol/dbc/starloop.dbc")
"""The DBC beside this file in a wheel, and of a clone or the Debian package."""
DBC = next((path for path in PLACES if path.exists()), PLACES[-1])
MAJOR = 1
# The packet's type on a serial line is the CAN identifier without its node.
NODE_BITS = 4
# Meanings of the refusals in RSP, by code; the DBC has the names.
REFUSALS = {
    1: "the stimulator does not know this command, or lacks the capability",
    2: "the stimulator speaks another major version",
    3: "no HELLO came before it",
    4: "a page of this number does not exist",
    5: "a cell of the table has not arrived",
    6: "a cell of the table differs from what was summed",
    7: "no such table, too many rows, or a value outside its limits",
    8: "an instant was given before the first SYNC and TIME_FUP",
    9: "its instant is more than 1 h ahead or 5 min past",
    10: "64 triggers wait already",
    11: "no fault or event of the run waits for this number",
    12: "the value is outside the range of the camera",
    13: "the camera lacks what is set, or cannot be commanded",
    14: "a camera head of this number does not exist",
    15: "as many commands wait for exposures of the camera as it keeps",
}
# Bytes without a delimiter that are kept: no packet is as long.
HELD_MAX = 4096


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs(plain: bytes) -> bytes:
    """Consistent overhead byte stuffing of a packet shorter than 254 bytes."""
    return b"".join(bytes([len(run) + 1]) + run for run in plain.split(b"\0"))


def plain_of(stuffed: bytes) -> Optional[bytes]:
    """The packet of stuffed bytes; None when they are damaged."""
    plain, at = bytearray(), 0
    while at < len(stuffed):
        length = stuffed[at]
        if length == 0 or at + length > len(stuffed):
            return None
        plain += stuffed[at + 1 : at + length]
        at += length
        if at < len(stuffed):
            plain.append(0)
    return bytes(plain)


class Codec:
    """Fields <-> payloads, by the DBC."""

    def __init__(self) -> None:
        self.database: Any = cantools.database.load_file(DBC)
        self.dbc_crc32 = binascii.crc32(DBC.read_bytes())

    def payload(self, name: str, fields: Fields) -> bytes:
        """The bytes of a message; the CRC-16 of an attitude is filled in."""
        if name == "ATT_FD":
            data = bytearray(self._encoded(name, {**fields, "Crc16": 0}))
            data[6:8] = struct.pack("<H", crc16(bytes(data[:6] + data[8:])))
            return bytes(data)
        return self._encoded(name, fields)

    def _encoded(self, name: str, fields: Fields) -> bytes:
        message = self.database.get_message_by_name(name)
        try:
            return bytes(message.encode(fields, scaling=True, strict=False))
        except Exception as error:
            raise ValueError(f"{name}: cannot encode {fields}: {error}") from error

    def classic_group(self, fields: Fields) -> List[Tuple[str, bytes]]:
        """The frames of an attitude on classic CAN, the commit last."""
        def pick(*names: str) -> Dict[str, Any]:
            return {name: fields[name] for name in names}

        parts = [("ATT_Q01", pick("Qw", "Qx")), ("ATT_Q23", pick("Qy", "Qz"))]
        if fields["RateValid"]:
            parts.append(("ATT_W", pick("RateX", "RateY", "RateZ")))
        if fields["AccelerationValid"]:
            parts.append(("ATT_A", pick("AccelerationX", "AccelerationY", "AccelerationZ")))
        frames = [(name, self._encoded(name, values)) for name, values in parts]
        commit = {**pick("TimeTag", "Seq", "RateValid", "AccelerationValid"), "Crc16": 0}
        head = self._encoded("ATT_T", commit)[:6]
        crc = crc16(b"".join(data for _, data in frames) + head)
        return [*frames, ("ATT_T", head + struct.pack("<H", crc))]

    def identifier(self, name: str) -> int:
        """The CAN identifier of a message of node 0, base 0."""
        return self.database.get_message_by_name(name).frame_id  # type: ignore[no-any-return]

    def refusal(self, code: int) -> str:
        """Name, code and meaning of a refusal in RSP; a code of a later version has no name here."""
        names = self.database.get_message_by_name("RSP").get_signal_by_name("Code").choices
        meaning = REFUSALS.get(code, "a later version of the protocol has this code")
        return f"{names.get(code, 'unknown')} (code {code}): {meaning}"

    def fields(self, identifier: int, data: bytes) -> Optional[Received]:
        """Name and fields of a payload; None for an identifier or a length that the DBC does not have, or a scaled integer
        at its lowest count, which is below the DBC's range: no sender of this protocol has it."""
        try:
            message = self.database.get_message_by_frame_id(identifier)
            fields = message.decode(bytes(data), decode_choices=False)
        except (KeyError, cantools.database.DecodeError):
            return None
        is_lowest = any(self._is_below(message.get_signal_by_name(signal), value) for signal, value in fields.items())
        return None if is_lowest else (message.name, fields)

    @staticmethod
    def _is_below(signal: Any, value: Any) -> bool:
        return bool(signal.is_signed and not signal.is_float and value < signal.minimum - signal.scale / 2)


class CanTransport:
    """A node on a CAN bus, through python-can. The DBC is of node 0, base 0 and 11 bits; others are counted from there."""

    def __init__(
        self, interface: str, channel: str, fd: bool, node: int = 0, base: int = 0, id_bits: int = 11, **options: Any
    ):
        import can

        self.can: Any = can
        self.fd, self.codec = fd, Codec()
        self.node, self.base, self.is_extended = node, base, id_bits == 29
        # python-can's slcan takes no `fd`: it takes FD from the message.
        if fd and interface != "slcan":
            options["fd"] = True
        if interface == "slcan":
            options.setdefault("sleep_after_open", 0)
        self.bus: Any = can.Bus(interface=interface, channel=channel, **options)

    def send(self, name: str, fields: Fields) -> int:
        """Sends a message; the time at which it left, ns of the monotonic clock."""
        frames = (
            self.codec.classic_group(fields)
            if name == "ATT_FD" and not self.fd
            else [(name, self.codec.payload(name, fields))]
        )
        for part, data in frames:
            # As the interface document has it: what fits a classic frame goes as one.
            fd = self.fd and len(data) > 8
            message = self.can.Message(
                arbitration_id=self.identifier(part),
                data=data,
                is_extended_id=self.is_extended,
                is_fd=fd,
                bitrate_switch=fd,
            )
            self.bus.send(message)
        return time.monotonic_ns()

    def identifier(self, name: str) -> int:
        """The CAN identifier of a message of this node; SYNC is for all nodes."""
        return self.base + self.codec.identifier(name) + (0 if name == "SYNC" else self.node)

    def message(self, message: Any) -> Optional[Received]:
        """Name and fields of a frame; None when it is not of this node."""
        if message.is_extended_id != self.is_extended:
            return None
        found = self.codec.fields(message.arbitration_id - self.base & ~0xF, message.data)
        return found if found and self.identifier(found[0]) == message.arbitration_id else None

    def receive(self, timeout_s: float) -> Optional[Received]:
        """The next message of the DBC, as (name, fields), or None."""
        until = time.monotonic() + timeout_s
        while True:
            message = self.bus.recv(max(0.0, until - time.monotonic()))
            if message is None:
                return None
            if message.is_error_frame or message.is_remote_frame:
                continue
            found = self.message(message)
            if found:
                return found

    def close(self) -> None:
        """Leaves the bus."""
        self.bus.shutdown()


def add_can_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments that say where a CAN bus is, and which node on it."""
    parser.add_argument("--interface", help="python-can interface: slcan, socketcand, socketcan, ...")
    parser.add_argument("--channel", default="can0", help="python-can channel (default can0)")
    parser.add_argument("--host", help="host of socketcand")
    parser.add_argument("--port", type=int, help="port of socketcand")
    parser.add_argument("--node", type=int, default=0, help="node of flight computer and star sensor, 0 to 15")
    parser.add_argument("--id-bits", type=int, choices=(11, 29), default=11, help="bits of every identifier")
    parser.add_argument("--id-base", type=lambda text: int(text, 0), default=0,
                        help="added to every identifier, a multiple of 16, such as 0x18FF0000 with 29 bits")
    parser.add_argument("--fd", action="store_true", help="CAN FD instead of classic CAN")


def can_transport(given: argparse.Namespace) -> CanTransport:
    """The transport of these arguments."""
    options = {key: value for key, value in (("host", given.host), ("port", given.port)) if value is not None}
    return CanTransport(given.interface, given.channel, given.fd, given.node, given.id_base, given.id_bits, **options)


class SerialTransport:
    """The far end of a serial line."""

    fd = True  # an attitude travels in one piece

    def __init__(self, port: str, baud: int):
        import serial  # type: ignore[import-untyped]

        self.codec = Codec()
        self.line: Any = serial.Serial(port, baud, timeout=0)
        self.sequence, self.held = 0, bytearray()
        self.damaged = 0

    def send(self, name: str, fields: Fields) -> int:
        """Sends a message; the time at which it left, ns of the monotonic clock."""
        data = self.codec.payload(name, fields)
        number = self.codec.identifier(name) >> NODE_BITS
        packet = bytes([MAJOR, number, self.sequence, len(data)]) + data
        packet += struct.pack("<H", crc16(packet))
        self.sequence = (self.sequence + 1) & 0xFF
        self.line.write(cobs(packet) + b"\0")
        self.line.flush()
        return time.monotonic_ns()

    def receive(self, timeout_s: float) -> Optional[Received]:
        """The next message of the DBC, as (name, fields), or None; damaged packets are counted."""
        until = time.monotonic() + timeout_s
        while True:
            while b"\0" in self.held:
                stuffed, _, self.held = self.held.partition(b"\0")
                found = self._message(bytes(stuffed)) if stuffed else None
                if found:
                    return found
            left = until - time.monotonic()
            if left <= 0:
                return None
            if len(self.held) > HELD_MAX:
                self.damaged += 1
                self.held.clear()
            self.line.timeout = min(left, 0.02)
            self.held += self.line.read(max(1, self.line.in_waiting))

    def _message(self, stuffed: bytes) -> Optional[Received]:
        packet = plain_of(stuffed)
        if packet is None or len(packet) < 6 or crc16(packet[:-2]) != struct.unpack("<H", packet[-2:])[0]:
            self.damaged += 1
            return None
        _, number, _, length = packet[:4]
        return self.codec.fields(number << NODE_BITS, packet[4 : 4 + length])

    def close(self) -> None:
        """Closes the port."""
        self.line.close()
