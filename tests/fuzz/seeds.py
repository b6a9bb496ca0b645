#!/usr/bin/env python3
"""Writes the seeds in tests/fuzz/corpus: the published bytes of every message, and captures and lines made by hand.

    python3 tests/fuzz/seeds.py

Needed only after a change of firmware_protocol/vectors.json or of how a target takes its input apart.
"""

import json
import struct
from pathlib import Path

HERE = Path(__file__).parent
VECTORS = json.loads((HERE / "../../firmware_protocol/vectors.json").read_text())
# Message numbers in the order of MessageId::ALL.
NUMBERS = [0x08, 0x18, 0x19, 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x28, 0x2A, 0x30, 0x31, 0x48, 0x58, 0x60, 0x70]
AS_IT_IS = 2  # the frame is not sealed by the target
STREAM = 2


def frame(vector, entry):
    number = int(entry["id"], 16) - vector["base"] >> 4
    data = bytes.fromhex(entry["data"])
    return bytes([NUMBERS.index(number) << 3 | (len(data) > 8), AS_IT_IS]) + data


def can_decode():
    groups = {}
    for vector in VECTORS["messages"]:
        frames = [vector["fd"]] + (vector["classic"] or [])
        groups.setdefault((vector["base"], vector["node"]), []).extend(frame(vector, entry) for entry in frames)
    for (base, node), frames in groups.items():
        yield f"vectors_{base:02x}_{node}", bytes([node << 4 | STREAM, base >> 4]) + b"".join(frames)
    sealed = b"".join(bytes([NUMBERS.index(n) << 3, 0]) + bytes(8) for n in (0x21, 0x22))
    yield "group", bytes([STREAM, 0]) + sealed + bytes([NUMBERS.index(0x25) << 3, 0]) + bytes(8)
    yield "record", bytes([STREAM, 0, NUMBERS.index(0x30) << 3 | 1, 0]) + struct.pack("<IBBH", 7, 1, 3, 0) + bytes(range(40))
    # Flags, time tag, sequence number, quaternion, rates, then kind and places of the damage.
    record = bytes([3, 1, 2, 3, 4, 9]) + bytes(range(1, 9)) + bytes(range(24))
    for kind, name in ((0, "fd"), (1, "group")):
        yield f"damage_{name}_three", bytes([kind, 0]) + record + bytes([2, 5, 0, 9, 0, 80, 0])
        yield f"damage_{name}_burst", bytes([kind, 0]) + record + bytes([3, 0xFF, 0xFF, 40, 0])


def serial_resync():
    head = bytes([0, 1, 0, 2]) + bytes([3, 1, 2, 3, 4, 9]) + bytes(range(1, 9)) + bytes(range(24)) + bytes(range(8))
    lines = [bytes.fromhex(vector["serial"]["data"]) for vector in VECTORS["messages"] if vector.get("serial")]
    yield "silence", head
    yield "vectors", head + b"".join(lines)[:1200]
    yield "cut", head + b"".join(line[: len(line) // 2] for line in lines)[:600]
    yield "oversize", head + bytes([1]) * 100 + bytes([0, 5, 5, 0, 0])


def slcan():
    lines = [b"\r\r\rC\rS6\rY5\rO\r", b"t1232AABB\rZ1\r", b"d3019" + b"5A" * 12 + b"\rb301F" + b"a5" * 64 + b"\r",
             b"T000001230\rr1230\rM00000000\rmFFFFFFFF\r", b"V\r\nv\r\nN\r\nF\r\nL\r", b"t800\rS9\rt12x0\rQ\r" + b"D" * 140 + b"\rO\r"]
    for place, line in enumerate(lines):
        yield f"lines_{place}", bytes([2, 0, 7, 30]) + line


def socketcand():
    texts = [b"< open can0 >< rawmode >", b"< send 123 2 11 22 >< send 7ff 8 1 2 3 4 5 6 7 8 >", b"< echo > x < send 12< echo >\r\n",
             b"< add 1 0 123 0 >< send 00000123 0 >< open abcdefghijklmnop >", b"<" + b"x" * 130 + b">< echo >\0"]
    for place, text in enumerate(texts):
        yield f"elements_{place}", bytes([2, 0, 7, 30]) + text


def block(kind, body, order="<"):
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", len(body) + 12)
    return struct.pack(order + "I", kind) + length + body + length


def option(code, value, order="<"):
    return struct.pack(order + "HH", code, len(value)) + value + bytes(-len(value) % 4)


def packet(interface, data, order="<"):
    options = option(2, struct.pack(order + "I", 2), order) + option(1, b"TAI 1772366437000000000 ns", order)
    return struct.pack(order + "5I", interface, 412659, 1077936128, len(data), len(data)) + data + bytes(-len(data) % 4) + options


def captures():
    any_file, any_blocks, line, packets = bytes([0]), bytes([1]), bytes([2]), bytes([3])
    log = b"(1772366400.123456789) can0 123#DEADBEEF R\n(1.5) vcan0 301##1" + b"5A" * 12 + b" T\n(0.0) can1 00000123#R\n\n"
    yield "candump", any_file + log
    yield "candump_cut", any_file + log[:60]
    yield "line", line + b"(1772366400.000001) can0 7FF#1122334455667788_9 T"
    can = struct.pack(">IBBH", 0x123, 2, 0, 0) + b"\x11\x22"
    for name, order in (("little", "<"), ("big", ">")):
        bodies = [(1, struct.pack(order + "HHI", kind, 0, 0) + option(9, b"\x09", order)) for kind in (227, 147)]
        bodies += [(6, packet(0, can, order)), (6, packet(1, b"starloop" * 12, order)), (3, bytes(8))]
        section = block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)
        file = section + b"".join(block(kind, body, order) for kind, body in bodies)
        yield f"pcapng_{name}", any_file + file
        yield f"pcapng_{name}_cut", any_file + file[:-30]
        described = b"".join(bytes([0 if kind == 1 else 2, len(body), 0]) + body for kind, body in bodies[:4])
        yield f"blocks_{name}", any_blocks + bytes([order == ">"]) + described
    two = bytes([9]) + struct.pack("<I", 5) + bytes([3, 0x23, 1]) + b"abc" + bytes([0]) + struct.pack("<q", 10**18) + bytes([2, 1, 0]) + b"xy"
    yield "packets_can", packets + bytes([200, 0, 0]) + two
    yield "packets_serial", packets + bytes([200, 0, 1]) + two


def session():
    hello, run, stop, retry = bytes([6, 1, 0, 1]), bytes([6, 2, 4]), bytes([6, 3, 6]), bytes([4, 0, 0])
    other = bytes([6, 1, 2, 9])
    yield "agreement", bytes([1]) + run + hello + run + retry + stop + retry + other + run
    for table, columns in enumerate((5, 4, 7)):
        upload = bytes([3, table, 2]) + bytes(3 * columns)
        apply = bytes([5, 2, 0, table, 3, 1, 0])
        yield f"table_{table + 1}", bytes([1]) + hello + upload + apply + retry + bytes([0, table, 0, 1, 11]) + apply
    yield "no_tables", bytes([0]) + hello + bytes([5, 2, 0, 0, 0, 1, 0])
    trigger = lambda token, number: bytes([6, token, 7, 0, number, 0, 1, 2, 3, 4])
    yield "triggers", bytes([0]) + trigger(1, 0) + hello + trigger(2, 2) + retry + trigger(3, 1) + trigger(3, 0)


def network_camera():
    # Sender, pause, kind (number of words above, 1 below), flags, code; then place and step, or a value, by turns.
    def command(sender, pause, code, *words):
        body = b"".join(bytes([word[0], 0, word[1]]) if isinstance(word, tuple) else struct.pack(">I", word) for word in words)
        return bytes([sender, 0, pause, len(words) << 4 | 1, 1, code, 0]) + body

    control, stream_port, stream_address = (0, 0), (1, 0), (1, 6)
    take, start = command(0, 0, 3, control, 2), command(0, 0, 3, (4, 0), 1)
    stream = command(0, 0, 3, stream_port, 1234) + command(0, 0, 3, stream_address, 0x0A000007)
    yield "stream", take + stream + start + command(0, 0, 1, 1, 2, 3) + command(1, 0, 3, (3, 2), 5)
    yield "silence", take + stream + start + command(1, 200, 3, control, 2) + command(0, 0, 3, (3, 2), 5)
    yield "size", take + stream + command(0, 0, 3, (1, 1), 0xC0000000 + 1400) + command(0, 0, 5, (3, 2), 8)
    yield "read", command(1, 0, 0) + command(1, 0, 4, (3, 0), 64) + command(2, 0, 2, (3, 0)) + command(0, 0, 6, (6, 0), 0, (6, 0))


for target in (can_decode, serial_resync, slcan, socketcand, captures, network_camera, session):
    folder = HERE / "corpus" / target.__name__
    folder.mkdir(parents=True, exist_ok=True)
    for name, seed in target():
        (folder / name).write_bytes(seed)
