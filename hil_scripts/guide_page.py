"""Generated parts of guide pages, and the machine that they were measured on: from guide_page import machine, put_between"""

import os
import pathlib
import re


def machine():
    """Returns the cores that this process may use, and the name of their processor."""
    path = pathlib.Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*:\s*(.*)", path.read_text() if path.exists() else "") or ["unknown processor"]
    return f"{len(os.sched_getaffinity(0))} cores of {names[0]}"


def put_between(path, marks, text):
    """Replaces the part of a page between two marks."""
    before, rest = path.read_text().split(marks[0])
    after = rest.split(marks[1])[1]
    path.write_text(f"{before}{marks[0]}\n\n{text}\n{marks[1]}{after}")
