"""The first page and the recipes, step by step as they are written: python3 hil_scripts/tests/test_recipes.py

Marks, each on the line above its fenced block (tests/conformance/commands.rs runs the blocks marked `<!-- test -->`):

    <!-- test in a shell -->     the `$ ` lines are commands of bash, which stops at the first one that fails
    <!-- file: NAME -->          the block is the content of that file
    <!-- afterwards: COMMAND --> ends with 0 when what the recipe promises is there; a line of its own, no block

A recipe is a section (`## `) of a page with such marks. It runs in an empty folder that has the repository's `configs` and
`hil_scripts`, with the program as `starloop` on the PATH, and PYTHONPATH as the page sets it. Controls: each check fails
in a folder where nothing was run, and a recipe with a wrong command is refused.

STARLOOP_BINARY names the program (default target/release/starloop); STARLOOP_SHARE the folder of an installed package
(/usr/share/starloop), whose `configs` and `python` are used in place of the repository's. Needs requirements*.txt, and curl.
"""

import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from typing import NamedTuple

from support import PROGRAM, ROOT

SHARE = os.environ.get("STARLOOP_SHARE")
FOLDERS = {"configs": f"{SHARE}/configs", "hil_scripts": f"{SHARE}/python"} if SHARE else {}
PAGES = ["README.md"] + sorted(str(path.relative_to(ROOT)) for path in (ROOT / "src/guide").glob("*.md"))
RECIPES_MIN = 14
"""The first page, the twelve commonest tasks, and other pages."""
PATIENCE_S = 300.0
SHELL, FILE, AFTERWARDS = "<!-- test in a shell -->", "<!-- file: ", "<!-- afterwards: "


class Step(NamedTuple):
    """A file to write, or commands to run, in the order of the page."""

    kind: str
    name: str
    text: str


class Recipe(NamedTuple):
    """A section of a page."""

    title: str
    steps: list
    checks: list


def commands(block):
    """Returns the `$ ` lines of a block without their prompt, with the lines that continue them."""
    kept, is_continued = [], False
    for line in block:
        if is_continued or line.startswith("$ "):
            kept.append(line if is_continued else line[2:])
            is_continued = line.endswith("\\")
    return "\n".join(kept) + "\n"


def recipes(page, text):
    """Returns the sections of a page, and what is before the first one, where they have a marked block."""
    found, title, mark = [], "", ""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(("# ", "## ")):
            title, mark = f"{page}: {line.lstrip('# ')}", ""
            found.append(Recipe(title, [], []))
        elif line.startswith("```"):
            block = []
            for inner in lines:
                if inner == "```":
                    break
                block.append(inner)
            if mark == SHELL:
                found[-1].steps.append(Step("commands", "", commands(block)))
            elif mark.startswith(FILE):
                found[-1].steps.append(Step("file", mark[len(FILE) : -len(" -->")], "\n".join(block) + "\n"))
            mark = ""
        elif line.startswith(AFTERWARDS):
            found[-1].checks.append(line[len(AFTERWARDS) : -len(" -->")])
        else:
            mark = line.strip() or mark
    return [recipe for recipe in found if recipe.steps]


def prepared(folder, recipe):
    """Makes what a reader has before the first command, and the recipe's files; returns the environment of the commands."""
    folder = Path(folder)
    for step in recipe.steps:
        if step.kind == "file":
            (folder / step.name).write_text(step.text)
    for name in ("configs", "hil_scripts"):
        (folder / name).symlink_to(FOLDERS.get(name, ROOT / name))
    tools = folder / ".tools"
    tools.mkdir()
    (tools / "starloop").symlink_to(PROGRAM)
    # Not a link: an environment's Python finds its packages by the path that it was called by.
    python = tools / "python3"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    path = f"{tools}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "PYTHONPATH": str(folder / "hil_scripts"), "PYTHONDONTWRITEBYTECODE": "1"}


def bash(script, folder, environment):
    """Runs a script in a folder; gives its exit status and what it printed."""
    command = ["timeout", str(PATIENCE_S), "bash", "-euo", "pipefail", "-c", script]
    done = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return done.returncode, done.stdout


def fault_of(recipe):
    """Follows a recipe in a folder of its own; returns what went wrong, or nothing."""
    with tempfile.TemporaryDirectory(prefix="starloop_recipe_") as folder:
        environment = prepared(folder, recipe)
        script = [step.text for step in recipe.steps if step.kind != "file"]
        status, said = bash("".join(script), folder, environment)
        if status != 0:
            return f"{recipe.title}: status {status}\n{''.join(script)}\n{said[-3000:]}"
        for check in recipe.checks:
            status, more = bash(check, folder, environment)
            if status != 0:
                return f"{recipe.title}: afterwards `{check}` gives {status}\n{more}\n{said[-3000:]}"
    return ""


ALL = [recipe for page in PAGES for recipe in recipes(page, (ROOT / page).read_text())]


class Pages(unittest.TestCase):
    def test_there_are_recipes_and_each_has_a_check(self):
        self.assertGreaterEqual(len(ALL), RECIPES_MIN)
        self.assertEqual([recipe.title for recipe in ALL if not recipe.checks], [])
        self.assertIn("README.md", {recipe.title.split(":")[0] for recipe in ALL})

    def test_a_check_fails_where_nothing_was_run(self):
        for recipe in ALL:
            with self.subTest(recipe.title), tempfile.TemporaryDirectory() as folder:
                environment = prepared(folder, recipe)
                for check in recipe.checks:
                    self.assertNotEqual(bash(check, folder, environment)[0], 0, check)

    def test_a_wrong_command_and_a_broken_promise_are_found(self):
        page = "## A\n<!-- file: a.txt -->\n```text\none\n```\n<!-- test in a shell -->\n```console\n$ cp a.txt \\\n    b.txt\n```\n"
        (right,) = recipes("page", page + "<!-- afterwards: grep -q one b.txt -->\n")
        self.assertEqual(fault_of(right), "", "control")
        (broken,) = recipes("page", page + "<!-- afterwards: grep -q two b.txt -->\n")
        self.assertIn("afterwards", fault_of(broken))
        (wrong,) = recipes("page", page.replace("cp a.txt", "cp c.txt"))
        self.assertIn("status 1", fault_of(wrong))
        self.assertEqual(recipes("page", "## A\n```console\n$ false\n```\n"), [], "a block without a mark is not run")


def follows(recipe):
    def test(self):
        fault = fault_of(recipe)
        self.assertEqual(fault, "", fault)

    return test


class Recipes(unittest.TestCase):
    """Has a test for each recipe."""


for _recipe in ALL:
    setattr(Recipes, "test_" + re.sub(r"\W+", "_", _recipe.title).strip("_").lower(), follows(_recipe))


if __name__ == "__main__":
    unittest.main(verbosity=2)
