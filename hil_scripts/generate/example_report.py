"""Makes the example report of src/guide/reports.md: example_report.py [FOLDER, default .pictures]

cedar-solve flies configs/test_plans/ecss_star_tracker_short.toml. STARLOOP_BINARY names the program (default
target/release/starloop); cedar-solve has the environment of test_tracker_report.py. Standard library only.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support import BINARY, ROOT, TARGET
from test_tracker_report import MOST_BYTES, PLAN, cedar_python

TRACKER = ["python3", "../../hil_scripts/tests/cedar_tracker.py", "{frames}", "{camera}", "{log}", "--aberration"]
"""Relative to the plan's folder: the report names no folder of this machine."""


def fly(folder):
    """Flies the plan by commands that are found on the PATH; returns the report."""
    shutil.rmtree(folder, ignore_errors=True)
    programs = [str(Path(BINARY).resolve().parent), str(cedar_python().absolute().parent), os.environ["PATH"]]
    command = ["starloop", "fly", str(PLAN.relative_to(ROOT)), "--out", os.path.relpath(folder, ROOT), "--quiet"]
    tracker = ["--tracker-name", "cedar-solve 0.5.1", "--tracker-command", *TRACKER]
    environment = {**os.environ, "PATH": os.pathsep.join(programs)}
    done = subprocess.run([*command, *tracker], cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 4):
        sys.exit(f"status {done.returncode}\n{done.stderr}")
    print(done.stdout.splitlines()[0])
    return folder / "report.html"


def main():
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / ".pictures"
    report = fly(TARGET / "example_report")
    if report.stat().st_size > MOST_BYTES:
        sys.exit(f"{report}: more than {MOST_BYTES} bytes")
    shutil.copyfile(report, out / "tracker_report_cedar_solve.html")


if __name__ == "__main__":
    main()
