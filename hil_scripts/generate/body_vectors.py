"""Makes tests/physics/bodies_vectors.csv: Sun, Moon and planets as others compute them.

    python3 hil_scripts/generate/body_vectors.py

Apparent directions by skyfield 1.55 with DE421 (skyfield-data 7.0.0): light time, aberration, deflection of light by the
Sun, Jupiter and Saturn, in ICRF axes. From the geocentre, and from a satellite that at every date has the state
(5000, 3000, -3500) km, (3.0, -6.0, 3.5) km/s from it. Magnitudes V of planets by skyfield's planetary_magnitude (Mallama
and Hilton 2018, with latitudes of Uranus; Mars as on average). For the Moon: phase angle and the position angle of the
middle of its bright limb, by the almanac's formula from skyfield's places. As a check of the script the geocentric
directions are compared with astropy's get_body with the same ephemeris: 0.05 arcsec.
Needs: numpy, astropy, skyfield, skyfield-data.
"""

import os
import sys
from pathlib import Path

import numpy as np
import skyfield_data
from astropy.coordinates import get_body, solar_system_ephemeris
from astropy.time import Time
from skyfield.api import Loader
from skyfield.magnitudelib import planetary_magnitude
from skyfield.vectorlib import VectorFunction

OUT = Path(__file__).resolve().parents[2] / "tests/physics/bodies_vectors.csv"
DATES = [
    (1991, 1, 17, 3), (1998, 5, 30, 20), (2005, 10, 9, 11), (2012, 6, 11, 7), (2020, 12, 1, 0),
    (2026, 3, 1, 12), (2037, 8, 23, 17), (2050, 11, 30, 6),
]  # fmt: skip
NEAR = {1991, 2012, 2026, 2050}  # seen from the satellite too
AU_KM = 149597870.7
DATA = os.path.join(os.path.dirname(skyfield_data.__file__), "data")
PLANETS = ["mercury", "venus", "mars", "jupiter barycenter", "saturn barycenter", "uranus barycenter", "neptune barycenter"]


class Satellite(VectorFunction):
    """At a fixed place from the geocentre, with a fixed velocity."""

    center, target = 399, -1

    def _at(self, t):
        shape = (3,) + t.shape
        position = np.broadcast_to((np.array([5000.0, 3000.0, -3500.0]) / AU_KM).reshape(3, *[1] * len(t.shape)), shape)
        velocity = np.broadcast_to((np.array([3.0, -6.0, 3.5]) * 86400 / AU_KM).reshape(3, *[1] * len(t.shape)), shape)
        return position.copy(), velocity.copy(), None, None


def bright_limb_deg(moon, sun):
    """Position angle of the middle of the Moon's bright limb, from north over east (Meeus, chapter 48)."""
    (ra, dec, _), (ra0, dec0, _) = moon.radec(), sun.radec()
    ra, dec, ra0, dec0 = ra.radians, dec.radians, ra0.radians, dec0.radians
    east = np.cos(dec0) * np.sin(ra0 - ra)
    north = np.sin(dec0) * np.cos(dec) - np.cos(dec0) * np.sin(dec) * np.cos(ra0 - ra)
    return np.degrees(np.arctan2(east, north)) % 360


def main():
    load = Loader(DATA)
    ts, bodies = load.timescale(builtin=True), load("de421.bsp")
    solar_system_ephemeris.set(os.path.join(DATA, "de421.bsp"))
    rows, worst = [], 0.0
    for year, month, day, hour in DATES:
        t = ts.utc(year, month, day, hour)
        utc = f"{year}-{month:02}-{day:02}T{hour:02}:00:00Z"
        observers = [("geocentre", bodies["earth"])]
        if year in NEAR:
            observers.append(("satellite", bodies["earth"] + Satellite()))
        for place, observer in observers:
            sun = observer.at(t).observe(bodies["sun"]).apparent()
            for name in ["sun", "moon", *PLANETS]:
                astrometric = observer.at(t).observe(bodies[name])
                apparent = astrometric.apparent()
                x, y, z = apparent.xyz.au / np.linalg.norm(apparent.xyz.au)
                distance_km = astrometric.distance().km
                word = name.split()[0]
                mag = planetary_magnitude(astrometric) if name in PLANETS else np.nan
                if place == "geocentre":
                    other = get_body(word, Time(utc[:-1], scale="utc")).cartesian.xyz.value
                    off = np.degrees(np.linalg.norm(np.cross([x, y, z], other)) / np.linalg.norm(other)) * 3600
                    elongation = np.degrees(np.arccos(np.dot([x, y, z], sun.xyz.au / np.linalg.norm(sun.xyz.au))))
                    if elongation > 5:
                        worst = max(worst, off)
                phase_deg, limb_deg = np.nan, np.nan
                if name == "moon":
                    phase_deg = apparent.phase_angle(bodies["sun"]).degrees
                    limb_deg = bright_limb_deg(apparent, sun)
                rows.append(
                    f"{utc},{place},{word},{x:.11f},{y:.11f},{z:.11f},{distance_km:.1f},{mag:.3f},{phase_deg:.4f},{limb_deg:.4f}"
                )
    print(f"against astropy: {worst:.4f} arcsec at most, more than 5 deg from the Sun")
    if worst > 0.05:
        sys.exit("skyfield and astropy differ")
    provenance = "# skyfield 1.55, DE421 (skyfield-data 7.0.0); made by hil_scripts/generate/body_vectors.py\n"
    head = "utc,observer,body,x,y,z,distance_km,v_mag,phase_deg,bright_limb_deg\n"
    OUT.write_text(provenance + head + "\n".join(rows) + "\n")
    print(f"{len(rows)} rows")


if __name__ == "__main__":
    main()
