"""Attitude and orbit files against other people's programs: python3 hil_scripts/tests/test_histories.py

Orekit (Java, through orekit-jpype) and brahe write AEM and OEM, which starloop reads and exports again; they and
ccsds-ndm read what starloop writes. All are compared with one motion, a turn at a constant rate about a tilted axis,
and one orbit, a cubic in time: both are exact between rows. Limits: 1e-9 rad, 1e-9 of the distance. Controls: a
conjugated quaternion and a swapped time system must differ. A run of two heads on both clocks shows the attitude of a
file. Needs Java 17 (openjdk-17-jre-headless).
"""

import functools
import math
import unittest
from pathlib import Path

import brahe
import jpype
import numpy
import orekit_jpype
import pyarrow
import pyarrow.parquet
from brahe.ccsds import AEM, OEM
from ccsds_ndm.ndm_io import NdmIo

import support
from support import ROOT, folder_for, rows_of

LIMIT = 1e-9
# 2026-03-01T00:00:00 UTC, ns of TAI since 1970.
ZERO_TAI_NS = 1_772_323_237_000_000_000
AXIS = numpy.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
RATE_RAD_S = 0.01
# Rows of files, seconds; runs begin in their middle.
ROWS_S = [5.0 * i for i in range(25)]
# Year, month, day, Julian date, TAI - UTC from then on: IERS Bulletin C. Orekit wants all since 1972.
LEAP_SECONDS = """1972 JAN 2441317.5 10,1972 JUL 2441499.5 11,1973 JAN 2441683.5 12,1974 JAN 2442048.5 13,1975 JAN 2442413.5 14,
1976 JAN 2442778.5 15,1977 JAN 2443144.5 16,1978 JAN 2443509.5 17,1979 JAN 2443874.5 18,1980 JAN 2444239.5 19,
1981 JUL 2444786.5 20,1982 JUL 2445151.5 21,1983 JUL 2445516.5 22,1985 JUL 2446247.5 23,1988 JAN 2447161.5 24,
1990 JAN 2447892.5 25,1991 JAN 2448257.5 26,1992 JUL 2448804.5 27,1993 JUL 2449169.5 28,1994 JUL 2449534.5 29,
1996 JAN 2450083.5 30,1997 JUL 2450630.5 31,1999 JAN 2451179.5 32,2006 JAN 2453736.5 33,2009 JAN 2454832.5 34,
2012 JUL 2456109.5 35,2015 JUL 2457204.5 36,2017 JAN 2457754.5 37"""


def attitude(t_s):
    """This program's quaternion, scalar first, of a body that is turned by 0.1 rad and more about AXIS."""
    half = 0.5 * (0.1 + RATE_RAD_S * t_s)
    return numpy.concatenate([[math.cos(half)], -math.sin(half) * AXIS])


def orbit(t_s):
    """Position and velocity, km and km/s: a cubic in time."""
    a, b, c, d = numpy.array([[6000.0, 3000.0, -2000.0], [1.0, 7.0, 2.0], [-4e-3, 1e-3, 2e-3], [1e-6, -2e-6, 3e-6]])
    return a + t_s * (b + t_s * (c + t_s * d)), b + t_s * (2.0 * c + 3.0 * t_s * d)


def angle(a, b):
    """Between two attitudes, rad; q and -q are one."""
    sign = 1.0 if numpy.dot(a, b) > 0.0 else -1.0
    return 2.0 * numpy.linalg.norm(numpy.array(a) - sign * numpy.array(b))


def start_orekit(folder):
    """Starts Java, with leap seconds and an Earth that needs no ephemeris."""
    orekit_jpype.initVM()
    from java.io import File
    from org.orekit.bodies import CelestialBodyFactory
    from org.orekit.data import DataContext, DirectoryCrawler
    from org.orekit.frames import FramesFactory

    lines = [entry.split() for entry in LEAP_SECONDS.replace("\n", "").split(",")]
    text = "".join(f" {year} {month}  1 =JD {jd}  TAI-UTC= {s}.0 S + (MJD - 41317.) X 0.0 S\n" for year, month, jd, s in lines)
    (folder / "tai-utc.dat").write_text(text)
    DataContext.getDefault().getDataProvidersManager().addProvider(DirectoryCrawler(File(str(folder))))

    @jpype.JImplements("org.orekit.bodies.CelestialBody")
    class Earth:
        @jpype.JOverride
        def getInertiallyOrientedFrame(self):
            return FramesFactory.getGCRF()

        @jpype.JOverride
        def getBodyOrientedFrame(self):
            return FramesFactory.getGCRF()

        @jpype.JOverride
        def getName(self):
            return "Earth"

        @jpype.JOverride
        def getGM(self):
            return jpype.JDouble(3.986004415e14)

        @jpype.JOverride
        def toFieldPVCoordinatesProvider(self, field):
            return None

        @jpype.JOverride
        def getPosition(self, *where):
            return None

        @jpype.JOverride
        def getPVCoordinates(self, *where):
            return None

    @jpype.JImplements("org.orekit.bodies.CelestialBodyLoader")
    class Loader:
        @jpype.JOverride
        def loadCelestialBody(self, name):
            return Earth()

    CelestialBodyFactory.addCelestialBodyLoader("Earth", Loader())


class Orekit:
    """AEM and OEM by Orekit."""

    def __init__(self):
        from org.orekit.time import AbsoluteDate, TimeScalesFactory

        self.zero = AbsoluteDate(2026, 3, 1, 0, 0, 0.0, TimeScalesFactory.getUTC())

    def aem(self, path, version, kind, is_xml):
        from java.lang import StringBuilder
        from java.util import ArrayList
        from org.hipparchus.geometry.euclidean.threed import Rotation, RotationConvention, RotationOrder, Vector3D
        from org.orekit.data import DataContext
        from org.orekit.files.ccsds.definitions import FrameFacade, TimeSystem
        from org.orekit.files.ccsds.ndm import WriterBuilder
        from org.orekit.files.ccsds.ndm.adm import AdmHeader, AttitudeType
        from org.orekit.files.ccsds.ndm.adm.aem import Aem, AemData, AemMetadata, AemSegment
        from org.orekit.utils import IERSConventions, TimeStampedAngularCoordinates

        context, conventions = DataContext.getDefault(), IERSConventions.IERS_2010
        frames = [FrameFacade.parse(name, conventions, True, context, True, True, True) for name in ("GCRF", "SC_BODY_1")]
        header = AdmHeader()
        header.setFormatVersion(version)
        header.setCreationDate(self.zero)
        header.setOriginator("OREKIT")
        metadata = AemMetadata(4)
        metadata.setObjectName("SAT")
        metadata.setObjectID("2026-001A")
        metadata.setTimeSystem(TimeSystem.UTC)
        metadata.setStartTime(self.zero)
        metadata.setStopTime(self.zero.shiftedBy(ROWS_S[-1]))
        metadata.setAttitudeType(getattr(AttitudeType, kind))
        metadata.getEndpoints().setFrameA(frames[0])
        metadata.getEndpoints().setFrameB(frames[1])
        metadata.getEndpoints().setA2b(True)
        if kind.endswith("_ANGVEL"):
            metadata.setAngvelFrame(frames[1])
        if kind.startswith("EULER_ANGLE"):
            metadata.setEulerRotSeq(RotationOrder.XYZ if version < 2.0 else RotationOrder.ZXZ)
        if version < 2.0:
            metadata.setIsFirst(False)
        data, axis = AemData(), Vector3D(*map(float, AXIS))
        for t_s in ROWS_S:
            turned = Rotation(axis, 0.1 + RATE_RAD_S * t_s, RotationConvention.FRAME_TRANSFORM)
            rate = Vector3D(*map(float, RATE_RAD_S * AXIS))
            data.addData(TimeStampedAngularCoordinates(self.zero.shiftedBy(t_s), turned, rate, Vector3D.ZERO))
        segments = ArrayList()
        segments.add(AemSegment(metadata, data))
        text = StringBuilder()
        message = Aem(header, segments, conventions, context)
        WriterBuilder().buildAemWriter().writeMessage(self.generator(text, is_xml), message)
        path.write_text(str(text.toString()))

    def generator(self, text, is_xml):
        from org.orekit.files.ccsds.utils.generation import KvnGenerator, XmlGenerator

        return XmlGenerator(text, 2, "x.xml", 0.0, False, None) if is_xml else KvnGenerator(text, 20, "x", 0.0, 0)

    def oem(self, path, template, is_xml):
        """Reads an OEM and writes it again, which keeps its states."""
        from java.lang import StringBuilder
        from org.orekit.files.ccsds.ndm import WriterBuilder

        text = StringBuilder()
        WriterBuilder().buildOemWriter().writeMessage(self.generator(text, is_xml), self.parse_oem(template))
        path.write_text(str(text.toString()))

    def parse_oem(self, path):
        from org.orekit.data import DataSource
        from org.orekit.files.ccsds.ndm import ParserBuilder

        return ParserBuilder().withMu(3.986004415e14).buildOemParser().parseMessage(DataSource(str(path)))

    def states_of_oem(self, path):
        """Seconds, position in km, velocity in km/s."""
        rows = self.parse_oem(path).getSegments().get(0).getCoordinates()
        for row in rows:
            vectors = [[v.getX() * 1e-3, v.getY() * 1e-3, v.getZ() * 1e-3] for v in (row.getPosition(), row.getVelocity())]
            yield row.getDate().durationFrom(self.zero), *map(numpy.array, vectors)

    def attitudes_of_aem(self, path):
        """Seconds, quaternion as this program has it, rate."""
        from org.orekit.data import DataSource
        from org.orekit.files.ccsds.ndm import ParserBuilder

        aem = ParserBuilder().buildAemParser().parseMessage(DataSource(str(path)))
        for row in aem.getSegments().get(0).getAngularCoordinates():
            turned, rate = row.getRotation(), row.getRotationRate()
            ours = [turned.getQ0(), -turned.getQ1(), -turned.getQ2(), -turned.getQ3()]
            yield row.getDate().durationFrom(self.zero), numpy.array(ours), numpy.array([rate.getX(), rate.getY(), rate.getZ()])


starloop = functools.partial(support.starloop, status=0)


class Files(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder_for(cls)
        (cls.folder / "orekit").mkdir()
        start_orekit(cls.folder / "orekit")
        cls.orekit = Orekit()

    def bench(self, name, lines, heads=1):
        """A run file of 3 s in the middle of the files' rows."""
        head = "[[extra_head]]\nsensor_from_body = [0.0, 1.0, 0.0, 0.0]\n" if heads > 1 else ""
        path = self.folder / f"{name}.toml"
        path.write_text(
            f'camera = "{ROOT}/configs/cameras/small_tracker.toml"\n[timing]\nduration_s = 3.0\nframe_rate_hz = 5.0\n'
            f'start_utc = "2026-03-01T00:00:50Z"\ndeadline_policy = "late"\n{lines}\n{head}'
        )
        return path

    def exported(self, bench, *options):
        out = bench.with_suffix(".csv")
        starloop("export", bench, *options, out, "--force")
        return rows_of(out)

    def attitude_error(self, bench):
        """Largest angle between exported attitudes and the motion, and largest difference of rates."""
        worst = [0.0, 0.0]
        rows = self.exported(bench, "--body", "--attitude")
        self.assertEqual(len(rows), 15)
        for row in rows:
            t_s = (int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9
            got = [float(row[name]) for name in ("q_w", "q_x", "q_y", "q_z")]
            rate = numpy.array([float(row[f"w_{axis}_rad_s"]) for axis in "xyz"])
            worst = [max(worst[0], angle(got, attitude(t_s))), max(worst[1], numpy.linalg.norm(rate - RATE_RAD_S * AXIS))]
        return worst

    def file_plant(self, name):
        return f'[plant]\nkind = "file"\nattitude = "{name}"\n'

    def test_attitudes_of_orekit_are_read(self):
        for version, kind, is_xml in [
            (1.0, "QUATERNION", False),
            (2.0, "QUATERNION", False),
            (2.0, "QUATERNION_ANGVEL", False),
            (2.0, "QUATERNION_DERIVATIVE", False),
            (2.0, "QUATERNION", True),
            (2.0, "QUATERNION_ANGVEL", True),
            (1.0, "EULER_ANGLE", False),
            (2.0, "EULER_ANGLE", False),
            (2.0, "EULER_ANGLE_DERIVATIVE", False),
            (2.0, "EULER_ANGLE_ANGVEL", False),
            (2.0, "EULER_ANGLE", True),
            (2.0, "EULER_ANGLE_DERIVATIVE", True),
            (1.0, "SPIN", False),
            (2.0, "SPIN", False),
            (2.0, "SPIN_NUTATION", False),
            (2.0, "SPIN_NUTATION_MOMENTUM", False),
            (2.0, "SPIN", True),
        ]:
            with self.subTest(version=version, kind=kind, xml=is_xml):
                name = f"orekit_{version}_{kind}_{is_xml}"
                self.orekit.aem(self.folder / f"{name}.aem", version, kind, is_xml)
                angle_rad, rate = self.attitude_error(self.bench(name, self.file_plant(f"{name}.aem")))
                self.assertLess(angle_rad, LIMIT)
                self.assertLess(rate, LIMIT)

    def test_a_conjugate_and_a_swapped_time_system_differ(self):
        path = self.folder / "right.aem"
        self.orekit.aem(path, 1.0, "QUATERNION", False)
        for name, old, new, least in [("conjugate", "A2B", "B2A", 0.1), ("tai", "= UTC", "= TAI", 30.0 * RATE_RAD_S)]:
            (self.folder / f"{name}.aem").write_text(path.read_text().replace(old, new))
            error, _ = self.attitude_error(self.bench(name, self.file_plant(f"{name}.aem")))
            self.assertGreater(error, least, name)

    def export_all(self):
        """Returns the exports of a run file with a file of attitudes and of an orbit, by name."""
        self.orekit.aem(self.folder / "source.aem", 2.0, "QUATERNION_ANGVEL", False)
        self.write_oem(self.folder / "source.oem")
        lines = self.file_plant("source.aem") + '[observer]\nkind = "file"\nfile = "source.oem"\n'
        bench = self.bench("all", lines)
        names = {}
        for name, *options in [
            ("v1.aem", "--aem-version", "1", "--attitude"),
            ("v2.aem", "--attitude"),
            ("v2.xml", "--attitude"),
            ("attitude.a", "--attitude"),
            ("orbit.oem", "--observer"),
            ("orbit.xml", "--observer"),
            ("orbit.e", "--observer"),
            ("orbit.csv", "--observer"),
        ]:
            names[name] = self.folder / f"ours_{name}"
            starloop("export", bench, "--body", *options, names[name], "--force")
        return names

    def write_oem(self, path):
        rows = []
        for t_s in ROWS_S:
            position, velocity = orbit(t_s)
            numbers = " ".join(repr(float(v)) for v in [*position, *velocity])
            rows.append(f"2026-03-01T00:{int(t_s) // 60:02}:{t_s % 60:06.3f} {numbers}")
        path.write_text(
            "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = TEST\nMETA_START\nOBJECT_NAME = SAT\n"
            "OBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\nREF_FRAME = GCRF\nTIME_SYSTEM = UTC\nSTART_TIME = 2026-03-01T00:00:00\n"
            "STOP_TIME = 2026-03-01T00:02:00\nINTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 3\nMETA_STOP\n" + "\n".join(rows) + "\n"
        )

    def test_our_attitudes_are_read_by_orekit(self):
        files = self.export_all()
        for name, has_rates in [("v1.aem", False), ("v2.aem", True), ("v2.xml", True)]:
            with self.subTest(file=name):
                rows = list(self.orekit.attitudes_of_aem(files[name]))
                self.assertEqual(len(rows), 15)
                for t_s, ours, rate in rows:
                    self.assertLess(angle(ours, attitude(t_s)), LIMIT)
                    if has_rates:
                        self.assertLess(numpy.linalg.norm(rate - RATE_RAD_S * AXIS), LIMIT)
                t_s, ours, _ = rows[0]
                self.assertGreater(angle(ours * [1, -1, -1, -1], attitude(t_s)), 0.1, "control: a conjugate")

    def test_our_attitudes_are_read_by_ccsds_ndm_and_brahe(self):
        files = self.export_all()
        for name in ("v1.aem", "v2.xml"):
            with self.subTest(file=name, reader="ccsds-ndm"):
                segment = NdmIo().from_path(str(files[name])).body.segment
                data = (segment[0] if isinstance(segment, list) else segment).data
                self.assertEqual(len(data.attitude_state), 15)
                for state in data.attitude_state:
                    parts = [getattr(state, part, None) for part in dir(state) if part.startswith("quaternion")]
                    quaternion = next(part for part in parts if part is not None).quaternion
                    numbers = [float(getattr(quaternion, part)) for part in ("qc", "q1", "q2", "q3")]
                    self.assertLess(abs(numpy.linalg.norm(numbers) - 1.0), LIMIT)
                    best = min(angle(numpy.array(numbers) * [1, -1, -1, -1], attitude(t_s)) for t_s in self.mid_exposures_s())
                    self.assertLess(best, LIMIT)
        for name in ("v2.aem", "v2.xml"):
            with self.subTest(file=name, reader="brahe"):
                states = AEM.from_file(str(files[name])).segments[0].states
                self.assertEqual(len(states), 15)
                for state, t_s in zip(states, self.mid_exposures_s(), strict=True):
                    numbers = numpy.array(state.quaternion.to_vector(True))
                    self.assertLess(angle(numbers * [1, -1, -1, -1], attitude(t_s)), LIMIT)

    def mid_exposures_s(self):
        rows = self.exported(self.bench("mid", self.file_plant("source.aem")), "--attitude")
        return [(int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9 for row in rows]

    def orbit_error(self, rows):
        """Largest part of the distance by which rows are off, and of the speed."""
        worst = [0.0, 0.0]
        for t_s, position, velocity in rows:
            right = orbit(t_s)
            off = [numpy.linalg.norm(a - b) / numpy.linalg.norm(b) for a, b in zip((position, velocity), right, strict=True)]
            worst = [max(a, b) for a, b in zip(worst, off, strict=True)]
        return worst

    def orbit_of_bench(self, name):
        bench = self.bench(Path(name).stem, f'[observer]\nkind = "file"\nfile = "{name}"\n')
        for row in self.exported(bench, "--observer"):
            vectors = [[float(row[f"{part}{unit}"]) for part in parts] for parts, unit in ((("x", "y", "z"), "_km"), (("vx", "vy", "vz"), "_km_s"))]
            yield (int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9, *map(numpy.array, vectors)

    def write_brahe_oem(self, path):
        start = brahe.Epoch.from_datetime(2026, 3, 1, 0, 0, 0.0, 0.0, brahe.TimeSystem.UTC)
        oem = OEM(originator="BRAHE")
        oem.add_segment(
            object_name="SAT", object_id="2026-001A", center_name="EARTH", ref_frame="GCRF", time_system="UTC",
            start_time=start, stop_time=start + ROWS_S[-1], interpolation="HERMITE", interpolation_degree=3,
        )
        for t_s in ROWS_S:
            position, velocity = orbit(t_s)
            oem.segments[0].add_state(epoch=start + t_s, position=list(position * 1e3), velocity=list(velocity * 1e3))
        oem.to_file(str(path), "KVN")

    def test_orbits_of_orekit_and_brahe_are_read(self):
        template = self.folder / "template.oem"
        self.write_oem(template)
        self.orekit.oem(self.folder / "orekit_kvn.oem", template, False)
        self.orekit.oem(self.folder / "orekit_xml.oem", template, True)
        self.write_brahe_oem(self.folder / "brahe.oem")
        for name in ("orekit_kvn.oem", "orekit_xml.oem", "brahe.oem"):
            with self.subTest(file=name):
                position, velocity = self.orbit_error(self.orbit_of_bench(name))
                self.assertLess(position, LIMIT)
                self.assertLess(velocity, LIMIT)
        (self.folder / "tai.oem").write_text(template.read_text().replace("= UTC", "= TAI"))
        self.assertGreater(self.orbit_error(self.orbit_of_bench("tai.oem"))[0], 1e-3, "control: a swapped time system")

    def test_our_orbits_are_read_by_orekit_and_brahe(self):
        files = self.export_all()
        for name in ("orbit.oem", "orbit.xml"):
            with self.subTest(file=name):
                self.assertLess(max(self.orbit_error(self.orekit.states_of_oem(files[name]))), LIMIT)
                states = OEM.from_file(str(files[name])).segments[0].states
                times = self.mid_exposures_s()
                rows = [
                    (t_s, numpy.array(state.position) * 1e-3, numpy.array(state.velocity) * 1e-3)
                    for state, t_s in zip(states, times, strict=True)
                ]
                self.assertLess(max(self.orbit_error(rows)), LIMIT)

    def test_stk_and_csv_come_back(self):
        files = self.export_all()
        for name in ("orbit.e", "orbit.csv"):
            with self.subTest(file=name):
                bench = self.bench("again", f'[observer]\nkind = "file"\nfile = "{files[name].name}"\n')
                # The rows are mid-exposures: an exposure begins before the first of them.
                bench.write_text(bench.read_text().replace("00:00:50Z", "00:00:50.4Z").replace("duration_s = 3.0", "duration_s = 1.0"))
                out = self.folder / "again.csv"
                starloop("export", bench, "--observer", out, "--force")
                rows = rows_of(out)
                self.assertEqual(len(rows), 5)
                for row in rows:
                    position, _ = orbit((int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9)
                    got = numpy.array([float(row[f"{axis}_km"]) for axis in "xyz"])
                    self.assertLess(numpy.linalg.norm(got - position) / numpy.linalg.norm(position), LIMIT)
        bench = self.bench("stk", self.file_plant(files["attitude.a"].name) + 'outside = "rest"\n')
        rows = self.exported(bench, "--body", "--attitude")
        inside = [row for row in rows if 51.2 < (int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9 < 53.8]
        self.assertGreater(len(inside), 8)
        for row in inside:
            got = [float(row[name]) for name in ("q_w", "q_x", "q_y", "q_z")]
            self.assertLess(angle(got, attitude((int(row["tai_ns"]) - ZERO_TAI_NS) * 1e-9)), LIMIT)

    def test_a_run_shows_the_attitude_of_the_file_on_both_clocks(self):
        self.orekit.aem(self.folder / "run.aem", 2.0, "QUATERNION_ANGVEL", False)
        bench = self.bench("run", self.file_plant("run.aem"), heads=2)
        for clock in ("virtual", "real"):
            out = self.folder / f"run_{clock}"
            starloop("run", bench, "--clock", clock, "--out", out, status=None)
            for head in ("head0", "head1"):
                with self.subTest(clock=clock, head=head):
                    rows = rows_of(out / head)
                    self.assertGreater(len(rows), 0)
                    for row in rows:
                        t_s = (int(row["mid_exposure_tai_ns"]) - ZERO_TAI_NS) * 1e-9
                        w, x, y, z = attitude(t_s)
                        # The second head is turned by half a turn about x: q = (0, 1, 0, 0) times the body's.
                        right = (w, x, y, z) if head == "head0" else (-x, w, -z, y)
                        got = [float(row[name]) for name in ("qw", "qx", "qy", "qz")]
                        # Single precision on the wire, time marks in microseconds.
                        self.assertLess(angle(got, right), 5e-7)
        aem = self.folder / "recorded.aem"
        starloop("export", self.folder / "run_virtual/head0", "--attitude", aem)
        refused = starloop("export", self.folder / "run_virtual/head0", "--attitude", aem, status=None)
        self.assertIn("--force", refused.stderr)
        worst = max(angle(ours, attitude(t_s)) for t_s, ours, _ in self.orekit.attitudes_of_aem(aem))
        self.assertLess(worst, 5e-7)

    def test_images_of_a_file_are_numbered_with_truth_beside_them(self):
        rows = [f"{t_s},{','.join(repr(float(v)) for v in attitude(t_s))}" for t_s in (0.0, 1.0, 2.0)]
        (self.folder / "few.csv").write_text("t_s,q_w,q_x,q_y,q_z\n" + "\n".join(rows) + "\n")
        out = self.folder / "few.fits"
        camera = ROOT / "configs/cameras/small_tracker.toml"
        starloop("render", "--camera", camera, "--attitudes", self.folder / "few.csv", "--out", out)
        written = sorted(path.name for path in self.folder.glob("few_*"))
        self.assertEqual(written, [f"few_{n:06}.{end}" for n in range(3) for end in ("fits", "truth.csv")])
        one = self.folder / "one.fits"
        quaternion = ",".join(repr(float(v)) for v in attitude(0.0))
        rate = ",".join(repr(math.degrees(RATE_RAD_S) * float(v)) for v in AXIS)
        truth = self.folder / "one.truth.csv"
        starloop("render", "--camera", camera, "--attitude", quaternion, f"--rate={rate}", "--out", one, "--truth", truth)
        tables = (truth, self.folder / "few_000000.truth.csv")
        read = [rows_of(path) for path in tables]
        places = [{row["id"]: (float(row["x_px"]), float(row["y_px"])) for row in rows} for rows in read]
        self.assertEqual(places[0].keys(), places[1].keys())
        worst = max(math.dist(places[0][star], places[1][star]) for star in places[0])
        self.assertLess(worst, 1e-6)

    def test_parquet_table_is_the_table_of_text(self):
        names = ["t_s", "q_w", "q_x", "q_y", "q_z"]
        rows = [[t_s, *(float(v) for v in attitude(t_s))] for t_s in ROWS_S]
        text = [",".join(names)] + [",".join(map(repr, row)) for row in rows]
        (self.folder / "rows.csv").write_text("\n".join(text) + "\n")
        columns = {name: [row[place] for row in rows] for place, name in enumerate(names)}
        table = pyarrow.table(columns | {"remark": ["x"] * len(rows)})
        pyarrow.parquet.write_table(table, self.folder / "rows.parquet")
        other = table.replace_schema_metadata({"sense": "icrf_from_body"})
        pyarrow.parquet.write_table(other, self.folder / "other.parquet")

        def exported(name):
            keys = f'[plant]\nkind = "file"\nattitude = "{name}"\nbegins = "first_exposure"'
            return self.exported(self.bench(name.replace(".", "_"), keys), "--attitude")

        self.assertEqual(exported("rows.parquet"), exported("rows.csv"))
        self.assertNotEqual(exported("other.parquet"), exported("rows.csv"), "control: the metadata say its sense")


if __name__ == "__main__":
    unittest.main()
