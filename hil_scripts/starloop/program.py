"""The program that comes with the package, for reports that it prints as JSON."""

from __future__ import annotations

import json
import pathlib
import shutil
import subprocess
import sys
import sysconfig
from typing import Any, Dict, List, Sequence

NOT_MET = 4
"""Exit status of a program whose report says that something is not as stated."""


def path() -> str:
    """Returns the path of the program: beside this Python, or on PATH. Raises FileNotFoundError."""
    beside = [pathlib.Path(sysconfig.get_path("scripts")), pathlib.Path(sys.executable).parent]
    for folder in beside:
        if (folder / "starloop").is_file():
            return str(folder / "starloop")
    found = shutil.which("starloop")
    if found is None:
        raise FileNotFoundError("the program starloop is not installed beside this Python and not on PATH; install the wheel")
    return found


def report(command: str, file: str, options: Sequence[str]) -> Dict[str, Any]:
    """Returns what a command prints about a file with --json. Raises ValueError with its message."""
    words: List[str] = [path(), command, file, *options, "--json"]
    done = subprocess.run(words, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode not in (0, NOT_MET):
        raise ValueError(done.stderr.strip().removeprefix("starloop: "))
    answer: Dict[str, Any] = json.loads(done.stdout)
    return answer
