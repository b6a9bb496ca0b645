#!/usr/bin/env python3
"""Writes src/stars/catalog/gaia_hipparcos.bin: the Hipparcos numbers of stars that are known by their Gaia numbers.

    hil_scripts/generate/make_hipparcos_table.py CATALOG.csv

CATALOG.csv is the table that the built-in catalog is packed from (`starloop catalog pack`), with columns source_id and hip.
The file: the number of stars, then all Gaia DR3 numbers in ascending order, then their Hipparcos numbers; little-endian, 64
and 32 bits. Its places are compared with the Hipparcos catalog itself by hil_scripts/tests/test_data_sets.py.
"""

import csv
import pathlib
import struct
import sys

OUT = pathlib.Path(__file__).resolve().parents[2] / "src" / "stars" / "catalog" / "gaia_hipparcos.bin"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with open(sys.argv[1], newline="") as table:
        rows = [(int(row["source_id"]), int(row["hip"])) for row in csv.DictReader(table) if row["hip"] not in ("", "0")]
    pairs = sorted((gaia, hipparcos) for gaia, hipparcos in rows if gaia > 0 and hipparcos > 0)
    if len({gaia for gaia, _ in pairs}) != len(pairs):
        sys.exit("a Gaia number occurs twice; wanted each once")
    numbers, hipparcos = zip(*pairs)
    OUT.write_bytes(struct.pack(f"<I{len(pairs)}q{len(pairs)}I", len(pairs), *numbers, *hipparcos))
    print(f"{len(pairs)} stars, {OUT.stat().st_size} bytes: {OUT}")


if __name__ == "__main__":
    main()
