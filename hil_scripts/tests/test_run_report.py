"""Tests of what a run leaves in its folder about itself: python3 hil_scripts/tests/test_run_report.py

provenance.json, events.jsonl and report.html of runs on the virtual clock: hashes are computed again here, the page is
checked for its verdict, its parts and links to anything outside, and damaged files are found by the same checks.
Standard library only.
"""

import base64
import hashlib
import html.parser
import json
import re
import shutil
import unittest
from pathlib import Path

from support import BINARY, CAMERA, ROOT, InAFolder, bench_text, starloop, summary_of

MOST_BYTES = 300_000
LOST = 5
RECORDER = '[sink]\nkind = "recorder"\n'
LINKS = {"src", "href", "xlink:href", "srcset", "action", "data", "poster", "background"}
FETCHING = {"script", "link", "iframe", "object", "embed", "base", "form"}


class Parts(html.parser.HTMLParser):
    """Headings, pictures and all that a page would fetch."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.images, self.outside, self.svgs, self.open = [], [], [], 0, None
        self.feed(text)
        if "url(" in text or "@import" in text:
            self.outside.append("style")

    def handle_starttag(self, tag, attributes):
        self.svgs += tag == "svg"
        if tag in FETCHING:
            self.outside.append(tag)
        for name, value in attributes:
            if name in LINKS and not (value or "").startswith(("data:image/png;base64,", "#")):
                self.outside.append(f"{tag} {name}={value}")
            if tag == "img" and name == "src":
                self.images.append(value)
        if tag in ("h1", "h2"):
            self.open = tag
            self.headings.append("")

    def handle_endtag(self, tag):
        if tag == self.open:
            self.open = None

    def handle_data(self, data):
        if self.open:
            self.headings[-1] += data


def wrong_hashes(folder):
    """Files of provenance.json that can be read here and are not as their hash says; and those that were compared."""
    listed = json.loads((folder / "provenance.json").read_text())["files"]
    wrong, compared = [], []
    for file in listed:
        path = Path(file["path"].removeprefix("built-in "))
        path = ROOT / "configs" / path if file["path"].startswith("built-in ") else path
        if path.is_file():
            content = path.read_bytes()
            compared.append(path.name)
            if (hashlib.sha256(content).hexdigest(), len(content)) != (file["sha256"], file["bytes"]):
                wrong.append(path.name)
    return wrong, compared


def faults_of_page(text, verdict):
    """Everything that is wrong with a page, in words."""
    parts, faults = Parts(text), []
    if not text.splitlines()[0].startswith("<!DOCTYPE html>") or f"<title>{verdict}" not in text.splitlines()[0]:
        faults.append("verdict is not in the first line")
    if not parts.headings or not parts.headings[0].startswith(verdict):
        faults.append("verdict is not the first heading")
    wanted = ["What ran", "Frames", "Time of each stage", "Events", "Pointing", "Frames of the run", "Provenance"]
    faults += [f"no part {name}" for name in wanted if name not in parts.headings]
    faults += [f"outside: {what}" for what in parts.outside]
    if len(text.encode()) > MOST_BYTES:
        faults.append(f"{len(text.encode())} bytes")
    if not text.rstrip().endswith("</html>"):
        faults.append("cut")
    for image in parts.images:
        if not base64.b64decode(image.partition(",")[2][:16]).startswith(b"\x89PNG\r\n\x1a\n"):
            faults.append("a picture is not a PNG")
    return faults


def faults_of_events(text, counts):
    """Everything that is wrong with events.jsonl, whose kinds happened `counts` times."""
    head, *events = [json.loads(line) for line in text.splitlines()]
    faults = []
    if head["schema"] != "starloop.events/1" or head["counts"] != counts:
        faults.append("head")
    if head["kept"] != len(events) or head["kept"] + head["left_out"] != head["events"]:
        faults.append("lines")
    if head["left_out"] == 0:
        found = {kind: sum(event["kind"] == kind for event in events) for kind in counts}
        if found != counts:
            faults.append("kinds")
    return faults


class Report(InAFolder):
    def fly(self, *words, text=None, **options):
        if text is not None:
            words = (self.written("bench.toml", text), *words)
        return starloop("run", *words, "--clock", "virtual", "--backend", "cpu", cwd=self.folder, **options)

    def page(self):
        return (self.out / "report.html").read_text()

    def counts(self):
        return summary_of(self.out)["event_counts"]

    def test_recorded_run_says_where_it_comes_from_and_how_it_went(self):
        text = bench_text("report") + RECORDER
        self.fly("--out", str(self.out), "--duration", "2", text=text, status=0)
        wrong, compared = wrong_hashes(self.out)
        self.assertEqual(wrong, [])
        self.assertLessEqual({"bench.toml", CAMERA.name}, set(compared))
        (self.folder / "bench.toml").write_text(text + "# another byte\n")
        self.assertEqual(wrong_hashes(self.out)[0], ["bench.toml"], "control: a changed file is found")
        from_file = json.loads((self.out / "provenance.json").read_text())
        self.assertEqual(from_file["program_sha256"], hashlib.sha256(Path(BINARY).read_bytes()).hexdigest())
        self.assertIn("run", from_file["command_line"])

        page = self.page()
        self.assertEqual(faults_of_page(page, "ok: 20 of 20 frames"), [])
        self.assertEqual(len(Parts(page).images), 3)
        self.assertIn("prefers-color-scheme:dark", page)
        for file in from_file["files"]:
            self.assertIn(file["sha256"], page)
        self.assertEqual(faults_of_events((self.out / "events.jsonl").read_text(), self.counts()), [])

    def test_checks_find_damaged_files(self):
        self.fly("--out", str(self.out), "--duration", "1", text=bench_text("report") + RECORDER, status=0)
        page, verdict = self.page(), "ok: 10 of 10 frames"
        self.assertEqual(faults_of_page(page, verdict), [], "control")
        damaged = {
            "cut": page[: len(page) // 2],
            "outside": page.replace("<h2>Events", '<img src="https://example.org/a.png"><h2>Events'),
            "outside: script": page.replace("</body>", "<script>1</script></body>"),
            "verdict": page.replace(verdict, "ok: 9 of 10 frames"),
            "no part Provenance": page.replace("<h2>Provenance", "<h2>Origin"),
            "bytes": page.replace("</body>", " " * MOST_BYTES + "</body>"),
        }
        for what, text in damaged.items():
            with self.subTest(what=what):
                self.assertNotEqual(text, page)
                self.assertTrue(any(what in fault for fault in faults_of_page(text, verdict)), what)
        events = (self.out / "events.jsonl").read_text()
        more = events + '{"at_utc":"","frame":1,"kind":"late","detail":""}\n'
        self.assertEqual(faults_of_events(events, self.counts()), [], "control")
        self.assertNotEqual(faults_of_events(more, self.counts()), [])
        self.assertNotEqual(faults_of_events(events, self.counts() | {"late": 1}), [])

    def test_flight_with_faults_has_its_events_and_its_pointing(self):
        scenario = ROOT / "configs/scenarios/bus_faults.toml"
        done = self.fly(str(scenario), "--out", str(self.out))
        self.assertIn(done.returncode, (0, 3), done.stderr)
        page, counts = self.page(), self.counts()
        verdict = "ok" if done.returncode == 0 else "FAILED"
        self.assertEqual(faults_of_page(page, verdict), [])
        self.assertGreater(sum(counts.values()), 0)
        events = (self.out / "events.jsonl").read_text()
        self.assertEqual(faults_of_events(events, counts), [])
        self.assertGreaterEqual(len(events.splitlines()) - 1, min(sum(counts.values()), 65), "more than the newest 64")
        self.assertIn("events on a time line", page)
        self.assertIn("true attitude to target", page, "the picture of the telemetry")
        for kind in counts:
            self.assertRegex(page, rf'<td>{re.escape(kind)}</td><td class="n">{counts[kind]}</td>')

    def test_run_without_a_folder_writes_nothing(self):
        self.fly("--duration", "1", text=bench_text("report") + '[sink]\nkind = "null"\n', status=0)
        self.assertEqual([path.name for path in self.folder.iterdir()], ["bench.toml"])

    def test_page_or_events_that_cannot_be_written_are_a_loss_of_the_run(self):
        for name in ("report.html", "events.jsonl"):
            with self.subTest(name=name):
                shutil.rmtree(self.out, ignore_errors=True)
                (self.out / name).mkdir(parents=True)
                done = self.fly("--out", str(self.out), "--duration", "1", text=bench_text("report") + RECORDER, status=LOST)
                self.assertIn(name, done.stderr)
                self.assertTrue((self.out / "summary.json").exists(), "the others are written")


if __name__ == "__main__":
    unittest.main()
