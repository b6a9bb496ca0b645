#!/usr/bin/env python3
"""Measures what an edit costs: unit tests of each crate, and the program, rebuilt after one item of that crate is new.

    hil_scripts/measure/build_times.py               every crate, then the means
    hil_scripts/measure/build_times.py --cold        first the program from nothing, in a folder of its own
    hil_scripts/measure/build_times.py --only link   one crate; may be repeated
    hil_scripts/measure/build_times.py --profile dev another profile of cargo than release

The machine should be idle. Each command runs once before it is measured; then a function is added to the crate's lib.rs, the
command is timed, and the file is put back with its old time, so that cargo does not build the crates above it again. At the end each
file gets a new time: the next build has no added function. Times are wall seconds.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

from page import ROOT

EDIT = "\n/// Added by a measurement.\npub fn measured_edit() -> u32 {{\n    {}\n}}\n"


def crates():
    """The lib.rs of every crate below src/ that has unit tests, and of the root package."""
    manifests = [path for path in sorted((ROOT / "src").glob("*/Cargo.toml")) if "\ntest = false" not in path.read_text()]
    found = {path.parent.name: path.parent / "lib.rs" for path in manifests}
    return found | {"starloop": ROOT / "src" / "lib.rs"}


def cargo(*arguments, target=None):
    """Runs cargo and returns the seconds that it took; ends the program when it fails."""
    environment = dict(os.environ)
    if target:
        environment["CARGO_TARGET_DIR"] = target
    begin = time.monotonic()
    done = subprocess.run(["cargo", *arguments], cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"cargo {' '.join(arguments)}: exit {done.returncode}\n{done.stderr[-2000:]}")
    return time.monotonic() - begin


def after_edit(path, number, *arguments):
    """Seconds of one cargo command after an item was added to a file."""
    text, times = path.read_text(), path.stat()
    try:
        path.write_text(text + EDIT.format(number))
        return cargo(*arguments)
    finally:
        path.write_text(text)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cold", action="store_true", help="measure a build from nothing first")
    parser.add_argument("--only", action="append", help="only this crate; may be repeated")
    parser.add_argument("--profile", default="release", help="profile of cargo, default release")
    options = parser.parse_args()
    chosen = {name: path for name, path in crates().items() if not options.only or name in options.only}
    if not chosen:
        sys.exit(f"no such crate: wanted one of {', '.join(crates())}")
    chosen_profile = ["--locked", "--profile", options.profile]
    if options.cold:
        with tempfile.TemporaryDirectory(dir=ROOT) as folder:
            print(f"cold build of the program: {cargo('build', *chosen_profile, target=folder):.0f} s", flush=True)
    print("| crate | unit tests after an edit, s | of that running, s | program after an edit, s |\n|---|---|---|---|")
    rows = []
    build = ["build", *chosen_profile]
    cargo(*build)
    try:
        for name, path in chosen.items():
            test = ["test", *chosen_profile, "-p", name if name == "starloop" else f"starloop_{name}", "--lib"]
            cargo(*test)
            running = cargo(*test)
            unit = after_edit(path, 1, *test)
            program = after_edit(path, 2, *build)
            rows.append((unit, program))
            print(f"| `{name}` | {unit:.0f} | {running:.0f} | {program:.0f} |", flush=True)
    finally:
        for path in chosen.values():
            path.touch()
    means = [sum(column) / len(rows) for column in zip(*rows)]
    print(f"| mean | {means[0]:.0f} | | {means[1]:.0f} |")


if __name__ == "__main__":
    main()
