#!/usr/bin/env python3
"""Load and latency of a CAN bus with a stimulator on it: what is sent how often, how full the bus is, how fast answers are.

  hil_scripts/starloop/bus_report.py --interface socketcan --channel can0 --fd --bit-rate 500000 --data-bit-rate 5000000
  hil_scripts/starloop/bus_report.py --interface slcan --channel socket://127.0.0.1:PORT --seconds 10 --ask

Load counts every frame with its worst-case stuff bits (ISO 11898-1), as a budget must. --ask also sends INFO commands,
and prints the round trip to their responses: only when no other program sends commands on this bus.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Sequence

if not __package__:  # called by its path
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from starloop.wire import add_can_arguments, can_transport


def classic_s(length: int, is_extended: bool, bit_rate: float) -> float:
    """A frame with the most stuff bits and the interframe space (Davis et al. 2007)."""
    return ((80 if is_extended else 55) + 10 * length) / bit_rate


def fd_s(length: int, is_extended: bool, bit_rate: float, data_bit_rate: float) -> float:
    """An FD frame with bit rate switching, most stuff bits."""
    head, tail = 36 if is_extended else 17, 13
    head_stuff = (head - 1) // 4
    stuffed = 5 + 8 * length
    stuff = (head + stuffed - 1) // 4 - head_stuff
    crc = 4 + 17 + 6 if length <= 16 else 4 + 21 + 7
    return (head + head_stuff + tail) / bit_rate + (stuffed + stuff + crc) / data_bit_rate


def quantile(sorted_values: Sequence[float], share: float) -> float:
    """The value below which this share of sorted values lies."""
    return sorted_values[min(len(sorted_values) - 1, int(share * len(sorted_values)))]


def main() -> None:
    """Listens to a bus and prints its load and its messages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_can_arguments(parser)
    parser.add_argument("--bit-rate", type=float, default=500e3)
    parser.add_argument("--data-bit-rate", type=float, default=5e6)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--ask", action="store_true", help="measure the round trip of INFO commands")
    given = parser.parse_args()
    if not given.interface:
        parser.error("the following arguments are required: --interface")
    transport = can_transport(given)
    counts: Counter[str] = Counter()
    busy_s: dict[str, float] = {}
    trips_ms: list[float] = []
    token, asked_at, next_ask = 0, None, time.monotonic()
    begin = time.monotonic()
    while (now := time.monotonic()) < begin + given.seconds:
        if given.ask and now >= next_ask:
            token = token % 255 + 1
            transport.send("CMD", {"Opcode": 2, "Token": token, "InfoPage": 0})
            asked_at, next_ask = time.monotonic(), now + 0.05
        message = transport.bus.recv(0.01)
        if message is None or message.is_error_frame:
            continue
        found = transport.message(message)
        digits = 8 if message.is_extended_id else 3
        name = found[0] if found else f"0x{message.arbitration_id:0{digits}x}"
        counts[name] += 1
        size = len(message.data), message.is_extended_id, given.bit_rate
        frame_s = fd_s(*size, given.data_bit_rate) if message.is_fd else classic_s(*size)
        busy_s[name] = busy_s.get(name, 0.0) + frame_s
        if found and name == "RSP" and found[1]["Token"] == token and asked_at is not None:
            trips_ms.append((time.monotonic() - asked_at) * 1e3)
            asked_at = None
    elapsed_s = time.monotonic() - begin
    transport.close()
    print(f"{'message':<12}{'per second':>12}{'load %':>10}")
    for name, count in counts.most_common():
        print(f"{name:<12}{count / elapsed_s:>12.1f}{100 * busy_s[name] / elapsed_s:>10.2f}")
    print(f"{'all':<12}{counts.total() / elapsed_s:>12.1f}{100 * sum(busy_s.values()) / elapsed_s:>10.2f}")
    if trips_ms:
        trips_ms.sort()
        print(
            f"command to response, {len(trips_ms)} times: p50 {quantile(trips_ms, 0.5):.2f} ms, "
            f"p99 {quantile(trips_ms, 0.99):.2f} ms, largest {trips_ms[-1]:.2f} ms"
        )


if __name__ == "__main__":
    main()
