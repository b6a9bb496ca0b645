#!/usr/bin/env python3
"""Compares the bits of every shipped bench and scenario, flown on the virtual clock, with a table in tests/golden.

    hil_scripts/bits.py                      all rows; exit status 1 when one differs
    hil_scripts/bits.py --subset             the rows that continuous integration flies
    hil_scripts/bits.py --only benches/moon.toml
    hil_scripts/bits.py --write              writes the table from this program

Columns of tests/golden/bits.csv: `frames` is the CRC-32 of all pixels, `records` of frames.csv and the truth tables,
`telemetry` of a scenario's telemetry. The table belongs to the CPU backend on x86_64 with fused multiply-add. A file that
cannot be flown on the virtual clock has the first words of its refusal instead.
"""

import argparse
import csv
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent
TABLE = ROOT / "tests" / "golden" / "bits.csv"
COLUMNS = ["file", "duration_s", "subset", "frames", "records", "telemetry"]
#: Length of a bench's run, s; scenarios fly whole.
DURATION_S = {"benches/telescope.toml": 1, "benches/galactic_slew.toml": 1}
DEFAULT_DURATION_S = 3
#: Flown by another program, without which they wait: hil_scripts/tests/test_plain_links.py has their frames.
OUTSIDE = {"benches/forty_two.toml"}
#: Flown by continuous integration: a few seconds each.
SUBSET = {
    "benches/loopback.toml",
    "benches/cubesat.toml",
    "benches/moon.toml",
    "benches/target_crossing.toml",
    "benches/three_heads.toml",
    "benches/lunar_orbit.toml",
    "scenarios/bus_faults.toml",
    "scenarios/imaging_faults.toml",
    "scenarios/three_heads.toml",
}


def shipped():
    """Paths of all benches and scenarios below configs/, in order."""
    configs = ROOT / "configs"
    found = sorted(configs.glob("benches/*.toml")) + sorted(configs.glob("scenarios/*.toml"))
    names = [path.relative_to(configs).as_posix() for path in found]
    return [name for name in names if name not in OUTSIDE]


def crc32_of(paths):
    """CRC-32 of the bytes of files, one after another, as eight hexadecimal digits."""
    crc = 0
    for path in paths:
        crc = zlib.crc32(path.read_bytes(), crc)
    return f"{crc:08x}"


def pixels_of(tables):
    """CRC-32 of the frames' own CRC-32, one line each, over all tables of frames."""
    crc = 0
    for table in tables:
        with table.open(newline="") as lines:
            for row in csv.DictReader(lines):
                crc = zlib.crc32(f"{row['frame']} {row['pixel_crc32']}\n".encode(), crc)
    return f"{crc:08x}"


def golden():
    """Rows of the golden table by file."""
    with TABLE.open(newline="") as lines:
        return {row["file"]: row for row in csv.DictReader(lines)}


def fly(binary, name, *options):
    """One row of the table: flies a file in a folder of its own and takes the CRCs."""
    with tempfile.TemporaryDirectory() as folder:
        return fly_in(pathlib.Path(folder), binary, name, *options)


def fly_in(folder, binary, name, *options):
    """As `fly`, in this folder, which keeps the run's files."""
    is_scenario = name.startswith("scenarios/")
    command = [binary, "run", str(ROOT / "configs" / name), "--clock", "virtual", "--backend", "cpu", *options]
    command += ["--out", str(folder / "out")]
    duration = ""
    if is_scenario:
        command += ["--json"]
    else:
        duration = str(DURATION_S.get(name, DEFAULT_DURATION_S))
        command += ["--duration", duration, "--sink", "recorder"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    row = {"file": name, "duration_s": duration, "subset": "yes" if name in SUBSET else ""}
    tables = sorted((folder / "out").rglob("frames.csv")) if (folder / "out").exists() else []
    if done.returncode not in (0, 3, 6) or not (tables or is_scenario):
        why = [line for line in done.stderr.splitlines() if line.startswith("starloop: ")] or ["no message"]
        words = re.sub(r"\S*/\S*", "FILE", why[-1].removeprefix("starloop: ")).replace(",", "").split()
        return row | {"frames": "refused", "records": " ".join(words[:12]), "telemetry": f"exit {done.returncode}"}
    records = sorted(path for path in (folder / "out").rglob("*.csv"))
    row |= {"frames": pixels_of(tables), "records": crc32_of(records), "telemetry": ""}
    if is_scenario:
        report = json.loads(done.stdout.strip().splitlines()[-1])
        row |= {"frames": "+".join(report["frames_crc32"]), "telemetry": report["telemetry_crc32"]}
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", default=str(ROOT / "target" / "release" / "starloop"), help="the program to fly")
    parser.add_argument("--subset", action="store_true", help="only the rows of continuous integration")
    parser.add_argument("--only", action="append", help="only this file, such as benches/moon.toml; may be repeated")
    parser.add_argument("--write", action="store_true", help="write the table instead of comparing with it")
    options = parser.parse_args()
    names = [name for name in shipped() if not options.subset or name in SUBSET]
    if options.only:
        names = [name for name in names if name in options.only]
    if not names:
        sys.exit(f"no such file: wanted one of {', '.join(shipped())}")
    wanted = {} if options.write else golden()
    rows, different = [], 0
    for name in names:
        begin = time.monotonic()
        row = fly(str(pathlib.Path(options.binary).resolve()), name)
        rows.append(row)
        is_equal = options.write or row == wanted.get(name)
        different += not is_equal
        verdict = "written" if options.write else "equal" if is_equal else f"DIFFERENT, wanted {wanted.get(name)}"
        took = time.monotonic() - begin
        print(f"{name:42} {took:6.1f} s  {row['frames']} {row['records']} {row['telemetry']}  {verdict}", flush=True)
    if options.write:
        with TABLE.open("w", newline="") as lines:
            table = csv.DictWriter(lines, COLUMNS, lineterminator="\n")
            table.writeheader()
            table.writerows(rows)
    print(f"{len(rows)} files flown, {different} different")
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
