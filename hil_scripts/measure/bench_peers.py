#!/usr/bin/env python3
"""Speed and error of starloop beside other programs, on the same scenes, in one run.

    python3 hil_scripts/measure/bench_peers.py --install            # peers from PyPI into an environment of its own, then all scenes
    python3 hil_scripts/measure/bench_peers.py --quick              # a few scenes with the peers that this Python has
    python3 hil_scripts/measure/bench_peers.py --guide              # all scenes; table and chart go into the guide

Every scene is a list of places in pixels and electrons, and a path of positions; starloop draws it with `starloop render --sources`,
and its f64 reference is the truth. Time: median of several draws after a warm-up, in one process per program; files, start and
what a peer prepares once are not in it. Error: sum of the differences over the sum of the reference (L1). Each image must be of the
same scene: total flux and every pixel; as a control, every peer draws one scene with its brightest star one pixel off, and that
must be found. --out has peers.csv, peers.md and peers.svg.
"""

import argparse
import csv
import dataclasses
import pathlib
import subprocess
import sys
import tempfile

from page import ROOT, put_between

REQUIREMENTS = ROOT / "hil_scripts" / "requirements_peers.txt"
PAGE = ROOT / "src" / "guide" / "speed_beside_others.md"
MARKS = ("<!-- table of bench_peers.py -->", "<!-- end of the table -->")


def install(folder):
    """Makes the environment of the peers, where it is not there yet, and runs this script in it."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    for line in REQUIREMENTS.read_text().splitlines():
        # One by one: a peer that cannot be installed here is a blank cell, not the end.
        if line.strip() and not line.startswith("#"):
            subprocess.run([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", line], check=False)
    arguments = [word for word in sys.argv[1:] if word != "--install"]
    raise SystemExit(subprocess.run([python, __file__, *arguments], check=False).returncode)


def measure(chosen):
    """Draws all scenes, writes the reports, and returns the exit status."""
    from peers_contest import Row, hold  # not above: what installs numpy runs without it
    from peers_report import markdown, svg

    chosen.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        contest = hold(pathlib.Path(name), chosen.quick, chosen.limit_s)
    with open(chosen.out / "peers.csv", "w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in dataclasses.fields(Row)])
        table.writeheader()
        table.writerows(dataclasses.asdict(row) for row in contest.rows)
    text, chart = markdown(contest.rows, contest.facts()), svg(contest.rows)
    (chosen.out / "peers.md").write_text(text)
    (chosen.out / "peers.svg").write_text(chart)
    if chosen.guide:
        put_between(PAGE, MARKS, text)
        (PAGE.parent / "speed_beside_others.svg").write_text(chart)
    return 1 if any(row.reason.startswith("another scene") for row in contest.rows) else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--install", action="store_true", help="install the peers into an environment of their own first")
    parser.add_argument("--environment", type=pathlib.Path, default=ROOT / "target" / "peers")
    parser.add_argument("--quick", action="store_true", help="a few scenes, under a minute")
    parser.add_argument("--guide", action="store_true", help="put table and chart into the guide")
    parser.add_argument("--limit-s", type=float, default=8.0, help="a drawing that would take longer is left out")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "target" / "bench_peers")
    chosen = parser.parse_args()
    if chosen.install:
        install(chosen.environment)
    return measure(chosen)


if __name__ == "__main__":
    sys.exit(main())
