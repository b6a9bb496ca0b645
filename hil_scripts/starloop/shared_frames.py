#!/usr/bin/env python3
"""Read the frames that a running starloop shares with programs on this machine.

A bench shares them with

    [[extra_sink]]
    kind = "shared_memory"
    path = "/dev/shm/starloop"

and `python3 hil_scripts/starloop/shared_frames.py /dev/shm/starloop` prints a line per frame. As a module:

    with SharedFrames("/dev/shm/starloop") as ring:
        for frame in ring.frames():          # until the run is over
            use(frame.head["frame"], frame.pixels)   # width * height little 16-bit words, row by row

Needs the standard library only. The file is a ring: a reader that is slow misses frames, `missed` counts them, and
nothing that a reader does holds up the run. Every frame that comes out is whole, which its CRC-32 proves.
"""
from __future__ import annotations

import mmap
import os
import struct
import sys
import time
import zlib
from typing import Any, Dict, Iterator, NamedTuple, Optional, Union

# Native byte order: the file never leaves the machine. firmware_protocol/FRAMES.md has the layout.
FILE_HEAD = struct.Struct("=16sIIIIQQI12x")
SLOT_HEAD = struct.Struct("=QqqqIIIId4d3d3dddIIQq80x")
SLOT_NAMES = (
    "serial mid_exposure_tai_ns lateness_ns horizon_ns frame pixel_crc32 faults stars exposure_s qw qx qy qz "
    "ra_deg dec_deg roll_deg rate_x_deg_s rate_y_deg_s rate_z_deg_s gain_e_per_dn black_level_dn width_px height_px "
    "noise_seed jitter_missing_ns"
).split()
MAGIC = b"STARLOOP-FRAMES\0"


class SharedFrame(NamedTuple):
    """A frame: its head by the names of `SLOT_NAMES`, and its pixels as little 16-bit words, row by row."""

    head: Dict[str, Any]
    pixels: bytes


class SharedFrames:
    """The reading end of a ring of frames."""

    def __init__(self, path: Union[str, "os.PathLike[str]"]):
        with open(path, "rb") as file:
            self.memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        magic, version, self.slots, self.width, self.height, self.slot_bytes, _, _ = FILE_HEAD.unpack_from(self.memory)
        if magic != MAGIC or version != 1:
            raise ValueError(f"{path}: got {magic!r} version {version}, wanted {MAGIC!r} version 1")
        self.next = 1
        self.missed = 0

    def __enter__(self) -> SharedFrames:
        return self

    def __exit__(self, *_: Any) -> None:
        self.memory.close()

    @property
    def published(self) -> int:
        """Frames that the run has written so far."""
        return int(FILE_HEAD.unpack_from(self.memory)[6])

    @property
    def is_over(self) -> bool:
        """Whether the run has ended: no further frame comes."""
        return int(FILE_HEAD.unpack_from(self.memory)[7]) != 0

    def read(self, serial: int) -> Optional[SharedFrame]:
        """Frame `serial`, from 1; None when it is not there yet or has been overwritten."""
        at = FILE_HEAD.size + (serial - 1) % self.slots * self.slot_bytes
        head = dict(zip(SLOT_NAMES, SLOT_HEAD.unpack_from(self.memory, at)))
        if head["serial"] != serial:
            return None
        begin = at + SLOT_HEAD.size
        pixels = self.memory[begin : begin + 2 * self.width * self.height]
        is_whole = struct.unpack_from("=Q", self.memory, at)[0] == serial and zlib.crc32(pixels) == head["pixel_crc32"]
        return SharedFrame(head, pixels) if is_whole else None

    def frames(self, poll_s: float = 0.002) -> Iterator[SharedFrame]:
        """Frames as they come, until the run is over."""
        while True:
            # Before looking: what is written after this look is found by the next one.
            is_over = self.is_over
            published = self.published
            while self.next <= published:
                oldest = max(self.next, published - self.slots + 1)
                self.missed += oldest - self.next
                frame = self.read(oldest)
                self.next = oldest + 1
                if frame is None:
                    self.missed += 1
                else:
                    yield frame
                published = self.published
            if is_over:
                return
            time.sleep(poll_s)


def main() -> None:
    """Prints a line for each frame."""
    if len(sys.argv) != 2:
        sys.exit("shared_frames.py: wanted the path of the shared memory, such as /dev/shm/starloop")
    with SharedFrames(sys.argv[1]) as ring:
        print(f"{ring.width} x {ring.height} px, {ring.slots} slots")
        for frame in ring.frames():
            head = frame.head
            print(
                f"frame {head['frame']:6}  RA {head['ra_deg']:.5f}  Dec {head['dec_deg']:.5f}  {head['stars']} stars  "
                f"CRC-32 {head['pixel_crc32']:08x}",
                flush=True,
            )
        print(f"over: {ring.missed} missed")


if __name__ == "__main__":
    main()
