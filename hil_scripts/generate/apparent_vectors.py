#!/usr/bin/env python3
"""Apparent places by ERFA and JPL's DE421, as vectors for tests/physics/apparent_vectors.rs.

    pip install pyerfa==2.0.1.5 astropy==8.0.2 skyfield==1.55 skyfield-data==7.0.0 sgp4==2.27
    python3 hil_scripts/generate/apparent_vectors.py > tests/physics/apparent_vectors.csv

Nothing of starloop is used. Stars: space motion and parallax by erfa.pmpx (no radial velocity), deflection by
erfa.ldsun, aberration by erfa.ab. Earth, Sun and Moon: DE421. Orbits: formulae written here, or the Python package sgp4
with skyfield's TEME. For the geocentre the same places by astropy (SkyCoord -> GCRS, Earth and Sun by epv00) are held
against them, with its worst difference on stderr.
"""

import sys
import warnings
from importlib.metadata import version

import erfa
import numpy as np
from astropy import units as u
from astropy.coordinates import GCRS, SkyCoord, solar_system_ephemeris
from astropy.time import Time
from sgp4.api import WGS72, Satrec
from skyfield.api import Loader
from skyfield.sgp4lib import TEME
from skyfield_data import get_skyfield_data_path

AU_KM, DAY_S, C_KM_S = 149597870.7, 86400.0, 299792.458
GM = {"earth": 398600.4418, "moon": 4902.800118, "sun": 132712440041.27942}
RADIUS_KM = 6378.137
MAS = np.pi / 180 / 3600e3

DATES = [
    "1991-01-02T00:00:00", "1999-12-31T23:59:30", "2000-06-28T18:50:19", "2008-09-21T03:10:00",
    "2016-12-31T23:59:59", "2026-03-01T12:00:00", "2035-09-12T09:00:00", "2050-12-30T18:00:00",
]
# ra deg, dec deg, pm ra cos dec mas/yr, pm dec mas/yr, parallax mas, at J2016.0.
STARS = {
    "quiet": (10.0, 0.0, 0.0, 0.0, 0.0),
    "north pole": (37.0, 89.99, 40.0, -12.0, 7.5),
    "south pole": (211.0, -89.97, -30.0, 25.0, 1.2),
    "Barnard": (269.45, 4.69, -802.8, 10362.5, 547.45),
    "alpha Cen": (219.87, -60.83, -3679.25, 473.67, 750.81),
    "61 Cyg": (316.75, 38.76, 4133.05, 3201.78, 286.0),
    "Sirius": (101.2846, -16.7216, -546.01, -1223.07, 379.21),
    "galactic": (266.4, -28.94, 2.1, -3.4, 0.3),
}
NEAR_SUN_DEG = [2.0, 5.0, 10.0, 20.0]
VANGUARD = ("1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753",
            "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667")
ISS = ("1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
       "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537")


def ellipse(a_km, e, i, node, periapsis, mean, gm, seconds):
    """Position and velocity `seconds` after the mean anomaly was `mean`."""
    anomaly = mean + np.sqrt(gm / a_km**3) * seconds
    eccentric = anomaly
    for _ in range(60):
        eccentric -= (eccentric - e * np.sin(eccentric) - anomaly) / (1 - e * np.cos(eccentric))
    s, c = np.sin(eccentric), np.cos(eccentric)
    b = np.sqrt(1 - e * e)
    rate = np.sqrt(gm / a_km) / (1 - e * c)
    turn = lambda angle, axis: erfa.rv2m(np.array(axis, float) * angle)
    # rv2m turns axes; the transpose turns vectors.
    to_icrf = (turn(node, [0, 0, 1]).T @ turn(i, [1, 0, 0]).T @ turn(periapsis, [0, 0, 1]).T)
    return to_icrf @ [a_km * (c - e), a_km * b * s, 0], to_icrf @ [-rate * s, rate * b * c, 0]


def seconds_from(epoch, at):
    """SI seconds between two UTC times."""
    return (Time(at, scale="utc").tai - Time(epoch, scale="utc").tai).to_value("s")


class Bodies:
    def __init__(self):
        load = Loader(get_skyfield_data_path(), expire=False)
        self.scale, self.jpl = load.timescale(builtin=True), load("de421.bsp")

    def time(self, at):
        return self.scale.from_astropy(Time(at, scale="utc"))

    def state(self, body, at):
        there = self.jpl[body].at(self.time(at))
        return there.position.km, there.velocity.km_per_s


def observer_state(bodies, name, at):
    """Barycentric position (km) and velocity (km/s)."""
    epoch = at[:4] + "-01-01T00:00:00"
    if name in ("vanguard", "iss"):
        satellite = Satrec.twoline2rv(*(VANGUARD if name == "vanguard" else ISS), WGS72)
        day = Time(at, scale="utc")
        error, r, v = satellite.sgp4(day.jd1, day.jd2)
        assert error == 0, name
        turn = TEME.rotation_at(bodies.time(at)).T
        centre, (r, v) = "earth", (turn @ r, turn @ v)
    else:
        deg = np.pi / 180
        centre, orbit = {
            "geocentre": ("earth", None),
            # Circular, 550 km, 97.6 deg, node 30, 10 deg past it at the epoch.
            "low": ("earth", (RADIUS_KM + 550, 0.0, 97.6 * deg, 30 * deg, 0.0, 10 * deg)),
            "lunar distance": ("earth", (384400.0, 0.3, 20 * deg, 80 * deg, 10 * deg, 50 * deg)),
            "about the moon": ("moon", (37000.0, 0.9, 88 * deg, 12 * deg, 86 * deg, 180 * deg)),
            "about the sun": ("sun", (1.9e8, 0.35, 25 * deg, 140 * deg, 240 * deg, 30 * deg)),
        }[name]
        r, v = (0.0, 0.0) if orbit is None else ellipse(*orbit, GM[centre], seconds_from(epoch, at))
    R, V = bodies.state(centre, at)
    return R + r, V + v


def unit(v):
    return v / np.linalg.norm(v)


def place(star, at, observer, sun_km):
    """Apparent direction with and without deflection."""
    ra, dec, pm_ra, pm_dec, parallax = star
    ra, dec = np.radians(ra), np.radians(dec)
    (r, v), tdb = observer, Time(at, scale="utc").tdb
    years = ((tdb.jd1 - 2451545.0) + tdb.jd2) / 365.25 - 16.0
    p = erfa.pmpx(ra, dec, pm_ra * MAS / np.cos(dec), pm_dec * MAS, parallax / 1e3, 0.0, years, r / AU_KM)
    from_sun = r - sun_km
    distance = np.linalg.norm(from_sun)
    beta = v / C_KM_S
    bm1 = np.sqrt(1 - beta @ beta)
    see = lambda direction: erfa.ab(direction, beta, distance / AU_KM, bm1)
    return see(erfa.ldsun(p, from_sun / distance, distance / AU_KM)), see(p)


def by_astropy(star, at):
    ra, dec, pm_ra, pm_dec, parallax = star
    pm = dict(pm_ra_cosdec=pm_ra * u.mas / u.yr, pm_dec=pm_dec * u.mas / u.yr, radial_velocity=0 * u.km / u.s)
    far = dict(distance=(max(parallax, 1e-6) * u.mas).to(u.pc, u.parallax()))
    coord = SkyCoord(ra * u.deg, dec * u.deg, obstime=Time(2016.0, format="jyear", scale="tdb"), **pm, **far)
    when = Time(at, scale="utc")
    with solar_system_ephemeris.set("builtin"):
        seen = coord.apply_space_motion(new_obstime=when.tdb).transform_to(GCRS(obstime=when))
    return unit(seen.cartesian.xyz.to_value(u.pc))


def beside_sun(angle_deg, at, observer, sun_km):
    """A star without motion at this angle from the Sun, as ra and dec."""
    to_sun = unit(sun_km - observer[0])
    across = unit(np.cross(to_sun, [0.3, -0.2, 0.9]))
    angle = np.radians(angle_deg)
    x, y, z = np.cos(angle) * to_sun + np.sin(angle) * across
    return (round(float(np.degrees(np.arctan2(y, x)) % 360), 6), round(float(np.degrees(np.arcsin(z))), 6), 0.0, 0.0, 0.0)


def cases():
    for number, at in enumerate(DATES):
        observers = ["geocentre", "low", "lunar distance", "about the moon", "about the sun"]
        observers += [["vanguard"], ["iss"]][number - 2] if number in (2, 3) else []
        for which, observer in enumerate(observers):
            names = list(STARS)
            # All stars from the geocentre; elsewhere three in rotation, one of them fast.
            chosen = names if which == 0 else [names[(number + which + k) % len(names)] for k in (0, 3)]
            for name in dict.fromkeys(chosen + ["Barnard" if number % 2 else "alpha Cen"]):
                yield at, observer, name
            yield at, observer, NEAR_SUN_DEG[(number + which) % 4]


def main():
    warnings.simplefilter("ignore")
    bodies, worst = Bodies(), 0.0
    packages = ["pyerfa", "astropy", "skyfield", "skyfield-data", "sgp4"]
    print("# By hil_scripts/generate/apparent_vectors.py with", ", ".join(f"{p} {version(p)}" for p in packages), "and DE421.")
    print("# Star at J2016.0: deg, deg, mas/yr (with cos dec), mas/yr, mas. Apparent direction, ICRF axes, with the")
    print("# deflection of light by the Sun, and without.")
    print("utc,observer,star,ra_deg,dec_deg,pm_ra_cosdec_mas_yr,pm_dec_mas_yr,parallax_mas,x,y,z,x_unbent,y_unbent,z_unbent")
    for at, observer, name in cases():
        state = observer_state(bodies, observer, at)
        sun_km = bodies.state("sun", at)[0]
        star = STARS[name] if isinstance(name, str) else beside_sun(name, at, state, sun_km)
        bent, unbent = place(star, at, state, sun_km)
        if observer == "geocentre":
            worst = max(worst, np.linalg.norm(by_astropy(star, at) - bent) / MAS)
        label = name if isinstance(name, str) else f"{name:g} deg from the Sun"
        numbers = [repr(x) for x in star] + [f"{x:.12f}" for x in (*bent, *unbent)]
        print(",".join([at + "Z", observer, label, *numbers]))
    print(f"worst difference from astropy, geocentre: {worst:.3f} mas", file=sys.stderr)


if __name__ == "__main__":
    main()
