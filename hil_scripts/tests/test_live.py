"""Tests of the live view in a browser and with Prometheus's own parser: python3 hil_scripts/tests/test_live.py

STARLOOP_CHROMIUM names the browser (default chromium); STARLOOP_SCREENSHOT names a file in which the page is kept as
people see it.
"""

import base64
import contextlib
import functools
import json
import os
import shutil
import socket
import subprocess
import tempfile
import time
import unittest
import urllib.error
import urllib.request
from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

import support
from support import BINARY, ROOT, Running

CHROMIUM = shutil.which(os.environ.get("STARLOOP_CHROMIUM", "chromium"))
BENCH = ROOT / "configs/benches/loopback.toml"
THREE_HEADS = ROOT / "configs/benches/three_heads.toml"
# Something that takes longer than this does not come any more.
HANGS_S = 90
until = functools.partial(support.until, patience_s=HANGS_S, every_s=0.1)


class Run(Running):
    """The program with its live view; ended when left."""

    def __init__(self, address="0", duration_s=600, *more, bench=BENCH, sink=("--sink", "null")):
        super().__init__(BINARY, "run", bench, *sink, "--duration", duration_s, "--monitor", address, *more)
        self.url = self.wait_for(r"^live view: (http://\S+)/$")[1]

    def get(self, path):
        with urllib.request.urlopen(self.url + path, timeout=HANGS_S) as answer:
            return answer.read()

    def state(self):
        return json.loads(self.get("/state.json"))

    def metrics(self):
        return {family.name: family for family in text_string_to_metric_families(self.get("/metrics").decode())}

    def __enter__(self):
        until("a first frame", lambda: self.state()["frame"])
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.ended(HANGS_S)


class Browser:
    """Headless Chromium, controlled through its pipe: JSON messages that end in a zero byte."""

    def __init__(self, size=(1280, 800), *more):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self.say = os.pipe()
        self.take_in, from_browser = os.pipe()
        words = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
        words += ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"]
        words += ["--hide-scrollbars", f"--user-data-dir={self.profile.name}", *more]
        words += [f"--window-size={size[0]},{size[1]}", "--remote-debugging-pipe", "about:blank"]
        # The browser reads descriptor 3 and writes descriptor 4.
        pipes = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        self.program = subprocess.Popen(
            ["bash", "-c", pipes, "browser", *words], pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        self.got, self.events, self.number, self.session = b"", [], 0, None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.ask(domain + ".enable")
        self.resize(size)

    def resize(self, size):
        view = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **view)

    def ask(self, method, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.say, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.next()
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def next(self):
        while b"\0" not in self.got:
            part = os.read(self.take_in, 1 << 16)
            if not part:
                raise AssertionError("the browser has gone")
            self.got += part
        message, self.got = self.got.split(b"\0", 1)
        return json.loads(message)

    def open(self, url):
        self.ask("Page.navigate", url="about:blank")
        self.events.clear()
        self.ask("Page.navigate", url=url)
        until("the page", lambda: self.value(f"location.href === {url!r} && document.readyState === 'complete'"))

    def value(self, expression):
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise AssertionError(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def text(self, name):
        return self.value(f"document.getElementById({name!r}).textContent")

    def complaints(self):
        """Returns the console's errors and warnings, and uncaught exceptions."""
        self.value("0")
        found = []
        for event in self.events:
            said = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                found.append(said["exceptionDetails"])
            if event.get("method") == "Runtime.consoleAPICalled" and said["type"] in ("error", "warning", "assert"):
                found.append(said)
            if event.get("method") == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning"):
                found.append(said["entry"])
        return found

    def screenshot(self, path):
        Path(path).write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        os.close(self.say)
        try:
            self.program.wait(10)
        except subprocess.TimeoutExpired:
            self.program.kill()
            self.program.wait()
        os.close(self.take_in)
        self.profile.cleanup()


# Contrast and offset of the bright stars of the truth in the canvas, as [grey above the surroundings, px from the truth];
# stars near others, near the border or saturated over many pixels do not count.
STARS = """
(shift) => {
  const canvas = document.getElementById("frame");
  const { width, height } = canvas;
  const grey = canvas.getContext("2d").getImageData(0, 0, width, height).data;
  const at = (x, y) => grey[4 * (y * width + x)];
  const near = (a, b) => a !== b && Math.hypot(a.x_px - b.x_px, a.y_px - b.y_px) < 14;
  const inside = (v, n) => v > 16 && v < n - 17;
  const bright = shownTruth.stars.slice(0, 40).map((s) => ({ ...s, x_px: s.x_px + shift, y_px: s.y_px + shift }));
  return bright
    .filter((s) => inside(s.x_px, width) && inside(s.y_px, height) && !bright.some((other) => near(s, other)))
    .map((star) => {
      const [cx, cy] = [Math.round(star.x_px), Math.round(star.y_px)];
      const ring = [];
      for (let i = -7; i <= 7; i += 1) ring.push(at(cx + i, cy - 7), at(cx + i, cy + 7), at(cx - 7, cy + i), at(cx + 7, cy + i));
      const ground = ring.sort((a, b) => a - b)[ring.length / 2];
      let [sum, x, y, most] = [0, 0, 0, 0];
      for (let dy = -4; dy <= 4; dy += 1) for (let dx = -4; dx <= 4; dx += 1) {
        const light = Math.max(at(cx + dx, cy + dy) - ground - 20, 0);
        sum += light; x += light * (cx + dx); y += light * (cy + dy); most = Math.max(most, light);
      }
      return [most, sum ? Math.hypot(x / sum - star.x_px, y / sum - star.y_px) : 99];
    });
}
"""
# A star of the truth is this much brighter than what is around it, of 255, and its light lies this near to it, px: a
# centroid of stretched grey under noise, in 81 pixels.
BRIGHTER, NEAR_PX = 40, 1.0


# Angle between the boresight by attitude and by RA and Dec; the angle of up east of north less the roll; the first with the
# attitude the other way round, all in deg.
POINTING = """
(() => {
  if (!lastState?.frame) return null;
  const { attitude_wxyz: q, ra_deg, dec_deg, roll_deg } = lastState.frame;
  const dot = (a, b) => a.reduce((s, v, i) => s + v * b[i], 0);
  const angle = (a, b) => Math.atan2(Math.hypot(...cross(a, b)), dot(a, b)) / DEG;
  const there = unit(ra_deg, dec_deg), north = unit(ra_deg, dec_deg + 90), east = unit(ra_deg + 90, 0);
  const up = icrfFromSensor(q, [0, -1, 0]);
  const off = Math.atan2(dot(up, east), dot(up, north)) / DEG - roll_deg;
  return {
    boresight: angle(icrfFromSensor(q, [0, 0, 1]), there),
    up: ((off + 540) % 360) - 180,
    control: angle(icrfFromSensor([q[0], -q[1], -q[2], -q[3]], [0, 0, 1]), there),
  };
})()
"""
# All are of one attitude: what differs is rounding.
POINTING_DEG = 1e-6


# The page with this many heads, made of the state of one: the tiles, what is shown large before and after the last one is
# chosen, and the size of the document. All in one task, so that no answer of the run comes between.
TILES = """
(count) => {
  const one = { ...lastState, ...lastState.heads[0], is_over: lastState.is_over };
  const head = (i) => ({ ...one.heads[0], head: i, name: "head " + i, frame: { ...one.frame, number: 1000 + i } });
  const heads = Array.from({ length: count }, (_, i) => head(i));
  chooseHead(0);
  show({ ...one, ...heads[0], is_over: one.is_over, heads });
  const places = [...document.querySelectorAll("#heads .tile")];
  const tiles = places.map((tile) => {
    const { left, right } = tile.getBoundingClientRect();
    return { left, right, text: tile.innerText, pressed: tile.ariaPressed };
  });
  const { scrollWidth: wide, scrollHeight: high } = document.documentElement;
  const number = byId("number").textContent;
  places.at(-1)?.click();
  const found = { tiles, wide, high, number, chosen_number: byId("number").textContent };
  chooseHead(0);
  show(one);
  return found;
}
"""


def is_there(star):
    return star[0] >= BRIGHTER and star[1] <= NEAR_PX


@unittest.skipUnless(CHROMIUM, "no chromium: wanted the package of that name, or STARLOOP_CHROMIUM")
class InABrowser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    @contextlib.contextmanager
    def shown(self, **options):
        """A run whose page is open."""
        with Run(**options) as run:
            self.opened(run)
            yield run

    def opened(self, run):
        self.browser.open(run.url + "/")
        until("a picture", lambda: self.browser.value('document.getElementById("frame")?.width > 1'))

    def test_the_page_follows_the_run_and_says_when_it_broke_down(self):
        with self.shown() as run:
            first = int(self.browser.text("number"))
            until("the number moves on", lambda: int(self.browser.text("number")) >= first + 3)
            shown = int(self.browser.value('document.getElementById("frame").dataset.number'))
            until("the picture too", lambda: int(self.browser.value('document.getElementById("frame").dataset.number')) > shown)
            until("live", lambda: self.browser.text("status") == "live")
            self.assertRegex(self.browser.text("utc"), r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} UTC$")
            self.assertRegex(self.browser.text("pointing"), r"RA \d+\.\d{4}°")
            self.assertIn("packets received", self.browser.text("bus"))
            self.assertIn("scheduled", self.browser.text("counts"))
            self.assertEqual(self.browser.complaints(), [])
            if keep := os.environ.get("STARLOOP_SCREENSHOT"):
                time.sleep(float(os.environ.get("STARLOOP_SCREENSHOT_AFTER_S", "0")))
                self.browser.screenshot(keep)
            run.process.kill()
            until("the loss is shown", lambda: "no signal since" in self.browser.text("status"))
            self.assertTrue(self.browser.value('document.body.classList.contains("no-signal")'))

    def test_a_normal_end_is_shown_as_one_with_every_frame_delivered(self):
        with self.shown(duration_s=6) as run:
            until("the end is shown", lambda: self.browser.text("status").startswith("run is over since "))
            run.process.wait(HANGS_S)
            # Longer than the page waits before it reports the loss of the signal.
            time.sleep(2.0)
            self.assertTrue(self.browser.text("status").startswith("run is over since "), self.browser.text("status"))
            self.assertEqual(self.browser.value('document.getElementById("status").className'), "over")
            self.assertFalse(self.browser.value('document.body.classList.contains("no-signal")'))
            frames = self.browser.value("lastState.run.frames")
            # Frames that are held or dropped on a busy machine are rendered and not delivered, or the other way round.
            self.assertEqual(frames["delivered"] + frames["dropped"], frames["scheduled"], frames)
            self.assertEqual(frames["scheduled"], 60, frames)

    def test_narrow_screens_wrap_the_header(self):
        self.addCleanup(self.browser.resize, (1280, 800))
        with self.shown():
            until("live", lambda: self.browser.text("status") == "live")
            for width in (320, 390, 500, 840):
                self.browser.resize((width, 800))
                wide, left, right, top, bottom = self.browser.value(
                    """(() => { const s = document.getElementById("status").getBoundingClientRect();
                    return [document.documentElement.scrollWidth, s.left, s.right, s.top, s.bottom]; })()"""
                )
                with self.subTest(width=width):
                    self.assertLessEqual(wide, width, "nothing to scroll to")
                    self.assertTrue(0 <= left < right <= width and 0 <= top < bottom <= 800, (left, right, top, bottom))

    def test_every_head_is_a_tile_with_its_own_numbers_and_can_be_chosen(self):
        self.addCleanup(self.browser.resize, (1280, 800))
        with self.shown():
            self.assertEqual(self.browser.value(f"({TILES})(1).tiles"), [], "control: one head needs no tiles")
            shown = self.browser.value(f"({TILES})(3)")
            self.assertEqual([tile["text"][:6] for tile in shown["tiles"]], ["head 0", "head 1", "head 2"])
            self.assertEqual([tile["pressed"] for tile in shown["tiles"]], ["true", "false", "false"])
            for number, tile in enumerate(shown["tiles"]):
                self.assertIn(f"frame {1000 + number} ", tile["text"])
            self.assertEqual((shown["number"], shown["chosen_number"]), ("1000", "1002"))
            self.assertLessEqual(shown["high"], 800, "all of it is seen at 1280 x 800")
            for width in (320, 390, 840):
                self.browser.resize((width, 800))
                shown = self.browser.value(f"({TILES})(3)")
                with self.subTest(width=width):
                    self.assertLessEqual(shown["wide"], width, "nothing to scroll to")
                    for tile in shown["tiles"]:
                        self.assertTrue(0 <= tile["left"] < tile["left"] + 100 < tile["right"] <= width, tile)
            self.assertEqual(self.browser.complaints(), [])

    def test_three_heads_have_a_picture_each_and_the_chosen_one_is_shown_large(self):
        with self.shown(bench=THREE_HEADS) as run:
            tiles = '[...document.querySelectorAll("#heads .tile")].map((tile) => Number(tile.dataset.number || -1))'
            until("a picture in each other tile", lambda: self.browser.value(f"({tiles}).slice(1).every((n) => n >= 0)"))
            boresights = {(head["frame"]["ra_deg"], head["frame"]["dec_deg"]) for head in run.state()["heads"]}
            self.assertEqual(len(boresights), 3, "each looks elsewhere")
            self.browser.value('document.querySelectorAll("#heads .tile")[2].click()')
            until("its picture", lambda: self.browser.value('pictureOf?.includes("head=2&")'))
            self.assertIn("head 2", self.browser.text("bench"))
            shown = json.loads(run.get("/state.json?head=2"))["frame"]["ra_deg"]
            self.assertLess(abs(self.browser.value("lastState.frame.ra_deg") - shown), 0.1)
            self.assertEqual(self.browser.complaints(), [])

    def test_the_stars_are_in_the_picture_where_the_truth_says(self):
        with self.shown():
            until("truth", lambda: self.browser.value("shownTruth !== null"))
            stars = self.browser.value(f"({STARS})(0)")
            there = [star for star in stars if is_there(star)]
            self.assertGreaterEqual(len(stars), 8, stars)
            self.assertGreaterEqual(len(there), 0.9 * len(stars), stars)
            elsewhere = [star for star in self.browser.value(f"({STARS})(9)") if is_there(star)]
            self.assertLessEqual(len(elsewhere), 0.2 * len(stars), "control: nine pixels beside there is nothing")

    def test_the_map_has_the_boresight_and_the_upper_side_where_the_attitude_says(self):
        with self.shown():
            found = until("a state", lambda: self.browser.value(POINTING))
        for name in ("boresight", "up"):
            self.assertLess(abs(found[name]), POINTING_DEG, found)
        self.assertGreater(found["control"], 100 * POINTING_DEG, "the attitude the other way round is another one")

    def test_the_overlay_is_drawn_when_it_is_wanted(self):
        painted = """(() => { const c = document.getElementById("overlay");
            return c.getContext("2d").getImageData(0, 0, c.width, c.height).data.some((v) => v > 0); })()"""
        with self.shown():
            # Names of stars have a switch of their own.
            self.browser.value('document.getElementById("names-on").click()')
            until("circles", lambda: self.browser.value(painted))
            self.browser.value('document.getElementById("overlay-on").click()')
            self.assertFalse(self.browser.value(painted))
            self.browser.value('document.getElementById("overlay-on").click()')
            self.assertTrue(self.browser.value(painted))

    def test_every_stretch_is_shown(self):
        chosen = """((name) => { const s = document.getElementById("stretch");
            s.value = name; s.dispatchEvent(new Event("change")); })"""
        with self.shown():
            for name in ("faint", "linear", "log", "dn", "stars"):
                self.browser.value(f"{chosen}({name!r})")
                until(name, lambda: self.browser.value(f'pictureOf.includes("stretch={name}")'))
            self.assertEqual(self.browser.complaints(), [])

    def test_every_control_and_drawing_has_a_name(self):
        with self.shown():
            nameless = self.browser.value(
                """[...document.querySelectorAll("select, input, canvas")].filter((e) => !e.labels?.length
                && !e.ariaLabel && e.getAttribute("aria-hidden") !== "true").map((e) => e.id)"""
            )
            self.assertEqual(nameless, [])
            wide = self.browser.value("document.documentElement.scrollWidth <= 1280 && document.documentElement.scrollHeight <= 800")
            self.assertTrue(wide, "all of it is seen at 1280 x 800")


class Machines(unittest.TestCase):
    def test_prometheus_reads_the_metrics_and_counters_only_rise(self):
        with Run() as run:
            first = until("numbers", lambda: (m := run.metrics()).get("starloop_frames_rendered") and m)
            rendered = lambda metrics: metrics["starloop_frames_rendered"].samples[0].value
            later = until("more frames", lambda: (m := run.metrics()) and rendered(m) >= rendered(first) + 3 and m)
        for name, family in later.items():
            self.assertTrue(name.startswith("starloop_"), name)
            self.assertTrue(family.documentation, name)
            self.assertIn(family.type, ("gauge", "counter", "histogram"), name)
        counted = 0
        for name, family in first.items():
            if family.type == "counter":
                now = {(s.name, *sorted(s.labels.items())): s.value for s in later[name].samples}
                for sample in family.samples:
                    counted += 1
                    self.assertLessEqual(sample.value, now[(sample.name, *sorted(sample.labels.items()))], sample)
        self.assertGreater(counted, 20)
        self.check_histograms(later)
        render = [s for s in later["starloop_stage_duration_seconds"].samples if s.labels.get("stage") == "render"]
        self.assertGreater(next(s.value for s in render if s.name.endswith("_count")), 2)
        received = [s.value for s in later["starloop_link"].samples if s.labels["counter"] == "packets_received"]
        self.assertGreater(received[0], 0)

    def test_at_the_end_of_a_run_the_totals_agree(self):
        with Run(duration_s=4) as run:
            value = lambda metrics, name: metrics[name].samples[0].value
            last = until("the end", lambda: (m := run.metrics()) and value(m, "starloop_run_over") == 1 and m)
            out = value(last, "starloop_frames_delivered") + value(last, "starloop_frames_dropped")
            self.assertEqual((out, value(last, "starloop_frames_scheduled")), (40, 40))
            self.assertEqual(run.process.wait(HANGS_S), 0)

    def check_histograms(self, metrics):
        for family in (f for f in metrics.values() if f.type == "histogram"):
            series = {}
            for sample in family.samples:
                key = tuple(sorted((k, v) for k, v in sample.labels.items() if k != "le"))
                series.setdefault(key, []).append(sample)
            for samples in series.values():
                buckets = [s for s in samples if s.name.endswith("_bucket")]
                bounds = [float(s.labels["le"]) for s in buckets]
                self.assertEqual(bounds, sorted(bounds))
                self.assertEqual(bounds[-1], float("inf"))
                values = [s.value for s in buckets]
                self.assertEqual(values, sorted(values))
                count = next(s.value for s in samples if s.name.endswith("_count"))
                self.assertEqual(values[-1], count)

    def test_the_parser_refuses_what_is_no_metric(self):
        with self.assertRaises(ValueError):
            list(text_string_to_metric_families("# TYPE a counter\na{b=} x\n"))

    def test_nothing_can_be_written(self):
        with Run() as run:
            for method in ("POST", "PUT", "DELETE"):
                request = urllib.request.Request(run.url + "/state.json", data=b"{}", method=method)
                with self.assertRaises(urllib.error.HTTPError) as refused:
                    urllib.request.urlopen(request, timeout=HANGS_S)
                self.assertEqual(refused.exception.code, 405)
                refused.exception.close()

    def test_frames_go_on_with_clients_that_do_not_read(self):
        with Run() as run:
            host, port = run.url.removeprefix("http://").rsplit(":", 1)
            clients = []
            for number in range(60):
                client = socket.create_connection((host, int(port)), timeout=HANGS_S)
                client.sendall([b"GET /frame.png HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\0garbage", b""][number % 3])
                clients.append(client)
            served = lambda: self.state_or_none(run)
            before = until("served again", served)
            after = until("frames go on", lambda: (s := served()) and s["frame"]["number"] >= before["frame"]["number"] + 5 and s)
            self.assertNotIn("sink_busy", after["run"]["events"])
            for client in clients:
                client.close()

    @staticmethod
    def state_or_none(run):
        try:
            return run.state()
        except OSError:
            return None

    def test_a_service_reachable_from_other_machines_says_so(self):
        for address, wanted in (("0.0.0.0:0", True), ("127.0.0.1:0", False)):
            run = Run(address, 1)
            run.process.wait(HANGS_S)
            run.ended()
            said = "".join(run.said)
            self.assertEqual("asks for no password" in said, wanted, said)


if __name__ == "__main__":
    unittest.main()
