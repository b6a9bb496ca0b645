"""The pages of the guide begin with what to copy, a command, its verdict and its time: python3 hil_scripts/tests/test_in_short.py

Which pages: those that README's table "I have" leads to, but for references, and each page that has such a block. It is
near the top, below a line `<!-- in short: STATUSES -->`: a transcript whose `$ ` lines are commands of bash, with their
exit statuses in order (`0|3`: either), and whose other lines are lines of what the command printed, in that order; `...`
is any text. A command with `|` in its status depends on how busy the machine is: its lines count where the status is the
first one. In front of the block are the words "Copy" and "takes", and a time in seconds.

The commands of a page run in one folder that has the repository's `configs` and `hil_scripts`, the files that the recipes
and README write (`<!-- file: NAME -->`) and those of the page itself (`<!-- committed: NAME -->`). Controls: another
verdict, another status, a page without a block and one without a time are found. Needs requirements_flight_computer.txt.
"""

import re
import tempfile
import unittest
from pathlib import Path
from typing import NamedTuple

from support import ROOT
from test_recipes import bash, prepared, Recipe, Step

GUIDE = ROOT / "src/guide"
#: Pages to look things up in.
REFERENCES = {"keys.md", "how_errors_are_bounded.md"}
BLOCK = re.compile(r"^<!-- in short: ([0-9| ]+) -->\n```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILES = re.compile(r"^<!-- (?:committed|file): (\S+) -->\n```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TIME = re.compile(r"\btakes? \d+ s\b")
#: Most lines in front of the block.
LINES_MAX = 36


class Command(NamedTuple):
    """A command, its exit statuses, and lines that it prints."""

    text: str
    statuses: list
    lines: list


def pages_of_the_table(readme):
    """Returns the pages of the guide that README's table leads to."""
    section = readme.split("\n## I have", 1)[1].split("\n## ", 1)[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    return set(re.findall(r"\]\(src/guide/(\w+\.md)", "\n".join(rows))) - REFERENCES


def commands_of(statuses, transcript):
    """Returns the commands of a transcript."""
    found, is_continued = [], False
    for line in transcript.splitlines():
        if line.startswith("$ "):
            found.append(Command(line[2:], [], []))
        elif is_continued:
            found[-1] = found[-1]._replace(text=f"{found[-1].text}\n{line}")
        else:
            found[-1].lines.append(line)
        is_continued = line.endswith("\\") and (is_continued or line.startswith("$ "))
    given = [[int(one) for one in word.split("|")] for word in statuses.split()]
    if len(given) != len(found):
        raise AssertionError(f"{len(found)} commands, {len(given)} statuses")
    return [command._replace(statuses=statuses) for command, statuses in zip(found, given)]


def is_line(wanted, printed):
    return re.fullmatch(".*".join(map(re.escape, wanted.split("..."))), printed) is not None


def first_difference(wanted, printed):
    """Returns the first line that was not printed behind the one before; `None` when all were."""
    rest = iter(printed.splitlines())
    return next((line for line in wanted if not any(is_line(line, other) for other in rest)), None)


def faults_of_form(name, page):
    """Returns what is missing at the head of a page."""
    found = BLOCK.search(page)
    if not found:
        return [f"{name}: no command with its verdict"]
    head = page[: found.start()]
    far = [f"{name}: {LINES_MAX} lines in front of the command at most"] if head.count("\n") > LINES_MAX else []
    words = [("what to copy", re.compile(r"\bCopy\b")), ("its time, such as: takes 3 s", TIME)]
    flat = head.replace("\n", " ")
    return far + [f"{name}: {what} is missing" for what, wanted in words if not wanted.search(flat)]


def missing_files(page):
    """Returns the files of the repository that the head names and that do not exist."""
    head = page[: BLOCK.search(page).start()]
    return [path for path in re.findall(r"`(configs/[\w/.]+)`", head) if not (ROOT / path).exists()]


def fault_of(name, page, shared):
    """Follows the head of a page; returns what went wrong, or nothing."""
    statuses, transcript = BLOCK.search(page).groups()
    steps = [Step("file", *file) for file in (shared | dict(FILES.findall(page))).items()]
    with tempfile.TemporaryDirectory(prefix="starloop_in_short_") as folder:
        environment = prepared(folder, Recipe(name, steps, []))
        for command in commands_of(statuses, transcript):
            status, said = bash(command.text, folder, environment)
            if status not in command.statuses:
                return f"{name}: status {status}, wanted {command.statuses}\n{command.text}\n{said[-3000:]}"
            if len(command.statuses) > 1 and status != command.statuses[0]:
                print(f"UNJUDGED: {name}: status {status} on a busy machine: {command.text}")
                continue
            difference = first_difference(command.lines, said)
            if difference is not None:
                return f"{name}: not printed: {difference}\n{command.text}\n{said[-3000:]}"
    return ""


README = (ROOT / "README.md").read_text()
PAGES = {path.name: path.read_text() for path in sorted(GUIDE.glob("*.md"))}
WANTED = pages_of_the_table(README) | {name for name, page in PAGES.items() if BLOCK.search(page)}
SHARED = dict(FILES.findall(README) + FILES.findall(PAGES["recipes.md"] + PAGES["more_recipes.md"]))


class Heads(unittest.TestCase):
    def test_each_page_says_what_to_copy_the_command_and_its_time(self):
        self.assertGreater(len(WANTED), 15)
        faults = [fault for name in sorted(WANTED) for fault in faults_of_form(name, PAGES[name])]
        self.assertEqual(faults, [])

    def test_the_files_to_copy_exist(self):
        self.assertEqual({name: missing for name in WANTED if (missing := missing_files(PAGES[name]))}, {})

    def test_missing_parts_are_found(self):
        page = "# A\n\nCopy `configs/a.toml`. It takes 1 s.\n\n<!-- in short: 0 -->\n```console\n$ echo one\none\n```\n"
        self.assertEqual(faults_of_form("a", page), [], "control")
        self.assertEqual(missing_files(page), ["configs/a.toml"])
        for right, wrong in [("Copy", "Take"), ("1 s", "a while"), ("in short", "other"), ("# A\n", "# A\n" + "\n" * 40)]:
            self.assertEqual(len(faults_of_form("a", page.replace(right, wrong, 1))), 1, right)

    def test_another_verdict_and_another_status_are_found(self):
        page = "<!-- in short: 0 4 -->\n```console\n$ echo ok: 3 of 3 \\\n    frames, seed 1\nok: 3 of 3 ..., seed 1\n$ exit 4\n```\n"
        self.assertEqual(fault_of("a", page, {}), "", "control")
        self.assertIn("not printed: ok: 4", fault_of("a", page.replace("ok: 3 of 3 ...", "ok: 4 of 4 ..."), {}))
        self.assertIn("status 4, wanted [0]", fault_of("a", page.replace("0 4", "0 0"), {}))
        with self.assertRaises(AssertionError):
            fault_of("a", page.replace("0 4", "0"), {})
        self.assertEqual(first_difference(["b", "a"], "a\nb\n"), "a", "another order")


def follows(name):
    def test(self):
        fault = fault_of(name, PAGES[name], SHARED)
        self.assertEqual(fault, "", fault)

    return test


class Pages(unittest.TestCase):
    """Has a test for each page."""


for _name in sorted(WANTED):
    setattr(Pages, f"test_{_name.removesuffix('.md')}", follows(_name))


if __name__ == "__main__":
    unittest.main(verbosity=2)
