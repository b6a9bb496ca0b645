"""Makes the example reports of src/guide/reports.md: example_reports.py [FOLDER, default .pictures]

The built-in tracker and cedar-solve fly configs/test_plans/ecss_star_tracker_short.toml. STARLOOP_BINARY names the program
(default target/release/starloop); cedar-solve has the environment of test_tracker_report.py. Standard library only.
"""

import shutil
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

from test_tracker_report import CEDAR, MOST_BYTES, PLAN, ROOT, cedar_python, starloop


def main():
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / ".pictures"
    cedar = [cedar_python(), CEDAR, "{frames}", "{camera}", "{log}", "--aberration"]
    trackers = {
        "built_in": [],
        "cedar_solve": ["--tracker-name", "cedar-solve 0.5.1", "--tracker-command", *cedar],
    }
    for name, arguments in trackers.items():
        with tempfile.TemporaryDirectory(prefix=name) as folder:
            flown = Path(folder) / "flown"
            print(starloop("fly", PLAN, "--out", flown, "--quiet", *arguments).stdout.splitlines()[0])
            report = flown / "report.html"
            if report.stat().st_size > MOST_BYTES:
                sys.exit(f"{report}: more than {MOST_BYTES} bytes")
            shutil.copyfile(report, out / f"tracker_report_{name}.html")


if __name__ == "__main__":
    main()
