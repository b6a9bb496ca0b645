"""Tests of what people do on the live view's page, at three sizes: python3 hil_scripts/tests/test_live_page.py

STARLOOP_CHROMIUM names the browser; STARLOOP_SCREENSHOTS names a folder in which the pages are kept as people see them.
"""

import json
import os
import re
import tempfile
import unittest
from contextlib import contextmanager
from pathlib import Path

import numpy
from astropy.io import fits

from support import bench_text
import test_live
from test_live import CHROMIUM, THREE_HEADS, Browser, Run, until

SIZES = {"phone": (390, 844), "tablet": (820, 1180), "desktop": (1440, 900)}
PAGES = ("view", "events", "timing")
# Least contrast of text with its ground: Web Content Accessibility Guidelines 2.2, success criterion 1.4.3.
CONTRAST = 4.5
# From the middle of a pixel to a star in it, in pixels: half of the diagonal, and a little for the map's own error.
IN_PIXEL = 0.75

# The width of the page and of the window, and elements that reach beyond the window.
LAYOUT = """
(() => {
  const beyond = [...document.querySelectorAll("body *")].filter((e) => {
    const { right, width } = e.getBoundingClientRect();
    return width > 0 && right > innerWidth + 0.5 && !e.closest("#frame-box");
  });
  return { scroll: document.scrollingElement.scrollWidth, window: innerWidth, beyond: beyond.map((e) => e.id || e.tagName) };
})()
"""
# Controls that have no name for people who listen, and controls that the Tab key does not reach.
CONTROLS = """
(() => {
  const seen = (e) => e.checkVisibility() && !e.disabled;
  const controls = [...document.querySelectorAll("button, select, input, a[href], [tabindex], canvas:not([aria-hidden])")].filter(seen);
  const named = (e) => e.ariaLabel || e.labels?.length || (e.tagName !== "CANVAS" && e.textContent.trim())
    || document.getElementById(e.getAttribute("aria-labelledby"))?.textContent.trim();
  const is_met = (e) => e.tabIndex >= 0 || e.tagName === "CANVAS" || e.id === "main" || e.getAttribute("role") === "tab";
  const list = (some) => some.map((e) => e.id || e.outerHTML.slice(0, 60));
  return { count: controls.length, nameless: list(controls.filter((e) => !named(e))), unmet: list(controls.filter((e) => !is_met(e))) };
})()
"""
# Contrast of the colours of text with both grounds, by name.
CONTRASTS = """
(() => {
  const part = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (hex) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => sum + w * part(parseInt(hex.slice(1 + 2 * i, 3 + 2 * i), 16) / 255), 0);
  const ratio = (a, b) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05);
  const found = {};
  for (const text of ["text", "dim", "blue", "green", "amber", "red", "violet"])
    for (const ground of ["ground", "panel"]) found[text + " on " + ground] = ratio(colour(text), colour(ground));
  found.control = ratio(colour("line"), colour("panel"));
  return found;
})()
"""
# How much of the frame is seen: columns and rows between the corners of the box.
SEEN = "(() => { const a = toFrame([0, 0]), b = toFrame(boxSize()); return [b[0] - a[0], b[1] - a[1], view.x, view.y]; })()"
HELD = "({ shown: shownNumber(), newest: Number(byId('number').textContent), kept: keptFrames(), held: byId('held').textContent })"


@unittest.skipUnless(CHROMIUM, "no chromium: wanted the package of that name, or STARLOOP_CHROMIUM")
class OnThePage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = Browser((1440, 900))
        cls.addClassCleanup(cls.browser.close)

    def value(self, expression):
        return self.browser.value(expression)

    def opened(self, run, size="desktop"):
        self.browser.resize(SIZES[size])
        self.browser.open(run.url + "/")
        until("a picture", lambda: self.value("document.getElementById('frame')?.dataset.number !== undefined"))

    @contextmanager
    def shown(self, **options):
        """A run with its page open."""
        with Run(**options) as run:
            self.opened(run)
            yield run

    def press(self, key, code=0, shift=False):
        text = {"text": key} if len(key) == 1 else {}
        parameters = {"key": key, "modifiers": 8 if shift else 0, "windowsVirtualKeyCode": code}
        self.browser.ask("Input.dispatchKeyEvent", type="keyDown", **parameters, **text)
        self.browser.ask("Input.dispatchKeyEvent", type="keyUp", **parameters)

    def middle(self, name="frame-box"):
        return self.value(f"(() => {{ const r = byId({name!r}).getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()")

    def mouse(self, kind, x, y, **more):
        self.browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def test_every_page_fits_every_size_and_an_element_too_wide_is_found(self):
        for bench in (test_live.BENCH, THREE_HEADS):
            with Run(bench=bench) as run:
                for size, (width, _) in SIZES.items():
                    self.opened(run, size)
                    for page in PAGES:
                        self.value(f"choosePage({page!r})")
                        if page != "view":
                            until("rows", lambda: self.value(f"document.querySelectorAll('#page-{page} td').length > 0"))
                        found = self.value(LAYOUT)
                        with self.subTest(bench=bench.stem, size=size, page=page):
                            self.assertEqual(found["window"], width)
                            self.assertLessEqual(found["scroll"], found["window"])
                            self.assertEqual(found["beyond"], [])
                        if folder := os.environ.get("STARLOOP_SCREENSHOTS"):
                            self.browser.screenshot(Path(folder) / f"{bench.stem}_{size}_{page}.png")
                    self.value("""(() => { const wide = document.createElement("div"); wide.id = "too-wide";
                        wide.style.width = innerWidth + 40 + "px"; wide.textContent = "x"; document.body.append(wide); })()""")
                    found = self.value(LAYOUT)
                    self.assertGreater(found["scroll"], found["window"], "control")
                    self.assertIn("too-wide", found["beyond"], "control")
                self.assertEqual(self.browser.complaints(), [])

    def test_on_paper_each_page_fits_in_light_colours_without_buttons_and_then_the_screen_is_as_before(self):
        ground = "getComputedStyle(document.body).backgroundColor"
        buttons = "getComputedStyle(byId('tabs')).display !== 'none'"
        with self.shown():
            self.value("isLight() ? changeTheme() : undefined")
            on_screen = self.value(ground)
            self.assertTrue(self.value(buttons), "control")
            self.addCleanup(self.browser.ask, "Emulation.setEmulatedMedia", media="")
            self.browser.ask("Emulation.setEmulatedMedia", media="print")
            width = 702  # of A4 within its margins
            self.browser.resize((width, 1000))
            for page in PAGES:
                self.value(f"choosePage({page!r})")
                self.value("dispatchEvent(new Event('beforeprint'))")
                found = self.value(LAYOUT)
                with self.subTest(page):
                    self.assertEqual((found["scroll"] <= width, found["beyond"]), (True, []))
                    self.assertFalse(self.value(buttons))
                    self.assertNotEqual(self.value(ground), on_screen)
                self.value("dispatchEvent(new Event('afterprint'))")
                self.assertEqual(self.value(ground), on_screen)
            self.assertEqual(self.browser.complaints(), [])

    def test_buttons_wheel_keys_and_two_fingers_zoom_and_dragging_moves(self):
        with self.shown():
            whole = self.value(SEEN)
            self.assertAlmostEqual(min(whole[:2]), 1024, delta=1)
            x, y = self.middle()
            larger = {
                "button": lambda: self.value("byId('zoom-in').click()"),
                "wheel": lambda: self.mouse("mouseWheel", x, y, deltaX=0, deltaY=-120),
                "key": lambda: self.press("+", 187),
                "two fingers": lambda: self.pinch(x, y),
            }
            for name, act in larger.items():
                act()
                until(f"{name} zooms", lambda: self.value(SEEN)[0] < 0.95 * whole[0])
                self.assertGreater(self.value("byId('frame').clientWidth"), self.value("byId('frame-box').clientHeight"))
                self.press("0", 48)
                self.assertEqual(self.value(SEEN), whole, f"{name}: 0 shows the whole again")
            for _ in range(4):
                self.press("+", 187)
            before = self.value(SEEN)
            self.press("-", 189)
            self.assertGreater(self.value(SEEN)[0], 1.2 * before[0])
            before = self.value(SEEN)
            self.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
            self.mouse("mouseMoved", x - 60, y - 40, button="left", buttons=1)
            self.mouse("mouseReleased", x - 60, y - 40, button="left", clickCount=1)
            until("it moved", lambda: self.value(SEEN)[2] > before[2] + 5 and self.value(SEEN)[3] > before[3] + 5)
            before = self.value(SEEN)
            self.value("byId('frame-box').focus()")
            self.press("ArrowLeft", 37, shift=True)
            self.assertLess(self.value(SEEN)[2], before[2] - 5)
            self.assertEqual(self.browser.complaints(), [])

    def pinch(self, x, y):
        touch = lambda apart: [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        self.browser.ask("Input.dispatchTouchEvent", type="touchStart", touchPoints=touch(40))
        for apart in (60, 80, 100):
            self.browser.ask("Input.dispatchTouchEvent", type="touchMove", touchPoints=touch(apart))
        self.browser.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def test_the_pixel_under_the_pointer_is_the_one_in_the_fits_file(self):
        with tempfile.TemporaryDirectory() as folder:
            bench = Path(folder) / "bench.toml"
            recorder = f'[sink]\nkind = "recorder"\ndirectory = "{folder}/frames"\nfits = true\n'
            bench.write_text(bench_text("loopback") + recorder)
            with self.shown(bench=bench, sink=()) as run:
                self.value("togglePause()")
                number = self.value("shownNumber()")
                for _ in range(5):
                    self.press("+", 187)
                x, y = self.middle()
                pixels = {}
                for by in (0, 31, -47, 83):
                    self.mouse("mouseMoved", x + by, y - by)
                    wanted = self.value(f"inside(toFrame(placeInBox({{ clientX: {x + by}, clientY: {y - by} }})))")
                    text = until("the pixel", lambda: (t := self.browser.text("pixel")).startswith(f"x {wanted[0]} y {wanted[1]}:") and t)
                    pixels[tuple(wanted)] = int(re.search(r": (\d+) DN", text)[1])
                star = self.value("shownTruth.stars[2]")
                place = [round(star["x_px"]), round(star["y_px"])]
                answer = json.loads(run.get(f"/pixel.json?frame={number}&x={place[0]}&y={place[1]}"))
                pixels[tuple(place)] = answer["dn"]
                file = until("the file", lambda: next(Path(folder).rglob(f"*{number:06}.fits"), None))
            with fits.open(file) as parts:
                image = next(part.data for part in parts if part.data is not None and part.data.ndim == 2)
            found = {place: int(image[place[1], place[0]]) for place in pixels}
            self.assertEqual(found, pixels)
            self.assertGreater(len(set(pixels.values())), 1, "not all the same")
            elsewhere = {place: int(image[place[1] + 1, place[0]]) for place in pixels}
            self.assertNotEqual(elsewhere, pixels, "control: one row below are other values")
            cos = numpy.cos(numpy.radians(star["catalog_dec_deg"]))
            off = lambda a, b: numpy.hypot((a["ra_deg"] - b["catalog_ra_deg"]) * cos, a["dec_deg"] - b["catalog_dec_deg"])
            pixel_deg = self.value("lastState.field_deg[0] / lastState.size_px[0]")
            self.assertLess(off(answer, star), IN_PIXEL * pixel_deg, "the pixel in which the star is")
            other = self.value("shownTruth.stars[3]")
            self.assertGreater(off(answer, other), 10 * pixel_deg, "control: another star")

    def test_a_tap_and_the_arrow_keys_choose_a_pixel(self):
        with self.shown():
            x, y = self.middle()
            self.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
            self.mouse("mouseReleased", x, y, button="left", clickCount=1)
            at = until("a choice", lambda: self.value("pixel.chosen"))
            self.value("byId('frame-box').focus()")
            self.press("ArrowRight", 39)
            self.press("ArrowDown", 40)
            self.assertEqual(self.value("pixel.chosen"), [at[0] + 1, at[1] + 1])
            until("its value", lambda: self.browser.text("pixel").startswith(f"x {at[0] + 1} y {at[1] + 1}:"))
            self.press("Escape", 27)
            self.assertIsNone(self.value("pixel.chosen"))

    def test_names_of_stars_are_where_the_truth_has_them(self):
        names = """placeNames([0, 0, ...boxSize()]).map(({ name, star, x, y }) => {
            const at = toBox([star.x_px, star.y_px]);
            return { name, id: star.source_id, off: Math.hypot(x - at[0], y - at[1]) }; })"""
        painted = """(() => { const c = byId("overlay"), [r, g, b] = [1, 3, 5].map((i) => parseInt(colours["mark-name"].slice(i, i + 2), 16));
            const data = c.getContext("2d").getImageData(0, 0, c.width, c.height).data; let n = 0;
            for (let i = 0; i < data.length; i += 4) n += data[i] === r && data[i + 1] === g && data[i + 2] === b && data[i + 3] === 255;
            return n; })()"""
        # Orion is in part in the bench's field; the numbers are of the Hipparcos catalog.
        orion = {"Betelgeuse": "HIP 27989", "Rigel": "HIP 24436", "Bellatrix": "HIP 25336", "Alnilam": "HIP 26311"}
        with self.shown():
            self.value("togglePause()")
            found = {row["name"]: row for row in until("names", lambda: self.value(names))}
            shown = set(orion) & set(found)
            self.assertGreaterEqual(len(shown), 3, found)
            for name in shown:
                self.assertEqual(found[name]["id"], orion[name])
                self.assertLess(found[name]["off"], 30, "beside its star")
            of_truth = {star["source_id"] for star in self.value("shownTruth.stars")}
            self.assertTrue({row["id"] for row in found.values()} <= of_truth)
            self.assertGreater(self.value(painted), 50)
            self.press("n", 78)
            self.assertEqual(self.value(painted), 0, "control: switched off")

    def test_pause_holds_the_frame_while_the_count_goes_on_and_history_steps(self):
        with self.shown():
            until("some frames", lambda: len(self.value("keptFrames()")) >= 5)
            self.press("p", 80)
            held = self.value(HELD)
            grey = self.value("byId('frame').toDataURL().length")
            until("the count goes on", lambda: self.value(HELD)["newest"] >= held["newest"] + 5)
            self.assertEqual(self.value("shownNumber()"), held["shown"])
            self.assertEqual(self.value("byId('frame').toDataURL().length"), grey, "the same picture")
            self.assertEqual(self.value("byId('pause').ariaPressed"), "true")
            kept = self.value("keptFrames()")
            at = kept.index(held["shown"])
            for key, wanted in ((",", kept[at - 1]), (",", kept[at - 2]), (".", kept[at - 1])):
                self.press(key)
                until(f"frame {wanted}", lambda: self.value("shownNumber()") == wanted)
                self.assertEqual(self.value("shownTruth.frame"), wanted)
                self.assertEqual(self.value("shownTruth.facts.number"), wanted)
            self.assertIn(f"{at} of {len(kept)} kept", self.browser.text("held"))
            self.press("p", 80)
            until("it goes on", lambda: self.value("shownNumber()") > held["newest"])
            self.assertEqual(self.browser.complaints(), [])

    def test_the_history_is_bounded(self):
        with Run() as run:
            for _ in range(60):
                run.get("/frame.png?stretch=linear")
            head = run.state()["heads"][0]
            self.assertLessEqual(len(head["kept_frames"]), head["kept_at_most"])
            width, height = head["size_px"]
            self.assertLessEqual(head["kept_at_most"] * width * height * 2, 64 << 20)

    def test_events_and_timing_show_the_numbers_of_the_run(self):
        rows = lambda name: self.value(f"[...byId({name!r}).tBodies[0].rows].map((r) => [...r.cells].map((c) => c.textContent))")
        with self.shown(duration_s=7):
            until("the end", lambda: self.browser.text("status").startswith("run is over"))
            self.press("2", 50)
            state = self.value("lastState.run")
            counts = dict(zip(*[iter(self.value("[...byId('kinds').children].map((e) => e.textContent)"))] * 2))
            self.assertEqual(counts, {name.replace("_", " "): str(n) for name, n in state["events"].items()})
            self.assertIn("no time yet", counts, "the bench has this event at its start")
            newest = rows("newest")
            self.assertEqual(len(newest), min(sum(state["events"].values()), 24))
            for row, event in zip(newest, state["newest_events"]):
                self.assertEqual(row[:2], [event["utc"][11:23], event["kind"].replace("_", " ")])
            self.press("3", 51)
            timing = rows("timing")
            stages = [stage for stage in state["stages"] if stage["count"]]
            self.assertEqual([(row[0], row[1]) for row in timing], [(s["name"].replace("_", " "), str(s["count"])) for s in stages])
            last = next(row for row in timing if row[0] == "release to delivered")
            self.assertEqual(last[6], "100 ms", "the camera's time to the deadline")
            self.assertRegex(last[7], r"^[\d.e+]+ % (met|over)$")
            for stage in stages:
                self.assertEqual(sorted(stage["cumulative"]), stage["cumulative"])
                self.assertLessEqual(stage["cumulative"][-1][1], stage["count"])
            self.assertEqual(self.browser.complaints(), [])

    def test_every_control_has_a_name_and_the_keyboard_reaches_it(self):
        with Run() as run:
            self.opened(run, "phone")
            for page in PAGES:
                self.value(f"choosePage({page!r})")
                found = self.value(CONTROLS)
                self.assertEqual((found["nameless"], found["unmet"]), ([], []), page)
            self.value("choosePage('view')")
            self.value("document.activeElement.blur()")
            met = []
            for _ in range(60):
                self.press("Tab", 9)
                name = self.value("document.activeElement.id || document.activeElement.getAttribute('aria-labelledby')")
                if not name or name in met:
                    break
                met.append(name)
            for name in ("tab-view", "theme", "help-button", "stretch", "names-on", "frame-box", "pause", "back", "forth", "zoom-in"):
                self.assertIn(name, met)
            self.assertLess(met.index("stretch"), met.index("frame-box"))
            self.assertLess(met.index("frame-box"), met.index("pause"))
            self.value("document.body.append(document.createElement('button'))")
            self.assertEqual(len(self.value(CONTROLS)["nameless"]), 1, "control: a button without a name")

    def test_help_lists_the_keys_and_they_can_be_switched_off(self):
        with self.shown():
            self.press("?", 191)
            self.assertTrue(self.value("byId('help').open"))
            listed = self.value("[...document.querySelectorAll('#help dd')].map((e) => e.textContent)")
            self.assertEqual([name for name in self.value("KEYS.map((row) => row[1])") if name not in listed], [])
            self.value("byId('keys-on').click(), byId('help-close').click()")
            self.press("p", 80)
            self.assertEqual(self.value("byId('pause').ariaPressed"), "false")
            self.value("byId('keys-on').click()")
            self.press("p", 80)
            until("control: switched on again", lambda: self.value("byId('pause').ariaPressed") == "true")

    def test_colours_have_contrast_in_dark_and_light_as_the_system_asks(self):
        with Run() as run:
            grounds = set()
            for scheme in ("dark", "light"):
                features = [{"name": "prefers-color-scheme", "value": scheme}, {"name": "prefers-reduced-motion", "value": "reduce"}]
                self.browser.ask("Emulation.setEmulatedMedia", features=features)
                self.opened(run)
                found = self.value(CONTRASTS)
                self.assertLess(found.pop("control"), CONTRAST, "control: lines have little")
                self.assertGreaterEqual(min(found.values()), CONTRAST, (scheme, found))
                grounds.add(self.value("colour('ground')"))
                self.assertTrue(self.value("wantsLittleMotion.matches"))
                self.value("byId('theme').click()")
                self.assertGreaterEqual(min(v for k, v in self.value(CONTRASTS).items() if k != "control"), CONTRAST)
                grounds.add(self.value("colour('ground')"))
            self.assertEqual(len(grounds), 2, "dark and light")
            self.browser.ask("Emulation.setEmulatedMedia", features=[])


if __name__ == "__main__":
    unittest.main()
