#!/usr/bin/env python3
"""The DBC file of another node, base or length of identifiers, from starloop.dbc (node 0, base 0, 11 bits):

  python3 firmware_protocol/dbc/readdress.py --node 5 --id-bits 29 --id-base 0x18FF0000 > bench.dbc

As DBC files have it, bit 31 of an identifier says 29 bits. INFO reports the CRC-32 of starloop.dbc, not of this file.
"""

import argparse
import re
import sys
from pathlib import Path

DBC = Path(__file__).resolve().parent / "starloop.dbc"
SYNC, HEARTBEAT = 0x08, 0x70
EXTENDED = 1 << 31
# Where a line has an identifier: messages, comments, attributes, values, types, multiplexers.
IDENTIFIER = re.compile(r'^(BO_|CM_ BO_|CM_ SG_|BA_ "\w+" (?:BO_|SG_)|VAL_|SIG_VALTYPE_|SG_MUL_VAL_) (\d+)\b', re.MULTILINE)
FORMAT = re.compile(r'^(BA_ "VFrameFormat" BO_ \d+) (\d+);', re.MULTILINE)


def readdressed(text, node, base, bits):
    def moved(found):
        identifier = int(found[2])
        place = base + identifier + (0 if identifier >> 4 == SYNC else node)
        return f"{found[1]} {place | EXTENDED if bits == 29 else place}"

    # StandardCAN is followed by ExtendedCAN, StandardCAN_FD by ExtendedCAN_FD.
    formats = lambda found: f"{found[1]} {int(found[2]) + (bits == 29)};"
    return FORMAT.sub(formats, IDENTIFIER.sub(moved, text))


def arguments():
    number = lambda text: int(text, 0)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--node", type=number, default=0, help="node of flight computer and star sensor, 0 to 15")
    parser.add_argument("--id-bits", type=int, choices=(11, 29), default=11, help="bits of identifiers")
    parser.add_argument("--id-base", type=number, default=0, help="added to every identifier, a multiple of 16")
    given = parser.parse_args()
    most = (1 << given.id_bits) - 1 - (HEARTBEAT << 4 | 15)
    if not 0 <= given.node <= 15:
        parser.error(f"--node is {given.node}; wanted 0 to 15")
    if given.id_base % 16 or not 0 <= given.id_base <= most:
        parser.error(f"--id-base is {given.id_base:#x}; wanted a multiple of 16 from 0 to {most & ~15:#x}")
    return given


def main():
    given = arguments()
    sys.stdout.write(readdressed(DBC.read_text(), given.node, given.id_base, given.id_bits))


if __name__ == "__main__":
    main()
