#!/usr/bin/env python3
"""Read the frames that a running starloop publishes through iceoryx2.

A bench publishes them with

    [[extra_sink]]
    kind = "iceoryx2"
    service = "starloop/frames"

when starloop was built with `--features iceoryx2`, and `python3 hil_scripts/starloop/iceoryx_frames.py starloop/frames` prints a
line per frame. As a module:

    with IceoryxFrames("starloop/frames") as reader:
        for frame in reader.frames():          # until the last publisher is gone
            use(frame.head.frame, frame.pixels)   # width * height 16-bit words, row by row

Needs the package `iceoryx2`. A reader that is slow misses frames, `missed` counts them, and nothing that a reader does
holds up the run.
"""
from __future__ import annotations

import ctypes
import sys
import time
from typing import Any, Iterator, NamedTuple, Optional

import iceoryx2 as iox2  # type: ignore[import-untyped]


# After so long without a frame it is seen whether the run still lives.
SILENCE_S = 1.0


class FrameHead(ctypes.Structure):
    """Header before the pixels: `SlotHead` in src/frames/sink/shared_memory.rs."""

    _fields_ = [
        ("serial", ctypes.c_uint64),
        ("mid_exposure_tai_ns", ctypes.c_int64),
        ("lateness_ns", ctypes.c_int64),
        ("horizon_ns", ctypes.c_int64),
        ("frame", ctypes.c_uint32),
        ("pixel_crc32", ctypes.c_uint32),
        ("faults", ctypes.c_uint32),
        ("stars", ctypes.c_uint32),
        ("exposure_s", ctypes.c_double),
        ("attitude_wxyz", ctypes.c_double * 4),
        ("ra_dec_roll_deg", ctypes.c_double * 3),
        ("rate_deg_s", ctypes.c_double * 3),
        ("gain_e_per_dn", ctypes.c_double),
        ("black_level_dn", ctypes.c_double),
        ("width_px", ctypes.c_uint32),
        ("height_px", ctypes.c_uint32),
        ("noise_seed", ctypes.c_uint64),
        ("jitter_missing_ns", ctypes.c_int64),
        ("reserved", ctypes.c_uint64 * 10),
    ]

    @staticmethod
    def type_name() -> str:
        """The name by which both ends know the type."""
        return "StarloopFrameHead"


class IceoryxFrame(NamedTuple):
    """A frame: its head, and its pixels as 16-bit words, row by row."""

    head: FrameHead
    pixels: bytes


class IceoryxFrames:
    """The reading end of a service."""

    def __init__(self, service: str):
        self.node: Any = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
        builder = self.node.service_builder(iox2.ServiceName.new(service))
        builder = builder.publish_subscribe(iox2.Slice[ctypes.c_uint16]).user_header(FrameHead)
        self.service: Any = builder.open()
        self.subscriber: Any = self.service.subscriber_builder().create()
        self.last: Optional[int] = None
        self.missed = 0

    def __enter__(self) -> IceoryxFrames:
        return self

    def __exit__(self, *_: Any) -> None:
        self.subscriber.delete()
        del self.subscriber, self.service, self.node

    @property
    def is_over(self) -> bool:
        """Returns True when the last publisher is gone."""
        return bool(self.service.dynamic_config.number_of_publishers == 0)

    def take(self) -> Optional[IceoryxFrame]:
        """The oldest frame that waits; None when none does."""
        sample = self.subscriber.receive()
        if sample is None:
            return None
        head = FrameHead.from_buffer_copy(sample.user_header().contents)
        # Not by the slice's own length, which the package counts in bytes.
        pixels = ctypes.string_at(sample.payload().as_ptr(), 2 * head.width_px * head.height_px)
        sample.delete()
        # A run that comes after another one counts from 1 again.
        is_new_run = self.last is None or head.serial <= self.last
        self.missed += 0 if is_new_run else head.serial - self.last - 1
        self.last = head.serial
        return IceoryxFrame(head, pixels)

    def frames(self, poll_s: float = 0.002) -> Iterator[IceoryxFrame]:
        """Yields frames as they come, until the last publisher is gone."""
        begun = got = time.monotonic()
        is_received = False
        while True:
            # Before looking: what is published after this look is found by the next one.
            is_over = self.is_over
            while (frame := self.take()) is not None:
                got = time.monotonic()
                is_received = True
                yield frame
            is_received = is_received or not is_over
            # A run that begins has its service a moment before it publishes.
            if is_over and (is_received or time.monotonic() - begun > SILENCE_S):
                return
            if time.monotonic() - got > SILENCE_S:
                # A run that was killed has not said that it is over.
                self.service.try_cleanup_dead_nodes()
                got = time.monotonic()
            time.sleep(poll_s)


def main() -> None:
    """Prints a line for each frame."""
    if len(sys.argv) != 2:
        sys.exit("iceoryx_frames.py: wanted the name of the service, such as starloop/frames")
    with IceoryxFrames(sys.argv[1]) as reader:
        for frame in reader.frames():
            head = frame.head
            ra_deg, dec_deg, _ = head.ra_dec_roll_deg
            print(
                f"frame {head.frame:6}  {head.width_px} x {head.height_px} px  RA {ra_deg:.5f}  Dec {dec_deg:.5f}  "
                f"{head.stars} stars  CRC-32 {head.pixel_crc32:08x}",
                flush=True,
            )
        print(f"over: {reader.missed} missed")


if __name__ == "__main__":
    main()
