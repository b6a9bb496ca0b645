"""The scenes and the contest of bench_peers.py: from peers_contest import hold. Needs numpy."""

import csv
import dataclasses
import json
import os
import statistics
import subprocess
import time

import numpy as np
from page import PROGRAM, machine
from peers import PEERS, TOO_SLOW, Cannot, version
from peers_loop import LOOPS

PROGRAMS = [*PEERS, *LOOPS]
"""The peers, and loops as bounds."""
LOWER = "V3"
"""The vector level at which starloop is measured too, where the processor has a better one: that of AVX2."""
MOST_FLUX = 0.01
"""Largest share of the flux that may be missing or too much."""
MOST_OFF = 0.2
"""Largest difference of one pixel, in units of the brightest pixel: a star that is one pixel off makes 0.4 and more."""
REAL_FIELD = {"camera": "cameras/star_tracker_20deg.toml", "ra": "83.8", "dec": "-1.2"}
CAMERA = """
name = "peers"
[detector]
width_px = {size}
height_px = {size}
pixel_pitch_um = 5.5
full_well_e = {full_well_e}
bits = 16
black_level_dn = {black_dn}
gain_e_per_dn = {gain_e_per_dn}
read_noise_e_rms = {read_noise_e}
dark_e_per_s = {dark_e_per_s}
dark_temperature_c = 20.0
prnu = {prnu}
dsnu_e_rms = {dsnu_e}
quantum_efficiency = 0.5
[optics]
focal_length_mm = 16.0
aperture_mm = 10.0
transmission = 0.8
[psf]
model = "gaussian"
sigma_px = {sigma_px}
[radiometry]
zero_magnitude_photons_per_s_m2 = 3.2e10
color_c1 = 0.0
color_c2 = 0.0
limiting_mag = 6.5
[exposure]
exposure_s = 0.1
readout_s = 0.02
"""


@dataclasses.dataclass
class Scene:
    """Stars, a path, and the detector's numbers for scenes with noise."""

    name: str
    size_px: int
    x: np.ndarray
    y: np.ndarray
    electrons: np.ndarray
    path: np.ndarray
    noise: bool = False
    sigma_px: float = 0.8
    full_well_e: float = 1e6
    dark_e: float = 3.0
    prnu: float = 0.01
    dsnu_e: float = 2.0
    read_noise_e: float = 10.0
    gain_e_per_dn: float = 16.0
    black_dn: float = 100.0

    @property
    def work(self):
        return len(self.x) * len(self.path)

    def shifted(self):
        """The same with its brightest star one pixel to the right."""
        x = self.x.copy()
        x[np.argmax(self.electrons)] += 1.0
        return dataclasses.replace(self, x=x)


def made_up(stars, size, positions, decades=1.3, noise=False, jitter_px=1.0):
    """A scene of random places; brightness over so many decades, all below the full well."""
    random = np.random.default_rng([stars, size, positions])
    x, y = random.uniform(-0.5, size - 0.5, (2, stars))
    electrons = 1e5 * 10.0 ** (-decades * random.uniform(0.0, 1.0, stars))
    path = random.normal(0.0, jitter_px, (positions, 2)) if positions > 1 else np.zeros((1, 2))
    path = (path - path.mean(axis=0)).clip(-3.0 * jitter_px, 3.0 * jitter_px)
    words = [f"{stars} stars", f"{size} px", f"{positions} position" + "s" * (positions > 1)]
    words += [f"{decades:g} decades"] * (decades > 2) + [f"jitter {jitter_px:g} px"] * (jitter_px != 1.0)
    return Scene(", ".join(words + ["full noise"] * noise), size, x, y, electrons, path, noise)


def real_field(folder, positions):
    """The stars that starloop's catalog has in a field, at the places of its truth table."""
    truth = folder / "field.csv"
    field = [word for key, value in REAL_FIELD.items() for word in (f"--{key}", value)]
    run("render", *field, "--stage", "electrons", "--truth", truth, "--out", folder / "field.fits")
    with open(truth, newline="") as file:
        stars = [row for row in csv.DictReader(file) if row["kind"] == "star"]
    x, y, electrons = (np.array([float(star[key]) for star in stars]) for key in ("x_px", "y_px", "electrons"))
    path = made_up(1, 1024, positions).path
    name = f"Orion, {len(x)} stars, 1024 px, {positions} position" + "s" * (positions > 1)
    return Scene(name, 1024, x, y, electrons, path, full_well_e=1e7)


def scenes(folder, quick):
    if quick:
        return [made_up(100, 1024, 1), made_up(500, 1024, 16), made_up(500, 1024, 1, noise=True)]
    sizes = [made_up(n, 1024, p) for n in (100, 2_000, 10_000) for p in (1, 16, 64)]
    dense = [made_up(n, 2048, p) for n in (100_000, 330_000) for p in (1, 16)]
    dense.append(made_up(330_000, 2048, 64, jitter_px=0.5))
    decades = [made_up(5_000, 1024, p, decades=4.0) for p in (1, 64)]
    noise = [made_up(100, 1024, 1, noise=True), made_up(2_000, 1024, 64, noise=True)]
    return [*sizes, *dense, *decades, *(real_field(folder, p) for p in (1, 64)), *noise]


def run(*arguments, level=None):
    environment = os.environ | ({"STARLOOP_VECTOR_LEVEL": level} if level else {})
    words = [str(part) for part in (PROGRAM, *arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise SystemExit(f"starloop {arguments}: exit {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def fits(path):
    """Pixels of a FITS image that starloop wrote: the first row is the top."""
    data = path.read_bytes()
    cards, at = {}, 0
    while "END" not in cards:
        card = data[at : at + 80].decode("ascii")
        cards[card[:8].strip()] = card[10:].split("/")[0].strip()
        at += 80
    kind = {"-64": ">f8", "-32": ">f4", "16": ">i2"}[cards["BITPIX"]]
    shape = int(cards["NAXIS2"]), int(cards["NAXIS1"])
    pixels = np.frombuffer(data, kind, shape[0] * shape[1], -(-at // 2880) * 2880).reshape(shape)
    return pixels.astype(np.float64) + float(cards.get("BZERO", 0.0))


class Starloop:
    """The program, on a scene: files are written and read outside of the time that it reports."""

    def __init__(self, folder):
        self.folder = folder

    def render(self, scene, backend, stage, level=None):
        camera, sources, path, out = (self.folder / name for name in ("camera.toml", "stars.csv", "path.csv", "image.fits"))
        numbers = {field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)}
        camera.write_text(CAMERA.format(size=scene.size_px, dark_e_per_s=scene.dark_e / 0.1, **numbers))
        stars = np.stack([scene.x, scene.y, scene.electrons], axis=1)
        np.savetxt(sources, stars, "%.17g", ",", header="x_px,y_px,electrons", comments="")
        motion = []
        if len(scene.path) > 1:
            rows = np.hstack([scene.path, np.zeros((len(scene.path), 1))])
            np.savetxt(path, rows, "%.17g", ",", header="dx_px,dy_px,roll_arcsec", comments="")
            motion = ["--los-samples", path]
        place = ["--camera", camera, "--ra", "0", "--dec", "0", "--sources", sources, *motion]
        # The reference is not timed: many repeats of it would take minutes.
        timed = ["--timing"] if backend != "reference" else []
        text = run("render", *place, "--backend", backend, "--stage", stage, *timed, "--out", out, level=level)
        return fits(out), json.loads(text.splitlines()[0]) if timed else {}

    def reference(self, scene):
        return self.render(scene, "reference", "electrons")[0]

    def measure(self, scene, level=None):
        """Mean image, digital numbers of scenes with noise, and milliseconds."""
        image, timing = self.render(scene, "cpu", "electrons", level)
        if level is None:
            self.device = timing["device"]
        elif f"vector level {level}" not in timing["device"]:
            raise SystemExit(f"wanted vector level {level}, got {timing['device']}")
        numbers = None
        if scene.noise:
            numbers, timing = self.render(scene, "cpu", "dn", level)
        return image, numbers, timing["plan_ms"] + timing["render_ms"] + timing["detector_ms"]


@dataclasses.dataclass
class Row:
    """One cell of the table."""

    scene: str
    program: str
    ms: float | None = None
    l1: float | None = None
    flux: float | None = None
    reason: str = ""


def l1(image, reference):
    return float(np.abs(image - reference).sum() / reference.sum())


def differs(image, reference):
    """Why an image is of another scene, or an empty text."""
    flux = float(image.sum() / reference.sum())
    if abs(flux - 1.0) > MOST_FLUX:
        return f"another scene: {flux:.4f} of the flux"
    off = float(np.abs(image - reference).max() / reference.max())
    return f"another scene: a pixel is {off:.2f} of the brightest one off" if off > MOST_OFF else ""


def noise_differs(numbers, reference, scene):
    """Why digital numbers are not those of the noise chain: mean and variance, of the dark pixels alone."""
    dark = reference < 1e-3
    e = (numbers[dark] - scene.black_dn) * scene.gain_e_per_dn
    variance = scene.dark_e + scene.dsnu_e**2 + scene.read_noise_e**2 + scene.gain_e_per_dn**2 / 12.0
    # Five standard errors, and what a rounded mean adds with coarse steps.
    sigma_mean = 5.0 * (variance / e.size) ** 0.5 + 0.1
    if abs(e.mean() - scene.dark_e) > sigma_mean:
        return f"dark pixels have {e.mean():.2f} e-, not {scene.dark_e}"
    return "" if abs(e.var() / variance - 1.0) < 0.05 else f"variance {e.var():.1f} e-^2, not {variance:.1f}"


WARM_UP_S = 0.05
"""As in `starloop render --timing`: until the system has given new threads a processor each."""


def median_ms(work, budget_s):
    """Warm-up as long as starloop's, then the median of 3 to 21 times within the budget; the first for slow ones."""
    begin = time.perf_counter()
    result = work()
    first_s = time.perf_counter() - begin
    while time.perf_counter() - begin < WARM_UP_S:
        result = work()
    times = []
    while len(times) < 21 and (len(times) < 3 or sum(times) < budget_s):
        if first_s > budget_s and times:
            break
        begin = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - begin)
    return result, 1e3 * statistics.median(times)


class Contest:
    """All programs on all scenes."""

    def __init__(self, folder, limit_s):
        self.starloop, self.limit_s, self.rows = Starloop(folder), limit_s, []
        self.peers, self.reasons, self.slowness = {}, {}, {}
        for peer in PROGRAMS:
            try:
                self.peers[peer.name] = peer()
            except Cannot as reason:
                self.reasons[peer.name] = str(reason)

    def control(self, scene):
        """Every peer draws the scene with a star that is off; returns those for which that was not found."""
        reference = self.starloop.reference(scene)
        drawn = {name: np.array(peer.prepare(scene.shifted())()) for name, peer in self.peers.items()}
        drawn["starloop"] = self.starloop.measure(scene.shifted())[0]
        return [name for name, image in drawn.items() if not differs(image, reference)]

    def draw(self, scene):
        reference = self.starloop.reference(scene)
        image, numbers, ms = self.starloop.measure(scene)
        self.add(scene, "starloop", image, numbers, ms, reference)
        if "vector level V4" in self.starloop.device:
            self.add(scene, f"starloop {LOWER}", *self.starloop.measure(scene, LOWER), reference)
        for name in [peer.name for peer in PROGRAMS]:
            if name in self.reasons:
                self.rows.append(Row(scene.name, name, reason=self.reasons[name]))
                continue
            try:
                self.add(scene, name, *self.of_peer(self.peers[name], scene), reference)
            except Cannot as reason:
                self.rows.append(Row(scene.name, name, reason=str(reason)))

    def of_peer(self, peer, scene):
        predicted_s = self.slowness.get(peer.name, 0.0) * scene.work
        if predicted_s > self.limit_s:
            raise Cannot(f"{TOO_SLOW}{predicted_s:.0f} s")
        work = peer.prepare(scene)
        noise = peer.noise(scene) if scene.noise else None
        image, ms = median_ms(work, self.limit_s / 4.0)
        image = np.array(image, np.float64)
        if scene.work >= 1000:
            self.slowness[peer.name] = 1e-3 * ms / scene.work
        if noise is None:
            return image, None, ms
        numbers, ms = median_ms(lambda: noise(work()), self.limit_s / 4.0)
        return image, np.array(numbers), ms

    def add(self, scene, name, image, numbers, ms, reference):
        reason = differs(image, reference)
        if not reason and numbers is not None:
            reason = noise_differs(numbers, reference, scene)
        row = Row(scene.name, name, None if reason else ms, l1(image, reference), float(image.sum() / reference.sum()), reason)
        print(f"{row.scene:45} {row.program:9} " + (row.reason or f"{row.ms:10.3f} ms  L1 {row.l1:.2e}"), flush=True)
        self.rows.append(row)

    def facts(self):
        """Machine, versions, threads and what a path costs, for the report."""
        return {
            "machine": f"{machine()}; starloop {self.starloop.device}",
            "peers": ", ".join(f"{peer.name} {version(peer.package)}" for peer in PEERS if peer.name in self.peers),
            "threads": ", ".join(f"{name} {peer.threads}" for name, peer in self.peers.items()),
            "motion": "; ".join(f"{peer.name}: {peer.motion}" for peer in PROGRAMS),
        }


def hold(folder, quick, limit_s):
    """Returns the contest after all its scenes; ends the program when the control finds no difference."""
    contest = Contest(folder, limit_s)
    missed = contest.control(made_up(100, 1024, 1))
    if missed:
        raise SystemExit(f"a star that is one pixel off was not found with {', '.join(missed)}")
    print(f"control: a star that is one pixel off is found with all of {['starloop', *contest.peers]}")
    for scene in scenes(folder, quick):
        contest.draw(scene)
    return contest
