"""Tests of targets on the sky against skyfield: python3 hil_scripts/tests/test_targets.py

The elements of the crossing bench are followed by skyfield (SGP4, TEME to ICRF with precession, nutation and bias,
light time, aberration), with the barycentric Earth of erfa, and projected by a pinhole with distortion written here.
These are compared with the end points that the program reports for each streak, and those fitted to its images' pixels.
"""

import math
import tomllib
import unittest

import erfa
import numpy
from astropy.io import fits
from skyfield.api import EarthSatellite, load
from skyfield.constants import AU_KM, DAY_S
from skyfield.relativity import add_aberration
from skyfield.vectorlib import VectorFunction

from support import ROOT, InAFolder, folder_for, rows_of, starloop

BENCH = ROOT / "configs/benches/target_crossing.toml"
SECOND_OBSERVER = (  # invented, as the target's: 550 km high, on nearly the way of the bench's circle
    "1 90002U 26002A   26060.00000000  .00000100  00000-0  50000-4 0  9995",
    "2 90002  97.6000 184.3000 0005000   0.0000 114.1000 15.05560000  1006",
)
GEOSTATIONARY = (  # invented
    "1 90003U 26003A   26060.00000000  .00000000  00000-0  00000-0 0  9997",
    "2 90003   0.1000  80.0000 0002000  10.0000 200.0000  1.00270000  1009",
)
# Allowed error of a narrow camera's pixels.
END_PX = 0.05
TIME = load.timescale(builtin=True)
TAI_MINUS_UTC_S = 37.0


class Earth(VectorFunction):
    """The Earth's barycentric state by erfa."""

    center, target = 0, 399
    ephemeris = None

    def _at(self, t):
        _, state = erfa.epv00(t.whole, t.tdb_fraction)
        velocity = numpy.array(state["v"])
        return numpy.array(state["p"]), velocity, None, None


class Circle(VectorFunction):
    """A circle about the geocentre: node, inclination and angle from the node at the first exposure, deg."""

    center, target = 399, -1
    ephemeris = None

    def __init__(self, settings, epoch):
        self.radius_km = 6378.137 + settings["altitude_km"]
        self.angles = [math.radians(settings[key]) for key in ("inclination_deg", "raan_deg", "argument_of_latitude_deg")]
        self.epoch = epoch

    def _at(self, t):
        seconds = ((t.whole - self.epoch.whole) + (t.tt_fraction - self.epoch.tt_fraction)) * DAY_S
        inclination, node, begin = self.angles
        rate = math.sqrt(398600.4418 / self.radius_km**3)
        u = begin + rate * seconds
        towards_node = numpy.array([math.cos(node), math.sin(node), 0.0])
        later = numpy.array([-math.sin(node) * math.cos(inclination), math.cos(node) * math.cos(inclination), math.sin(inclination)])
        position = self.radius_km * (towards_node * math.cos(u) + later * math.sin(u))
        velocity = self.radius_km * rate * (later * math.cos(u) - towards_node * math.sin(u))
        return position / AU_KM, velocity / AU_KM * DAY_S, None, None


class NoNutation(VectorFunction):
    """A satellite whose TEME is taken as the mean equator and equinox of date: the control."""

    center, target = 399, -2
    ephemeris = None

    def __init__(self, satellite):
        self.satellite = satellite

    def _at(self, t):
        position, velocity, _ = self.satellite._position_and_velocity_TEME_km(t)
        from_mean = t.precession_matrix().T
        return from_mean @ position / AU_KM, from_mean @ velocity / AU_KM * DAY_S, None, None


def tai(ns):
    """An instant by nanoseconds of TAI since 1970."""
    days, rest = divmod(ns, 86_400 * 10**9)
    return TIME.tai_jd(2440587.5 + days, rest / (86_400 * 1e9))


def apparent(observer, target, t, light_time=True, aberration=True):
    """Apparent direction, ICRF axes; what is left out is a control."""
    here = (Earth() + observer if observer is not None else Earth()).at(t)
    if light_time:
        seen = here.observe(Earth() + target)
        place, delay = seen.xyz.au.copy(), seen.light_time
    else:
        # The Earth's motion within the light time stays in: without it aberration would be too much by 20 arcsec.
        far = (Earth() + target).at(t)
        place = far.xyz.au - here.xyz.au
        delay = numpy.linalg.norm(place) / 173.14463267424034
        place = place - Earth().at(t).velocity.au_per_d * delay
    if aberration:
        add_aberration(place, here.velocity.au_per_d, delay)
    return place / numpy.linalg.norm(place)


def quaternion_matrix(w, x, y, z):
    """Scalar first, v_sensor = q v_icrf q*: v_sensor = R v_icrf."""
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def north_up_matrix(ra_deg, dec_deg):
    """Sensor axes with north up and east to the left."""
    ra, dec = math.radians(ra_deg), math.radians(dec_deg)
    east = numpy.array([-math.sin(ra), math.cos(ra), 0.0])
    north = numpy.array([-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec)])
    return numpy.array([-east, -north, numpy.cross(east, north)])


def projected(camera, sensor_from_icrf, direction):
    """Pinhole and radial distortion; the first pixel's centre is (0, 0)."""
    x, y, z = sensor_from_icrf @ direction
    x, y = x / z, y / z
    r2 = x * x + y * y
    stretch = 1 + r2 * camera.get("distortion", {}).get("k1", 0.0)
    detector = camera["detector"]
    focal_px = camera["optics"]["focal_length_mm"] / (detector["pixel_pitch_um"] * 1e-3)
    middle = [(detector[side] - 1) / 2 for side in ("width_px", "height_px")]
    return numpy.array([middle[0] + focal_px * stretch * x, middle[1] + focal_px * stretch * y])


def bench_with(folder, name, *changes):
    """The crossing bench with other lines, recorded below `folder`."""
    text = BENCH.read_text().replace('"../', f'"{ROOT}/configs/')
    for old, new in (('directory = "out/target_crossing"', f'directory = "{folder / name}"'), ("png_every = 4\n", ""), *changes):
        assert old in text, old
        text = text.replace(old, new)
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def observer_lines():
    """The lines of the bench's observer."""
    text = BENCH.read_text()
    begin = text.index("[observer]")
    return text[begin:text.index("\n\n", begin)]


def run(bench):
    starloop("run", bench, "--clock", "virtual", "--backend", "cpu", status=0)


class Recording:
    """Frames with targets of one run."""

    def __init__(self, folder, exposure_s):
        self.frames = []
        for path in sorted(folder.rglob("*.targets.csv")):
            [row] = rows_of(path)
            image = path.with_name(path.name.replace("targets.csv", "fits"))
            truth = path.with_name(path.name.replace("targets.csv", "truth.csv"))
            with fits.open(image) as file:
                header, pixels = file[0].header, file[0].data.astype(float)
            [smear] = [star for star in rows_of(truth) if star["kind"] == "target"]
            mid_ns = int(header["MID_NS"])
            ends = [tai(mid_ns + round(side * exposure_s * 5e8)) for side in (-1, 1)]
            reported = [numpy.array([float(row[f"x_{end}_px"]), float(row[f"y_{end}_px"])]) for end in ("begin", "end")]
            self.frames.append((header, pixels, smear, row, ends, reported))


def whole_in_image(ends, shape, margin=12):
    return all(margin < px[0] < shape[1] - margin and margin < px[1] < shape[0] - margin for px in ends)


def streak(grid, ends, sigma):
    """Light of a point that goes evenly from end to end, Gaussian of sigma: pixels over their sum."""
    steps = numpy.linspace(0, 1, 161)
    weights = numpy.ones(161)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    weights /= weights.sum()
    x, y = grid
    image = numpy.zeros(x.shape)
    for share, weight in zip(steps, weights):
        px = ends[:2] * (1 - share) + ends[2:] * share
        image += weight * numpy.exp(-((x - px[0]) ** 2 + (y - px[1]) ** 2) / (2 * sigma**2))
    return image / (2 * math.pi * sigma**2)


def fitted_ends(pixels, begin, end, sigma):
    """End points of the streak near these, by least squares over its ends, light and background."""
    corners = numpy.array([begin, end])
    low = numpy.maximum(numpy.floor(corners.min(0)).astype(int) - 8, 0)
    high = numpy.ceil(corners.max(0)).astype(int) + 9
    part = pixels[low[1]:high[1], low[0]:high[0]]
    y, x = numpy.mgrid[low[1]:low[1] + part.shape[0], low[0]:low[0] + part.shape[1]].astype(float)
    ends = numpy.concatenate([begin, end]).astype(float)
    # A pixel collects over its square: a twelfth of it adds to the variance.
    wide = math.sqrt(sigma**2 + 1 / 12)
    for _ in range(8):
        shape = streak((x, y), ends, wide)
        columns = numpy.stack([shape.ravel(), numpy.ones(shape.size)], 1)
        light, background = numpy.linalg.lstsq(columns, part.ravel(), rcond=None)[0]
        slopes = []
        for i in range(4):
            more = ends.copy()
            more[i] += 0.01
            slopes.append(light * (streak((x, y), more, wide) - shape).ravel() / 0.01)
        columns = numpy.stack([*slopes, shape.ravel(), numpy.ones(shape.size)], 1)
        step = numpy.linalg.lstsq(columns, part.ravel() - light * shape.ravel() - background, rcond=None)[0]
        ends += numpy.clip(step[:4], -1, 1)
    return ends[:2], ends[2:]


class Crossing(unittest.TestCase):
    """The bench of the narrow tracker: 24 arcsec per pixel."""

    @classmethod
    def setUpClass(cls):
        root = folder_for(cls)
        cls.bench = tomllib.loads(BENCH.read_text())
        cls.camera = tomllib.loads((BENCH.parent / cls.bench["camera"]).read_text())
        cls.exposure_s = cls.camera["exposure"]["exposure_s"]
        [target] = cls.bench["target"]
        cls.satellite = EarthSatellite(target["line1"], target["line2"], None, TIME)
        cls.first = TIME.utc(2026, 3, 1, 0, 0, 1.0)
        # Ten metres across: bright enough to measure hundredths of a pixel.
        larger = ("diameter_m = 1.5", "diameter_m = 10.0")
        run(bench_with(root, "circle", larger))
        lines = f'[observer]\nkind = "tle"\nline1 = "{SECOND_OBSERVER[0]}"\nline2 = "{SECOND_OBSERVER[1]}"'
        run(bench_with(root, "elements", larger, (observer_lines(), lines)))
        cls.recorded = {name: Recording(root / name, cls.exposure_s) for name in ("circle", "elements")}
        cls.observers = {
            "circle": Circle(cls.bench["observer"], cls.first),
            "elements": EarthSatellite(*SECOND_OBSERVER, None, TIME),
        }

    def wanted(self, name, t, target=None, **left_out):
        computer = self.bench["flight_computer"]
        sensor_from_icrf = north_up_matrix(computer["ra_deg"], computer["dec_deg"])
        direction = apparent(self.observers[name], target or self.satellite, t, **left_out)
        return projected(self.camera, sensor_from_icrf, direction)

    def worst_px(self, name, **left_out):
        """Returns the largest distance of a reported end point from skyfield's."""
        off = [
            numpy.linalg.norm(self.wanted(name, t, **left_out) - px)
            for *_, ends, reported in self.recorded[name].frames
            for t, px in zip(ends, reported)
        ]
        return max(off)

    def test_end_points_are_those_of_skyfield(self):
        for name in self.recorded:
            self.assertGreater(len(self.recorded[name].frames), 12, "control: it is in the field for some seconds")
            worst = self.worst_px(name)
            print(f"{name}: end points within {worst:.4f} px of skyfield's, {len(self.recorded[name].frames)} frames")
            self.assertLess(worst, END_PX)

    def test_leaving_out_any_effect_is_noticed(self):
        for name in self.recorded:
            self.assertGreater(self.worst_px(name, light_time=False), END_PX, "light time")
            self.assertGreater(self.worst_px(name, aberration=False), END_PX, "aberration")
            self.assertGreater(self.worst_px(name, target=NoNutation(self.satellite)), END_PX, "nutation")

    def test_pixels_show_the_streak_where_it_is_reported(self):
        sigma = self.camera["psf"]["sigma_px"]
        off = []
        for _, pixels, smear, _, ends, reported in self.recorded["circle"].frames:
            if not whole_in_image(reported, pixels.shape):
                continue
            begin, end = fitted_ends(pixels, *reported, sigma)
            off.append([begin - self.wanted("circle", ends[0]), end - self.wanted("circle", ends[1])])
            length, angle = numpy.linalg.norm(end - begin), math.degrees(math.atan2(*(end - begin)[::-1]))
            self.assertLess(abs(length - float(smear["smear_px"])), 0.2)
            turned = (angle - float(smear["smear_deg"]) + 180) % 360 - 180
            self.assertLess(abs(turned), 0.5)
        off = numpy.array(off)
        self.assertGreater(len(off), 10)
        print(f"pixels: end points off by {numpy.abs(off.mean(0)).max():.3f} px in the mean, {off.std(0).max():.3f} px scatter")
        # Shot noise of some hundredths each, PRNU, and the curve of the way that a straight streak leaves out.
        self.assertLess(numpy.abs(off.mean(0)).max(), END_PX)
        self.assertLess(off.std(0).max(), END_PX)

    def test_range_and_rates_are_those_of_skyfield(self):
        for header, _, _, row, _, _ in self.recorded["elements"].frames:
            t = tai(int(header["MID_NS"]))
            between = (self.satellite - self.observers["elements"]).at(t)
            place, velocity = between.xyz.km, between.velocity.km_per_s
            distance = numpy.linalg.norm(place)
            # Light time: 2 ms of up to 11 km/s.
            self.assertLess(abs(float(row["range_km"]) - distance), 0.05)
            self.assertLess(abs(float(row["range_rate_km_s"]) - place @ velocity / distance), 1e-3)
            rate = math.degrees(numpy.linalg.norm(numpy.cross(place, velocity)) / distance**2)
            self.assertLess(abs(float(row["rate_deg_s"]) / rate - 1), 1e-3)


class Geostationary(InAFolder):
    """The telescope of an arcsecond per pixel, from the geocentre: SGP4's deep space, 15 px in an exposure."""

    def test_end_points_are_those_of_skyfield(self):
        root = self.folder
        camera_file = ROOT / "configs/cameras/wide_field_telescope.toml"
        camera = tomllib.loads(camera_file.read_text())
        satellite = EarthSatellite(*GEOSTATIONARY, None, TIME)
        x, y, z = apparent(None, satellite, TIME.utc(2026, 3, 1, 0, 0, 4.0))
        [target] = tomllib.loads(BENCH.read_text())["target"]
        bench = bench_with(
            root, "telescope",
            (f"{ROOT}/configs/cameras/cubesat_tracker.toml", str(camera_file)),
            ("frame_rate_hz = 2.0\nduration_s = 10.0", "frame_rate_hz = 0.5\nduration_s = 6.0"),
            (observer_lines(), '[observer]\nkind = "geocentre"'),
            ("ra_deg = 115.4 ", f"ra_deg = {math.degrees(math.atan2(y, x)) % 360!r} "),
            ("dec_deg = 30.6", f"dec_deg = {math.degrees(math.asin(z))!r}"),
            (target["line1"], GEOSTATIONARY[0]), (target["line2"], GEOSTATIONARY[1]),
        )
        run(bench)
        frames = Recording(root / "telescope", camera["exposure"]["exposure_s"]).frames
        self.assertEqual(len(frames), 3)
        off = []
        for header, *_, ends, reported in frames:
            # The attitude as it came over the bus: its single precision is 0.03 px here.
            sensor_from_icrf = quaternion_matrix(*(header[f"Q{axis}"] for axis in "WXYZ"))
            for t, px in zip(ends, reported):
                off.append(numpy.linalg.norm(projected(camera, sensor_from_icrf, apparent(None, satellite, t)) - px))
        print(f"geostationary: end points within {max(off):.4f} px of skyfield's, an arcsecond each")
        self.assertLess(max(off), END_PX)


class Check(InAFolder):
    def test_check_reports_the_crossing(self):
        done = starloop("check", BENCH, status=0)
        [line] = [line for line in done.stdout.splitlines() if line.strip().startswith("90001 ")]
        self.assertTrue(line.endswith("sunlit"), line)

    def test_bad_elements_are_refused_with_their_place(self):
        [target] = tomllib.loads(BENCH.read_text())["target"]
        lines = f'line1 = "{target["line1"]}"\nline2 = "{target["line2"]}"'
        root = self.folder
        (root / "one.json").write_text('[\n{"NORAD_CAT_ID": 90001,\n')
        def renumbered(line):
            line = line.replace("90001", "90002")[:68]
            return line + str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)

        both = [target["line1"], target["line2"], renumbered(target["line1"]), renumbered(target["line2"])]
        (root / "many.tle").write_text("\n".join(both) + "\n")
        for case, changes, wanted in [
            ("flipped", [("66.0000 311", "66.0001 311")], "line 2: wanted checksum 7 in column 69"),
            ("cut", [('orbit = "tle" ', 'orbit = "omm" '), (lines, 'file = "one.json"')], "line 3, column"),
            ("many", [(lines, 'file = "many.tle"')], "got 2 objects, wanted one"),
            ("absent", [(lines, 'file = "many.tle"\nnorad_id = 5')], "number 5, got none among 2"),
        ]:
            bench = bench_with(root, case, *changes)
            done = starloop("check", bench)
            self.assertNotEqual(done.returncode, 0, case)
            self.assertIn(wanted, done.stderr)
            self.assertIn("target[0]", done.stderr)


if __name__ == "__main__":
    unittest.main()
