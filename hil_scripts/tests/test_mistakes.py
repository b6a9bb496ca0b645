"""Tests that each usual mistake gets a good message: python3 hil_scripts/tests/test_mistakes.py

A rule of one key is broken in a unit test beside it. Here are mistakes that need the program: its files, exit status,
devices, sockets, a shell. The tables in mistakes/ have one row for each mistake: files and a command, the exit status, and
what the message says: what is wrong, where, what was wanted, what was given, and how to repair it.
`test_mistakes.py --show [WORD...]` prints the messages of the rows whose names have all the words.

A row has:

  name      what the user does
  bench     text of bench.toml; also scenario, camera, link, spacecraft: their text; the command is then `check FILE`, or `snr`
            for a camera
  files     further files: name = "text"; {{configs}} is the folder of shipped configurations, {{NAME}} a text of [base]
  prepare   commands of bash that come first
  run       arguments of starloop in place of the command above, or shell: a command of bash
  requests  lines to the control socket of `starloop run RUN`; the message is the last answer's error
  exit      the exit status, 1 when left out
  line      the line of the file that the message names
  has       texts of the message
  lacks     texts that the message must not have
"""

import concurrent.futures
import json
import os
import re
import shlex
import socket
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

from support import BINARY, ROOT, Running

TABLES = Path(__file__).resolve().parent / "mistakes"
LEAST_ROWS = 190
LIMIT_S = 60
KINDS = {"bench": "check", "scenario": "check", "camera": "snr", "link": "check", "spacecraft": "check"}
KEYS = {"name", "files", "prepare", "run", "shell", "requests", "exit", "line", "has", "lacks"} | set(KINDS)

# Nothing of this is in a message for people: it is the program's inside, or the Rust library's own words.
NEVER = {
    "a panic": r"panicked|RUST_BACKTRACE|stack backtrace|thread '[^']*' ",
    "a debug form": r"\bSome\(|\bOk\(|\bErr\(|\b[A-Z][A-Za-z]+ \{ [a-z_]+: |\bOs \{|\bcode: \d+, kind:|\b[A-Z]\w+\((?:\"|Some)",
    "a place in the source": r"\b[\w/.-]+\.rs:\d+|\.cargo/registry",
    "words of the Rust library": r"invalid float literal|invalid digit found|cannot parse \w+ from empty|"
    r"stream did not contain valid UTF-8|provided string was not|number too (?:large|small) to fit|failed to fill whole buffer|"
    r"invalid utf-8 sequence|\(os error \d+\)|entity not found|invalid socket address",
    "an empty clause": r";\s*$|: *$(?!\n)|\(\)|  wanted |, ,",
}
LONGEST_SENTENCE = 60


def with_texts(text, base):
    for name, piece in base.items():
        text = text.replace("{{" + name + "}}", piece)
    return text.replace("{{configs}}", str(ROOT / "configs"))


def read_table(path):
    table = tomllib.loads(path.read_text())
    base = table.get("base", {})
    for row in table["mistake"]:
        unknown = set(row) - KEYS
        assert not unknown, f"{path.name}: {row['name']}: unknown {unknown}"
        yield {"table": path.stem, "base": base, "exit": 1, "has": [], "lacks": [], **row}


def rows():
    return [row for path in sorted(TABLES.glob("*.toml")) for row in read_table(path)]


def environment(folder):
    names = {"PATH", "VK_DRIVER_FILES", "VK_ICD_FILENAMES", "LD_LIBRARY_PATH"}
    kept = {name: value for name, value in os.environ.items() if name in names}
    home = folder / ".home"
    home.mkdir(exist_ok=True)
    links = folder / ".bin"
    links.mkdir(exist_ok=True)
    (links / "starloop").symlink_to(BINARY)
    kept["PATH"] = f"{links}:{kept.get('PATH', '/usr/bin:/bin')}"
    return kept | {"HOME": str(home), "NO_COLOR": "1", "COLUMNS": "1000", "LC_ALL": "C.UTF-8", "CONFIGS": str(ROOT / "configs")}


def words_of(row):
    """Returns the command of a row, as a list."""
    if "shell" in row:
        return ["bash", "-c", with_texts(row["shell"], row["base"])]
    kind = next((kind for kind in KINDS if kind in row), None)
    arguments = row.get("run") or f"{KINDS[kind]} {kind}.toml"
    return [BINARY, *shlex.split(with_texts(arguments, row["base"]))]


def converse(row, folder, variables):
    """Returns status and last error of the control socket's answers to the requests of a row."""
    with Running(*words_of(row), "--control", "127.0.0.1:0", cwd=folder, env=variables) as program:
        port = int(program.wait_for(r"^control: listening on 127\.0\.0\.1:(\d+)")[1])
        token = program.wait_for("^control: token ([0-9a-f]{16,})")[1]
        with socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S) as connection:
            stream = connection.makefile("rw")
            answer = {}
            for request in row["requests"]:
                stream.write(with_texts(request, row["base"]).replace("{{token}}", token) + "\n")
                stream.flush()
                line = stream.readline()
                answer = json.loads(line) if line else {"ok": False, "error": "(closed)"}
        return int(not answer["ok"]), "", answer.get("error", "(no error)")


def outcome(row):
    """Returns exit status, standard output and standard error of a row."""
    with tempfile.TemporaryDirectory(prefix="mistake_") as name:
        folder = Path(name)
        for file, text in ({f"{kind}.toml": row[kind] for kind in KINDS if kind in row} | row.get("files", {})).items():
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(with_texts(text, row["base"]))
        variables = environment(folder)
        limits = {"cwd": folder, "env": variables, "capture_output": True, "timeout": LIMIT_S, "errors": "replace"}
        if "prepare" in row:
            made = subprocess.run(["bash", "-e", "-c", with_texts(row["prepare"], row["base"])], **limits)
            assert made.returncode == 0, f"prepare: {made.stdout}{made.stderr}"
        if "requests" in row:
            return converse(row, folder, variables)
        done = subprocess.run(words_of(row), stdin=subprocess.DEVNULL, **limits)
        return done.returncode, done.stdout, done.stderr


def sentences(text):
    return re.split(r"[.;:\n]\s", text)


def faults(row, status, output, errors):
    """Returns what is wrong with the message of a row, as a list of texts; an empty list for a good one."""
    found = [] if status == row["exit"] else [f"exit status {status}, wanted {row['exit']}"]
    # A run that began gives its verdict as output.
    message = errors if row["exit"] in (1, 2) else output + errors
    flat = " ".join(message.split())
    found += [f"lacks {text!r}" for text in row["has"] if " ".join(text.split()) not in flat]
    found += [f"has {text!r}" for text in row["lacks"] if text in flat]
    found += [f"has {what}: {hit[0]!r}" for what, form in NEVER.items() if (hit := re.search(form, errors, re.M))]
    if "line" in row:
        kind = next(kind for kind in KINDS if kind in row)
        if not re.search(rf"\b{kind}\.toml:{row['line']}\b", errors):
            found.append(f"does not name {kind}.toml:{row['line']}")
    if row["exit"] in (1, 2) and not errors.strip():
        found.append("says nothing")
    if row["exit"] == 1 and "known here" not in errors:
        found += [f"has a sentence of {n} words" for part in sentences(errors) if (n := len(part.split())) > LONGEST_SENTENCE]
    return found


def judged(row):
    """Returns the faults of a row's message after running it, and the message."""
    try:
        status, output, errors = outcome(row)
    except (AssertionError, subprocess.TimeoutExpired, OSError, ValueError) as problem:
        return [f"did not run: {problem}"], ""
    return faults(row, status, output, errors), f"[{status}] {errors or output[-600:]}"


def run_all(chosen):
    with concurrent.futures.ThreadPoolExecutor(max_workers=2 * (os.cpu_count() or 1)) as pool:
        return list(zip(chosen, pool.map(judged, chosen)))


class Mistakes(unittest.TestCase):
    def test_every_mistake_has_a_good_message(self):
        chosen = rows()
        bad = [
            f"{row['table']}: {row['name']}: {'; '.join(found)}\n    {message.strip()}"
            for row, (found, message) in run_all(chosen)
            if found
        ]
        self.assertEqual(bad, [], "\n" + "\n".join(bad))

    def test_there_are_many_rows_and_each_expects_something(self):
        chosen = rows()
        self.assertGreaterEqual(len(chosen), LEAST_ROWS)
        names = [(row["table"], row["name"]) for row in chosen]
        self.assertEqual(len(names), len(set(names)), "two rows of one name")
        weak = [row["name"] for row in chosen if len(row["has"] + row["lacks"]) + ("line" in row) < 2]
        self.assertEqual(weak, [], "a row names at least two texts of its message, or one and a line")


class Control(unittest.TestCase):
    """A row whose expectation is wrong fails."""

    RIGHT = {
        "table": "control",
        "base": {},
        "name": "a rate of zero",
        "bench": "[timing]\nframe_rate_hz = 0\n",
        "exit": 1,
        "line": 2,
        "has": ["timing.frame_rate_hz is 0", "wanted"],
        "lacks": [],
    }

    def judge(self, **changes):
        return judged(self.RIGHT | changes)[0]

    def test_right_row_passes(self):
        self.assertEqual(self.judge(), [])

    def test_wrong_rows_fail(self):
        self.assertIn("exit status 1, wanted 2", self.judge(exit=2))
        self.assertIn("does not name bench.toml:3", self.judge(line=3))
        self.assertIn("lacks 'timing.frame_rate_hz is 1'", self.judge(has=["timing.frame_rate_hz is 1"]))
        self.assertIn("has 'wanted'", self.judge(lacks=["wanted"]))
        self.assertTrue(self.judge(bench=""), "no mistake")

    def test_what_no_message_may_have_is_noticed(self):
        def seen(text):
            return faults(self.RIGHT | {"has": [], "line": 2}, 1, "", f"bench.toml:2: {text}\n")

        self.assertEqual(seen("timing.frame_rate_hz is 0; wanted above 0"), [])
        for text in (
            "thread 'main' panicked at",
            "wanted Some(3)",
            "Defect { at: 3 }",
            "src/cli/mod.rs:12",
            "invalid float literal",
            "No such file (os error 2)",
            "camera is bad; ",
            "word " * 61,
        ):
            self.assertTrue(seen(text), text)
        self.assertIn("says nothing", faults(self.RIGHT, 1, "", ""))


def show(words):
    for row, (found, message) in run_all([row for row in rows() if all(word in f"{row['table']} {row['name']}" for word in words)]):
        print(f"--- {row['table']}: {row['name']}{'   FAULTS: ' + '; '.join(found) if found else ''}\n{message.strip()}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--show"]:
        show(sys.argv[2:])
    else:
        unittest.main()
