"""Tests of the command line as a person and a script meet it: python3 hil_scripts/tests/test_commands.py

Help on a terminal with and without NO_COLOR, reports as JSON, completions in the shells that there are, manual pages,
doctor.
"""

import json
import os
import pty
import re
import shutil
import subprocess
import unittest

from support import BINARY, CAMERA, PATIENCE_S, ROOT, InAFolder, starloop

VIRTUAL = ("--clock", "virtual", "--duration", "0.3", "--sink", "null")
ESCAPE = b"\x1b["


def without_duplicates(pairs):
    """Returns an object of JSON, whose keys must differ."""
    keys = [key for key, _ in pairs]
    assert len(keys) == len(set(keys)), f"a key is there twice: {keys}"
    return dict(pairs)


class Case(InAFolder):
    def done(self, *words, status=0, **environment):
        return starloop(*words, status=status, cwd=self.folder, timeout=PATIENCE_S, env={**os.environ, **environment})

    def report(self, *words, status=0):
        lines = self.done(*words, "--json", status=status).stdout.splitlines()
        self.assertEqual(len(lines), 1, words)
        return json.loads(lines[0], object_pairs_hook=without_duplicates)

    def on_terminal(self, *words, **environment):
        """Returns the bytes that the program writes to a terminal."""
        main, end = pty.openpty()
        environment = {**{k: v for k, v in os.environ.items() if k != "NO_COLOR"}, "TERM": "xterm", **environment}
        program = subprocess.Popen([BINARY, *words], stdout=end, stderr=end, cwd=self.folder, env=environment)
        os.close(end)
        written = b""
        while True:
            try:
                part = os.read(main, 65536)
            except OSError:
                break
            if not part:
                break
            written += part
        program.wait(timeout=PATIENCE_S)
        os.close(main)
        return written


class Help(Case):
    def test_no_color_is_respected(self):
        for words in (("--help",), ("run", "--help"), ("run", "--no-such-option")):
            self.assertIn(ESCAPE, self.on_terminal(*words), "control: a terminal gets colours or bold letters")
            self.assertNotIn(ESCAPE, self.on_terminal(*words, NO_COLOR="1"), words)
            self.assertNotIn("\x1b", self.done("--help").stdout, "no terminal")

    def test_version_has_commit_features_and_target(self):
        text = self.done("--version").stdout
        self.assertRegex(text, r"^starloop \d+\.\d+\.\d+\ncommit    (unknown|[0-9a-f]{12}(-dirty)?)\nfeatures  ")
        self.assertRegex(self.done("-V").stdout, r"^starloop \d+\.\d+\.\d+ \((unknown|[0-9a-f]{12}(-dirty)?)\)\n$")

    def test_commands_are_below_headings(self):
        text = self.done("--help").stdout
        headings = [line for line in text.splitlines() if re.fullmatch(r"[A-Z][^.]*:", line)]
        self.assertGreater(len(headings), 6, headings)
        self.assertNotIn("Others:", headings)
        self.assertIn("  doctor ", text[text.index("This machine:") :])


class Shells(Case):
    def completions(self, shell):
        path = self.written(f"starloop.{shell}", self.done("completions", shell).stdout)
        return path

    def test_bash_completes_a_command(self):
        path = self.completions("bash")
        script = (
            f"source {path}; COMP_WORDS=(starloop %s); COMP_CWORD=1; _starloop starloop %s starloop; "
            'printf "%%s\\n" "${COMPREPLY[@]}"'
        )
        run = lambda word: subprocess.run(["bash", "-c", script % (word, word)], capture_output=True, text=True).stdout.split()
        self.assertEqual(run("doc"), ["doctor"])
        self.assertEqual(run("zzz"), [], "control")

    def reads(self, shell, path):
        return subprocess.run([shell, "-n", str(path)], capture_output=True, text=True).returncode == 0

    def check_syntax(self, shell):
        path = self.completions(shell)
        self.assertIn("doctor", path.read_text())
        self.assertTrue(self.reads(shell, path))
        broken = self.written("broken", path.read_text() + "\nif (\n")
        self.assertFalse(self.reads(shell, broken), "control")

    @unittest.skipUnless(shutil.which("zsh"), "zsh is not installed")
    def test_zsh_reads_its_file(self):
        self.check_syntax("zsh")

    @unittest.skipUnless(shutil.which("fish"), "fish is not installed")
    def test_fish_reads_its_file(self):
        self.check_syntax("fish")

    def test_manual_pages_are_those_of_all_commands(self):
        self.done("man", str(self.folder / "man1"))
        names = {path.name for path in (self.folder / "man1").iterdir()}
        self.assertGreaterEqual(names, {"starloop.1", "starloop-run.1", "starloop-catalog-query.1"})
        for path in (self.folder / "man1").iterdir():
            self.assertIn(".TH ", path.read_text(), path)
        self.assertEqual(self.done("man").stdout, (self.folder / "man1/starloop.1").read_text())


class CameraExport(Case):
    NAME = "cameras/star_tracker_20deg.toml"

    def test_each_program_gets_its_own_scale(self):
        done = self.done("camera", "export", self.NAME, "--for", "openstartracker")
        lines = dict(line.split("=") for line in done.stdout.splitlines())
        self.assertEqual((lines["IMG_X"], lines["IMG_Y"]), ("1024", "1024"))
        self.assertAlmostEqual(float(lines["PIXSCALE"]), 70.32, delta=0.005)
        self.assertIn("at the centre", done.stderr)
        lost = self.done("camera", "export", self.NAME, "--for", "lost").stdout
        self.assertEqual(lost, "--focal-length 52.26 --pixel-size 18\n")

    def test_opencv_file_has_the_matrix(self):
        path = self.folder / "camera.json"
        self.done("camera", "export", self.NAME, "--for", "opencv", "--out", str(path))
        data = json.loads(path.read_text())["camera_matrix"]["data"]
        self.assertAlmostEqual(data[0], 52.26e3 / 18.0, places=6)
        self.assertEqual((data[2], data[5]), (511.5, 511.5))
        cots = json.loads(self.done("camera", "export", self.NAME, "--for", "cots").stdout)
        self.assertEqual([part for row in cots["camera_matrix"] for part in row], data)
        self.assertEqual((cots["resolution"], len(cots["dist_coefs"][0])), ([1024, 1024], 5))

    def test_program_without_a_form_is_refused(self):
        self.assertIn("openstartracker", self.done("camera", "export", self.NAME, "--for", "nothing", status=2).stderr)


class Reports(Case):
    def test_each_has_its_schema_and_the_numbers_of_the_tables(self):
        snr = self.report("snr", str(CAMERA))
        self.assertEqual(snr["schema"], "starloop.snr/1")
        text = self.done("snr", str(CAMERA)).stdout
        self.assertIn(f"limiting magnitude at SNR 3: G = {snr['limits'][0]['mag_g']:.2f}", text)
        psf = self.report("psf", str(CAMERA))
        self.assertEqual(psf["schema"], "starloop.psf/1")
        self.assertIn(f"{psf['fwhm_px']:.4f}", self.done("psf", str(CAMERA)).stdout)
        check = self.report("check")
        self.assertEqual(check["schema"], "starloop.check/1")
        self.assertIn(f"plan of frame 0: {check['plans'][0]['stars']} stars", self.done("check").stdout)
        catalog = self.report("catalog", "info")
        self.assertEqual(catalog["schema"], "starloop.catalog-info/1")
        self.assertIn(f"stars    {catalog['stars']}\n", self.done("catalog", "info").stdout)

    def test_those_of_runs(self):
        run = self.report("run", *VIRTUAL, "--capture", "captured")
        self.assertEqual((run["schema"], run["frames"]["delivered"]), ("starloop.run/1", 3))
        replay = self.report("replay", "captured")
        self.assertEqual((replay["schema"], replay["compared"], replay["differing"]), ("starloop.replay/1", 3, 0))
        scenario = self.report("run", str(ROOT / "configs/scenarios/imaging_faults.toml"), "--clock", "virtual", "--sink", "null")
        self.assertEqual(scenario["schema"], "starloop.scenario/1")

    def test_those_of_a_budget_whatever_the_machine_does(self):
        done = starloop("budget", "--duration", "0.5", "--sink", "null", "--json", cwd=self.folder, timeout=PATIENCE_S)
        self.assertIn(done.returncode, (0, 3), done.stderr)
        report = json.loads(done.stdout, object_pairs_hook=without_duplicates)
        self.assertEqual(report["schema"], "starloop.budget/1")
        self.assertTrue(report["lines"])

    def test_those_of_measurements(self):
        verify = self.report("verify", str(CAMERA), "--frames", "4")
        self.assertEqual((verify["schema"], verify["holds"]), ("starloop.verify/1", True))
        link = self.report("link-check")
        self.assertEqual((link["schema"], link["broken"]), ("starloop.link-check/1", None))
        self.assertGreater(len(link["kept"]), 5)
        costs = self.report("calibrate", "--quick", "--backend", "cpu", "--out", "costs.toml")
        self.assertEqual(costs["schema"], "starloop.calibrate/1")
        self.assertIn(f"pixel_ns = {costs['cost']['pixel_ns']}", (self.folder / "costs.toml").read_text())
        self.done("catalog", "synthesize", "--out", "sky", "--mag", "8", "--stars", "2000", "--layers", "6")
        layer = str(next((self.folder / "sky").glob("*.starlayer")))
        whole = self.report("catalog", "verify", layer)
        info = self.report("catalog", "info", layer)
        self.assertEqual(whole["schema"], "starloop.catalog-verify/1")
        self.assertEqual(whole["whole"][0]["stars"], info["stars"])

    def test_a_bus_prints_lines(self):
        done = self.done("bus", "--slcan-tcp", "0", "--duration", "0.1", "--json")
        lines = [json.loads(line, object_pairs_hook=without_duplicates) for line in done.stdout.splitlines()]
        self.assertEqual([line["schema"] for line in lines], ["starloop.bus/1"] * 2)


class Render(Case):
    WORDS = ("render", "--camera", str(CAMERA), "--ra", "83.8", "--dec", "-1.2", "--out", "a.fits")

    def test_it_says_what_it_wrote_and_nothing_else(self):
        done = self.done(*self.WORDS, "--truth", "a.csv")
        self.assertEqual((done.stdout.count("\n"), done.stderr), (1, ""), done.stdout + done.stderr)
        self.assertRegex(done.stdout, r"^a\.fits: \d+ x \d+ px, .* stars, .*; truth in a\.csv\n$")
        rows = (self.folder / "a.csv").read_text().count("\n") - 1
        report = self.report(*self.WORDS, "--timing")
        self.assertEqual((report["schema"], report["image"]), ("starloop.render/1", "a.fits"))
        self.assertEqual(report["stars"], rows)
        self.assertGreater(report["timing"]["repeats"], 0)
        timing = json.loads(self.done(*self.WORDS, "--timing").stdout)
        self.assertGreater(timing["total_ms"], 0.0)


class Doctor(Case):
    def test_it_finds_what_a_machine_has(self):
        here = self.report("doctor")
        self.assertEqual(here["schema"], "starloop.doctor/1")
        states = {finding["name"]: finding["state"] for finding in here["findings"]}
        self.assertGreaterEqual(
            set(states),
            {"CAN", "serial ports", "GPU adapters", "display", "real-time priority", "locked memory", "PTP clocks", "Python"},
        )
        for finding in here["findings"]:
            self.assertEqual(finding["advice"] is None, finding["state"] == "ready", finding)
        for path, text in (("type", "280"), ("flags", "0x400c1"), ("mtu", "72")):
            file = self.folder / "sys/class/net/vcan7" / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        found = self.done("doctor", STARLOOP_HOST_ROOT=str(self.folder)).stdout
        self.assertIn("ready    CAN                 vcan7 (CAN FD, up)", found)
        empty = self.done("doctor", STARLOOP_HOST_ROOT=str(self.folder / "empty")).stdout
        self.assertRegex(empty, r"missing  CAN +no interface\n +-> plug in an adapter")


if __name__ == "__main__":
    unittest.main()
