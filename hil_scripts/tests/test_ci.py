"""The jobs of the guide's page on continuous integration, run as a server would: python3 hil_scripts/tests/test_ci.py

The commands come from src/guide/ci.md, with the files that it says to commit; commands that install are left out, and the
program under test is `starloop` on the PATH. The CRC of the page is that of one version and vector level: on that level the
job passes with the page's own file. Where the file of expected CRCs differs, the job must fail and print the line to add, and
with that line it must pass. Controls: a tightened limit ends the job, with its files for the server in place; one digit of
the page's CRC changed ends it; a job without a command that installs is refused. Needs PyYAML (requirements.txt).
"""

import os
import re
import subprocess
import unittest
import xml.etree.ElementTree as xml

import yaml

from support import PROGRAM, ROOT, InAFolder, starloop

PAGE = ROOT / "src/guide/ci.md"
INSTALLS = re.compile(r"\b(apt-get|curl|dpkg|sha256sum)\b")
FLIES = "starloop run"
PATIENCE_S = 120.0
#: Invariants that a bench with a fault has something to check for: all hold.
INVARIANTS = {
    "invariant: each scheduled frame is delivered or dropped": False,
    "invariant: each fault hits something": False,
}


def blocks(page, mark):
    """Returns the marked blocks of the page by their names."""
    found = re.findall(rf"^<!-- {mark}: (\S+) -->\n```\w+\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    return dict(found)


def github(text):
    """Returns the scripts of the job's steps, and the paths that it keeps."""
    (job,) = yaml.safe_load(text)["jobs"].values()
    if job["defaults"]["run"]["shell"] != "bash":
        raise AssertionError("a pipe would hide a failure")
    (kept,) = [step for step in job["steps"] if "upload-artifact" in step.get("uses", "")]
    if kept["if"] != "always()":
        raise AssertionError("a job that failed would keep nothing")
    return [step["run"] for step in job["steps"] if "run" in step], kept["with"]["path"].split()


def gitlab(text):
    """Returns the scripts of the job, and the paths that it keeps."""
    (job,) = yaml.safe_load(text).values()
    kept = job["artifacts"]
    if kept["when"] != "always" or kept["reports"]["junit"] not in kept["paths"]:
        raise AssertionError("a job that failed would keep nothing")
    return ["\n".join(job["before_script"]), "\n".join(job["script"])], kept["paths"]


READERS = {"github": github, "gitlab": gitlab}


def cases_of(path):
    """Returns the cases of a JUnit file that were judged: what failed, by group and name."""
    suite = xml.parse(path).getroot().find("testsuite")
    judged = [case for case in suite.findall("testcase") if case.find("skipped") is None]
    return {(case.get("classname"), case.get("name")): case.find("failure") is not None for case in judged}


def without_install(scripts):
    """Returns the scripts that install nothing; a job whose scripts all stay has forgotten to."""
    kept = [script for script in scripts if not INSTALLS.search(script)]
    if len(kept) == len(scripts) or not any(FLIES in script for script in kept):
        raise AssertionError(f"wanted a script that installs and one that flies, got {scripts}")
    return kept


class Jobs(InAFolder):
    def setUp(self):
        super().setUp()
        self.page = PAGE.read_text()
        for name, text in blocks(self.page, "committed").items():
            self.written(name, text)
        tools = self.folder / ".tools"
        tools.mkdir()
        (tools / "starloop").symlink_to(PROGRAM)
        self.environment = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}"}

    def job(self, name):
        """Returns the scripts of a job without those that install, and the paths that it keeps."""
        scripts, kept = READERS[name](blocks(self.page, "job")[name])
        return without_install(scripts), kept

    def run_job(self, name):
        """Runs a job as its server does: status of the first script that fails, all output."""
        said = ""
        for script in self.job(name)[0]:
            done = subprocess.run(
                ["bash", "-eo", "pipefail", "-c", script], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S,
            )  # fmt: skip
            said += done.stdout
            if done.returncode != 0:
                return done.returncode, said
        return 0, said

    def clean(self):
        """Removes what a job wrote: a server begins with a checkout."""
        subprocess.run(["rm", "-rf", "out", "out.txt", "crc.txt"], cwd=self.folder, check=True)

    def expect_this_program(self, name):
        """Has the job name the line of this program, and commits it, as the page says."""
        self.written("expected_crc.txt", "vector level V9\trun CRC-32            00000000\n")
        status, said = self.run_job(name)
        self.assertEqual(status, 1, said)
        found = re.search(r"^not in expected_crc.txt: (vector level V\d+\trun CRC-32 +[0-9a-f]{8})$", said, re.MULTILINE)
        self.assertIsNotNone(found, said)
        self.written("expected_crc.txt", found[1] + "\n")
        self.clean()

    def outcome_with(self, name, crcs):
        """Runs a job with this file of expected CRCs: its status, all output."""
        self.clean()
        self.written("expected_crc.txt", crcs)
        return self.run_job(name)

    def test_the_crc_of_the_page_is_that_of_this_program_and_another_digit_is_not(self):
        line = blocks(self.page, "committed")["expected_crc.txt"]
        found = re.fullmatch(r"vector level (V\d+)\trun CRC-32 +([0-9a-f]{8})\n", line)
        self.assertIsNotNone(found, line)
        level, crc = found.groups()
        wrong = line.replace(crc, crc[:-1] + ("1" if crc[-1] == "0" else "0"))
        for name in READERS:
            with self.subTest(name):
                status, said = self.outcome_with(name, wrong)
                self.assertEqual(status, 1, said)
                here = re.search(r"^not in expected_crc.txt: vector level (V\d+)\t", said, re.MULTILINE)
                self.assertIsNotNone(here, said)
                status, said = self.outcome_with(name, line)
                if here[1] == level:
                    self.assertEqual(status, 0, said)
                    continue
                self.assertEqual(status, 1, said)
                print(f"UNJUDGED: {name}: the page has a line of {level}, this processor is of {here[1]}")

    def cases(self):
        """Returns the cases of the JUnit file that were judged: what failed, by name."""
        return {name: failed for (_, name), failed in cases_of(self.folder / "out/run.xml").items()}

    def test_each_job_passes_and_keeps_what_it_names(self):
        for name in READERS:
            with self.subTest(name):
                self.clean()
                self.expect_this_program(name)
                status, said = self.run_job(name)
                self.assertEqual(status, 0, said)
                self.assertEqual(self.cases(), {"verdict": False, "expect: dropped frames": False, **INVARIANTS})
                for path in self.job(name)[1]:
                    self.assertTrue((self.folder / path).exists(), path)

    def test_a_limit_that_is_not_met_ends_the_job_and_its_files_are_there(self):
        scenario = (self.folder / "ci.toml").read_text()
        self.written("ci.toml", scenario.replace("at_most = 5", "at_most = 4"))
        for name in READERS:
            with self.subTest(name):
                self.clean()
                status, said = self.run_job(name)
                self.assertEqual(status, 4, said)
                self.assertIn("FAILED: ", said)
                self.assertEqual(self.cases(), {"verdict": True, "expect: dropped frames": True, **INVARIANTS})

    def test_other_bits_end_the_job(self):
        self.expect_this_program("gitlab")
        scenario = (self.folder / "ci.toml").read_text()
        self.written("ci.toml", "seed = 2\n" + scenario)
        status, said = self.run_job("gitlab")
        self.assertEqual(status, 1, said)
        self.assertIn("not in expected_crc.txt", said)

    def test_both_jobs_run_the_same_commands(self):
        lines = {name: [line.strip() for script in self.job(name)[0] for line in script.splitlines()] for name in READERS}
        self.assertEqual(lines["github"], lines["gitlab"])

    def test_a_job_that_installs_nothing_is_refused(self):
        with self.assertRaises(AssertionError):
            without_install(["starloop run ci.toml"])
        with self.assertRaises(AssertionError):
            without_install(["dpkg -i a.deb", "starloop check ci.toml"])
        self.assertEqual(without_install(["dpkg -i a.deb", "starloop run ci.toml"]), ["starloop run ci.toml"], "control")


class OtherCommands(InAFolder):
    def test_a_replay_has_cases_for_each_head_and_another_crc_is_a_failure(self):
        captured, file = self.folder / "captured", self.folder / "replay.xml"
        starloop("run", "--clock", "virtual", "--duration", "1", "--sink", "null", "--capture", captured, status=0)
        starloop("replay", captured, "--junit", file, status=0)
        bits, whole = ("head 0", "frames are bit-identical"), ("head 0", "every frame is compared")
        self.assertEqual(cases_of(file), {bits: False, whole: False})
        table = captured / "frames.csv"
        crc = table.read_text().splitlines()[3].split(",")[6]
        table.write_text(table.read_text().replace(crc, crc[:-1] + ("1" if crc[-1] == "0" else "0")))
        starloop("replay", captured, "--junit", file, status=4)
        self.assertEqual(cases_of(file), {bits: True, whole: False}, "control")

    def test_a_campaign_has_cases_for_each_episode_and_a_broken_invariant_is_a_failure(self):
        text = (ROOT / "configs/scenarios/campaign.toml").read_text().replace('"../', f'"{ROOT}/configs/')
        text = text.replace("duration_s = 3600.0", "duration_s = 1400.0")
        for arcsec, is_broken in [("300.0", False), ("1e-4", True)]:
            file = self.folder / "campaign.xml"
            scenario = self.written("episodes.toml", text.replace("recovered_arcsec = 300.0", f"recovered_arcsec = {arcsec}"))
            words = ["campaign", scenario, "--hours", "0.7", "--seed", "7", "--junit", file]
            starloop(*words, status=4 if is_broken else 0)
            cases = cases_of(file)
            self.assertEqual({seed for seed, _ in cases}, {"seed 7", "seed 8"})
            self.assertEqual(cases["seed 7", "invariant: on target at the end"], is_broken)
            self.assertFalse(cases["seed 7", "invariant: each scheduled frame is delivered or dropped"])

    def test_a_file_that_cannot_be_written_is_known_before_a_campaign_flies(self):
        said = starloop("campaign", "--hours", "1000", "--junit", self.folder / "nowhere" / "a.xml", status=1)
        self.assertIn("--junit", said.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
