"""Makes src/sky/ephemeris/de421_1990_2052.table: Chebyshev polynomials of the Moon and the planets, and measures them.

    python3 hil_scripts/generate/make_ephemeris_table.py [--check]

Source: JPL's planetary ephemeris DE421 (Folkner, Williams and Boggs 2009, IPN Progress Report 42-178), as the package
skyfield-data 7.0.0 carries it (de421.bsp); JPL ephemerides are works of the US government and in the public domain.
Needs: numpy, jplephem, skyfield-data. The Moon is geocentric, planets (systems' barycentres) are heliocentric, in ICRF
axes, km; time is TDB, days since J2000.0. The layout is described in src/sky/ephemeris/mod.rs. With --check the file that
is there must be the one that would be written.
"""

import argparse
import os
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import skyfield_data
from jplephem.spk import SPK
from numpy.polynomial import chebyshev

TABLE = Path(__file__).resolve().parents[2] / "src/sky/ephemeris/de421_1990_2052.table"
J2000_JD = 2451545.0
# 1989-12-28 to 2052-01-08. The last granule of a body may go on beyond the end (DE421 itself ends in October 2053).
FIRST_DAY, LAST_DAY = -3656, 19000
# Body, days of a granule, step of a coefficient in km.
BODIES = [
    ("moon", 8, 0.05),
    ("mercury", 16, 4.0),
    ("venus", 32, 4.0),
    ("mars", 64, 8.0),
    ("jupiter", 256, 30.0),
    ("saturn", 512, 60.0),
    ("uranus", 512, 100.0),
    ("neptune", 512, 100.0),
]
CODE = {"mercury": 1, "venus": 2, "mars": 4, "jupiter": 5, "saturn": 6, "uranus": 7, "neptune": 8}
# Magic, version, CRC-32 of the file with this field zero, first and last day, number of bodies.
HEAD = struct.Struct("<8sIIddI4x")
# Body, place of its data, days and km of a step, granules, coefficients of 32 and of 16 bits an axis.
ROW = struct.Struct("<IIddIII4x")
SAMPLES = 32  # Chebyshev nodes that a granule is fitted to


def positions(spk, body, days):
    jd = J2000_JD + days
    if body == "moon":
        return (spk[3, 301].compute(jd) - spk[3, 399].compute(jd))[:3]
    return (spk[0, CODE[body]].compute(jd) - spk[0, 10].compute(jd))[:3]


def fitted(spk, body, granule_d):
    """Coefficients [granule, axis, order], km."""
    nodes = np.cos(np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)
    transform = np.linalg.pinv(chebyshev.chebvander(nodes, SAMPLES - 1))
    count = -(-(LAST_DAY - FIRST_DAY) // granule_d)
    starts = FIRST_DAY + granule_d * np.arange(count)
    days = starts[:, None] + (nodes + 1) / 2 * granule_d
    xyz = positions(spk, body, days.ravel()).reshape(3, count, SAMPLES)
    return np.einsum("oj,agj->gao", transform, xyz)


def packed(spk):
    rows, data = [], b""
    heads = HEAD.size + ROW.size * len(BODIES)
    for body, granule_d, step_km in BODIES:
        steps = np.rint(fitted(spk, body, granule_d) / step_km).astype(np.int64)
        most = np.abs(steps).max(axis=(0, 1))
        orders = int(np.nonzero(most)[0].max()) + 1
        # Orders from here on fit into 16 bits.
        wide = next(o for o in range(orders + 1) if most[o:].max(initial=0) < 2**15)
        rows.append(ROW.pack(CODE.get(body, 10), heads + len(data), granule_d, step_km, len(steps), wide, orders - wide))
        for granule in steps:
            for axis in granule:
                data += axis[:wide].astype("<i4").tobytes() + axis[wide:orders].astype("<i2").tobytes()
    head = lambda crc: HEAD.pack(b"STAREPH1", 1, crc, FIRST_DAY, LAST_DAY, len(BODIES))
    whole = head(0) + b"".join(rows) + data
    return head(zlib.crc32(whole)) + whole[HEAD.size:]


def unpacked(table, body, days):
    """Positions by the table, km; written apart from the program's reader."""
    number = [name for name, _, _ in BODIES].index(body)
    _, at, granule_d, step_km, count, wide, narrow = ROW.unpack_from(table, HEAD.size + ROW.size * number)
    kind = np.dtype([("axes", [("wide", "<i4", wide), ("narrow", "<i2", narrow)], 3)])
    granules = np.frombuffer(table, kind, count, at)["axes"]
    coefficients = np.concatenate([granules["wide"], granules["narrow"]], axis=2) * step_km
    which = ((days - FIRST_DAY) // granule_d).astype(int)
    x = 2 * (days - FIRST_DAY - which * granule_d) / granule_d - 1
    return np.array([[chebyshev.chebval(u, coefficients[g, axis]) for axis in range(3)] for g, u in zip(which, x)]).T


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--check", action="store_true", help="only compare with the file that is there")
    check = arguments.parse_args().check
    spk = SPK.open(os.path.join(os.path.dirname(skyfield_data.__file__), "data/de421.bsp"))
    table = packed(spk)
    days = np.random.default_rng(1).uniform(FIRST_DAY, LAST_DAY, 4000)
    for body, granule_d, step_km in BODIES:
        wanted = positions(spk, body, days)
        off_km = np.linalg.norm(unpacked(table, body, days) - wanted, axis=0)
        arcsec = np.degrees(off_km / np.linalg.norm(wanted, axis=0)) * 3600
        print(f"{body:8} {granule_d:5} d, step {step_km:g} km: at most {off_km.max():.3f} km, {arcsec.max():.4f} arcsec")
    print(f"{len(table)} bytes")
    if check:
        sys.exit(0 if TABLE.read_bytes() == table else f"{TABLE} is another table")
    TABLE.write_bytes(table)


if __name__ == "__main__":
    main()
