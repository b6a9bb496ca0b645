#!/usr/bin/env python3
"""SPICE kernels written by CSPICE are read as CSPICE reads them, to 1e-9: python3 hil_scripts/tests/test_spice.py

STARLOOP_BINARY names the program (default target/release/starloop), built with the feature spice. Packages:
hil_scripts/requirements_interop.txt.
"""

import math
import unittest

import numpy
import spiceypy

from support import CAMERA, InAFolder, rows_of, starloop

LSK = """KPL/LSK

\\begindata
DELTET/DELTA_T_A = 32.184
DELTET/K         = 1.657D-3
DELTET/EB        = 1.671D-2
DELTET/M         = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT  = ( 36, @2015-JUL-1
                     37, @2017-JAN-1 )
\\begintext
"""
# Two ranges, the second of a clock that runs fast by 1e-7; {system}: 1 is TDB, 2 is TT.
SCLK = """KPL/SCLK

\\begindata
SCLK_KERNEL_ID           = ( @2026-01-01/00:00:00 )
SCLK_DATA_TYPE_82        = ( 1 )
SCLK01_TIME_SYSTEM_82    = ( {system} )
SCLK01_N_FIELDS_82       = ( 2 )
SCLK01_MODULI_82         = ( 4294967296 65536 )
SCLK01_OFFSETS_82        = ( 0 0 )
SCLK01_OUTPUT_DELIM_82   = ( 1 )
SCLK_PARTITION_START_82  = ( 0.0 )
SCLK_PARTITION_END_82    = ( 2.8147497671065E+14 )
SCLK01_COEFFICIENTS_82   = ( 0.0                 825595269.18   1.0
                             3.93216E+06         825595329.18   1.0000001 )
\\begintext
"""
BENCH = """camera = "{camera}"
[timing]
frame_rate_hz = 5.0
duration_s = 20.0
start_utc = "2026-03-01T00:00:30Z"
[plant]
kind = "file"
attitude = "a.bc"
kernels = ["clock.tsc", "leap.tls"]
outside = "rest"
[observer]
kind = "file"
file = "{orbit}"
kernels = ["leap.tls"]
"""
SPACECRAFT, INSTRUMENT, EARTH = -82, -82000, 399
TICK_S = 1 / 65536


class Spice(InAFolder):
    def setUp(self):
        super().setUp()
        self.addCleanup(spiceypy.kclear)
        spiceypy.kclear()

    def clocks(self, system):
        (self.folder / "leap.tls").write_text(LSK)
        (self.folder / "clock.tsc").write_text(SCLK.format(system=system))
        for name in ("leap.tls", "clock.tsc"):
            spiceypy.furnsh(str(self.folder / name))

    def write_ck(self, kind):
        path = self.folder / "a.bc"
        path.unlink(missing_ok=True)
        file = spiceypy.ckopn(str(path), "test", 0)
        ticks = numpy.array([(20 + 0.7 * i) / TICK_S for i in range(120)])
        axis = numpy.array([0.3, -0.5, 0.8]) / math.sqrt(0.98)
        angles = [0.0007 * i + 0.002 * math.sin(i / 9) for i in range(len(ticks))]
        # CSPICE's matrices take vectors from the reference axes into those of the instrument.
        quaternions = numpy.array([spiceypy.m2q(spiceypy.axisar(axis, -angle)) for angle in angles])
        rates = numpy.array([axis * 1e-3] * len(ticks))
        ends = ticks[0], ticks[-1]
        if kind == 3:
            spiceypy.ckw03(file, *ends, INSTRUMENT, "J2000", True, "t", len(ticks), ticks, quaternions, rates, 1, ticks[:1])
        else:
            spiceypy.ckw02(file, ticks[0], ticks[-1], INSTRUMENT, "J2000", "t", len(ticks) - 1, ticks[:-1], ticks[1:],
                           quaternions[:-1], rates[:-1], [TICK_S] * (len(ticks) - 1))
        spiceypy.ckcls(file)
        spiceypy.furnsh(str(path))

    def state(self, t):
        axis_km = 7000.0
        w = math.sqrt(398600.4418 / axis_km**3)
        sin, cos = math.sin(w * t), math.cos(w * t)
        return [axis_km * cos, axis_km * sin * 0.8, axis_km * sin * 0.6,
                -axis_km * w * sin, axis_km * w * cos * 0.8, axis_km * w * cos * 0.6]

    def write_spk(self, kind):
        path = self.folder / f"o{kind}.bsp"
        path.unlink(missing_ok=True)
        file = spiceypy.spkopn(str(path), "test", 0)
        begin = spiceypy.str2et("2026-02-28T23:50:00")
        epochs = numpy.array([begin + 20.0 * i for i in range(120)])
        states = numpy.array([self.state(epoch - begin) for epoch in epochs])
        head = file, SPACECRAFT, EARTH, "J2000"
        if kind == 9:
            spiceypy.spkw09(*head, epochs[0], epochs[-1], "s", 9, len(epochs), states, epochs)
        elif kind == 13:
            spiceypy.spkw13(*head, epochs[0], epochs[-1], "s", 7, len(epochs), states, epochs)
        else:
            length, degree, records = 400.0, 12, 5
            nodes = numpy.cos(numpy.pi * (numpy.arange(40) + 0.5) / 40)
            values = [[self.state(record * length + length / 2 * (1 + node)) for node in nodes] for record in range(records)]
            series = [numpy.polynomial.chebyshev.chebfit(nodes, numpy.array(value)[:, : 3 * (kind - 1)], degree).T for value in values]
            write = {2: spiceypy.spkw02, 3: spiceypy.spkw03}[kind]
            write(*head, begin, begin + records * length, "s", length, records, degree, numpy.array(series).reshape(-1), begin)
        spiceypy.spkcls(file)
        spiceypy.furnsh(str(path))
        return path.name

    def exported(self, orbit):
        bench = self.written("bench.toml", BENCH.format(camera=CAMERA, orbit=orbit))
        found = []
        for what in ("attitude", "observer"):
            path = self.folder / f"{what}.csv"
            starloop("export", bench, f"--{what}", path, "--force", status=0)
            found.append(rows_of(path))
        return found

    def et(self, row):
        """Ephemeris time of a row: CSPICE counts TAI from 2000-01-01T12:00:00 TAI."""
        return spiceypy.unitim(int(row["tai_ns"]) * 1e-9 - 946728000, "TAI", "ET")

    def test_attitudes_and_orbits_are_those_of_cspice(self):
        for system, ck, spk in ((1, 3, 9), (2, 3, 13), (1, 2, 2), (1, 3, 3)):
            with self.subTest(system=system, ck=ck, spk=spk):
                spiceypy.kclear()
                self.clocks(system)
                self.write_ck(ck)
                attitudes, states = self.exported(self.write_spk(spk))
                self.assertEqual((len(attitudes), len(states)), (100, 100))
                for row in attitudes:
                    got = numpy.array([float(row[f"q_{axis}"]) for axis in "wxyz"])
                    ticks = spiceypy.sce2c(SPACECRAFT, self.et(row))
                    wanted = spiceypy.m2q(spiceypy.ckgp(INSTRUMENT, ticks, 0, "J2000")[0])
                    off = lambda q: min(abs(q - wanted).max(), abs(q + wanted).max())
                    self.assertLess(off(got), 1e-9)
                    self.assertGreater(off(got * [1, -1, -1, -1]), 1e-3, "negative control: the conjugate")
                for row in states:
                    wanted, _ = spiceypy.spkgeo(SPACECRAFT, self.et(row), "J2000", EARTH)
                    got = [float(row[name]) for name in ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")]
                    self.assertLess(abs(numpy.array(got) - wanted)[:3].max() / 7000, 1e-9)
                    self.assertLess(abs(numpy.array(got) - wanted)[3:].max() / 7.5, 1e-8)
                    later, _ = spiceypy.spkgeo(SPACECRAFT, self.et(row) + 69.184, "J2000", EARTH)
                    self.assertGreater(abs(numpy.array(got) - later)[:3].max(), 1, "negative control: another time system")

    def assert_attitudes_are_those_of_cspice(self, attitudes, least=1):
        """Compares the rows with `ckgp`; returns how many it has."""
        found = 0
        for row in attitudes:
            got = numpy.array([float(row[f"q_{axis}"]) for axis in "wxyz"])
            try:
                matrix = spiceypy.ckgp(INSTRUMENT, spiceypy.sce2c(SPACECRAFT, self.et(row)), 0, "J2000")[0]
            except spiceypy.exceptions.NotFoundError:
                continue
            wanted = spiceypy.m2q(matrix)
            # The clock's rate changes by 1e-7 within the record.
            self.assertLess(min(abs(got - wanted).max(), abs(got + wanted).max()), 1e-6, row)
            found += 1
        self.assertGreaterEqual(found, least)

    def ck(self, write):
        """Writes a.bc by segments of `write(file)`."""
        path = self.folder / "a.bc"
        path.unlink(missing_ok=True)
        file = spiceypy.ckopn(str(path), "test", 0)
        write(file)
        spiceypy.ckcls(file)
        spiceypy.furnsh(str(path))

    def test_clocks_of_every_form_are_those_of_cspice(self):
        plain = SCLK.format(system=1)
        ranges = "\n".join(f"{i * 655360.0:.1f} {825595269.18 + 10 * i:.2f} 1.0" for i in range(12))
        many = plain[: plain.index("SCLK01_COEFFICIENTS_82")] + "SCLK01_COEFFICIENTS_82 = (\n{}\n)\n\\begintext\n"
        unsorted = ranges.split("\n")
        unsorted[4] = unsorted[2]
        forms = {
            "dates": plain.replace("825595269.18", "@2026-MAR-01-00:01:09.18").replace("825595329.18", "@01-MAR-2026-00:02:09.18"),
            "carriage returns": plain.replace("\n", "\r"),
            "no word": plain.replace("KPL/SCLK", ""),
            "a remark in Latin-1": plain + "Stra\xdfe\n",
            "one record out of order": many.format("\n".join(unsorted)),
        }
        for name, text in forms.items():
            with self.subTest(name):
                spiceypy.kclear()
                self.clocks(1)
                spiceypy.unload(str(self.folder / "clock.tsc"))
                (self.folder / "clock.tsc").write_bytes(text.encode("latin-1"))
                spiceypy.furnsh(str(self.folder / "clock.tsc"))
                self.write_ck(3)
                attitudes, _ = self.exported(self.write_spk(9))
                self.assert_attitudes_are_those_of_cspice(attitudes, least=90)

    def test_turns_overlaps_and_frames_of_a_ck_are_those_of_cspice(self):
        begin, end = 20 / TICK_S, 110 / TICK_S
        axis = numpy.array([0.3, -0.5, 0.8]) / math.sqrt(0.98)
        quaternion = lambda angle: spiceypy.m2q(spiceypy.axisar(axis, angle))

        def turns(file):
            spiceypy.ckw02(file, begin, end, INSTRUMENT, "J2000", "t", 1, [begin], [end], [quaternion(0.4)],
                           [axis * math.radians(24)], [TICK_S])

        def overlap(file, frame="J2000"):
            for angle, first, last in ((0.1, begin, end), (0.7, 45 / TICK_S, 75 / TICK_S)):
                rows = [quaternion(angle), quaternion(angle + 0.2)]
                spiceypy.ckw03(file, first, last, INSTRUMENT, frame, False, "t", 2, [first, last], rows, [[0, 0, 0]] * 2, 1, [first])

        for name, write in (("turns", turns), ("overlap", overlap), ("ecliptic", lambda file: overlap(file, "ECLIPJ2000")),
                            ("Mars", lambda file: overlap(file, "MARSIAU")), ("B1950", lambda file: overlap(file, "B1950"))):
            with self.subTest(name):
                spiceypy.kclear()
                self.clocks(1)
                self.ck(write)
                attitudes, _ = self.exported(self.write_spk(9))
                self.assert_attitudes_are_those_of_cspice(attitudes, least=100)

    def test_a_long_record_of_a_high_degree_is_that_of_cspice(self):
        self.clocks(1)
        self.write_ck(3)
        path = self.folder / "long.bsp"
        file = spiceypy.spkopn(str(path), "test", 0)
        begin = spiceypy.str2et("2026-02-28T23:50:00")
        nodes = numpy.cos(numpy.pi * (numpy.arange(60) + 0.5) / 60)
        values = numpy.array([self.state(3000 * (1 + node)) for node in nodes])[:, :3]
        series = numpy.polynomial.chebyshev.chebfit(nodes, values, 27).T
        spiceypy.spkw02(file, SPACECRAFT, EARTH, "J2000", begin, begin + 6000, "s", 6000.0, 1, 27, series.reshape(-1), begin)
        spiceypy.spkcls(file)
        spiceypy.furnsh(str(path))
        _, states = self.exported(path.name)
        for row in states:
            wanted, _ = spiceypy.spkgeo(SPACECRAFT, self.et(row), "J2000", EARTH)
            got = numpy.array([float(row[name]) for name in ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")])
            self.assertLess(abs(got - wanted)[:3].max(), 5e-6)
            self.assertLess(abs(got - wanted)[3:].max(), 1e-8)

    def test_images_of_a_ck_are_drawn_at_its_rows(self):
        self.clocks(1)
        self.write_ck(3)
        out = self.folder / "row.fits"
        words = ["render", "--camera", CAMERA, "--attitudes", self.folder / "a.bc", "--every", "20", "--out", out]
        text_kernels = ["--kernel", self.folder / "clock.tsc", "--kernel", self.folder / "leap.tls"]
        said = starloop(*words, *text_kernels, "--naif-id", INSTRUMENT, status=0).stdout
        images = sorted(self.folder.glob("row_*.fits"))
        self.assertEqual(len(images), 5, said)
        heads = [image.read_bytes()[:28800].decode("latin-1") for image in images]
        values = lambda head: {line[:8].strip(): line[10:].split("/")[0].strip() for line in (head[i : i + 80] for i in range(0, 28800, 80))}
        for number, head in enumerate(map(values, heads)):
            ticks = (20 + 20 * number) / TICK_S
            matrix = spiceypy.ckgp(INSTRUMENT, ticks, 0, "J2000")[0]
            wanted = spiceypy.m2q(matrix)
            got = numpy.array([float(head[f"Q{part}"]) for part in "WXYZ"])
            self.assertLess(min(abs(got - wanted).max(), abs(got + wanted).max()), 1e-7)
        refused = starloop(*words)
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn("SCLK", refused.stderr, "without its clock")

    def test_a_kernel_without_its_clock_is_refused(self):
        self.clocks(1)
        self.write_ck(3)
        bench = self.written("bench.toml", BENCH.format(camera=CAMERA, orbit=self.write_spk(9)).replace('["clock.tsc", "leap.tls"]', '["leap.tls"]'))
        done = starloop("check", bench)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("SCLK_DATA_TYPE_82", done.stderr)
        self.assertIn("plant.kernels is leap.tls", done.stderr)
        self.assertNotIn("belongs to a binary SPICE kernel", done.stderr)


if __name__ == "__main__":
    unittest.main()
