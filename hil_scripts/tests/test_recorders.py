"""Tests of starloop's recordings, with third-party programs: python3 hil_scripts/tests/test_recorders.py

FITS files are read by astropy, SER files by a reader written here from the description of the format and by Siril, shared
memory by another process, through iceoryx2 with that project's own Python package. STARLOOP_BINARY names the program
(default target/release/starloop), built with --features iceoryx2.
"""

import ctypes
import json
import os
import resource
import shutil
import signal
import struct
import time
import unittest
import zlib
from datetime import datetime, timedelta

import iceoryx2
import numpy
from astropy.io import fits
from astropy.time import Time

from support import BINARY, ROOT, InAFolder, Running, bench_text, output, rows_of, starloop, summary_of, until
from starloop.iceoryx_frames import SILENCE_S, FrameHead, IceoryxFrames
from starloop.shared_frames import SharedFrames

SIDE_PX = 256
FRAME_BYTES = 2 * SIDE_PX * SIDE_PX
SER_RECORDER = '[sink]\nkind = "recorder"\nfits = false\nser = true\n'


def words_of(folder, sinks, *words):
    bench = folder / "bench.toml"
    bench.write_text(bench_text("recorders") + sinks)
    return ["run", str(bench), "--quiet", "--backend", "cpu", "--out", str(folder / "run"), *words]


def run(folder, sinks, *words, **options):
    return starloop(*words_of(folder, sinks, *words), **options)


def crc32_of(pixels):
    return f"{zlib.crc32(pixels.astype('<u2').tobytes()):08x}"


class Ser:
    """A SER file, from "SER format description version 3"; the byte order field as programs in use take it."""

    NAMES = "lu_id color_id order width height bits count".split()

    def __init__(self, path):
        data = path.read_bytes()
        assert data[:14] == b"LUCAM-RECORDER", data[:14]
        self.head = dict(zip(self.NAMES, struct.unpack_from("<7i", data, 14)))
        self.texts = [data[at : at + 40].rstrip(b"\0").decode("ascii") for at in (42, 82, 122)]
        self.start_ticks = struct.unpack_from("<2q", data, 162)
        shape = (self.head["height"], self.head["width"])
        kind = "<u2" if self.head["order"] == 0 else ">u2"
        size = 2 * shape[0] * shape[1]
        self.frames = [
            numpy.frombuffer(data, kind, shape[0] * shape[1], 178 + i * size).reshape(shape)
            for i in range(self.head["count"])
        ]
        rest = data[178 + self.head["count"] * size :]
        self.trailer = struct.unpack(f"<{len(rest) // 8}q", rest[: len(rest) // 8 * 8])

    @staticmethod
    def utc(ticks):
        return datetime(1, 1, 1) + timedelta(microseconds=ticks // 10)


class Recorders(InAFolder):
    def summary(self):
        return summary_of(self.out)

    def wait_for_bytes(self, running, path, size):
        """Waits until a file that a run writes is larger than this."""
        until(path.name, lambda: running.process.poll() is not None or path.exists() and path.stat().st_size > size)
        self.assertIsNone(running.process.poll(), "it runs")

    def test_astropy_reads_every_frame_with_its_truth(self):
        sinks = '[sink]\nkind = "recorder"\npng_every = 2\n'
        run(self.folder, sinks, "--clock", "virtual", "--duration", "1", status=0)
        listed = rows_of(self.out)
        self.assertEqual(len(listed), 10)
        for row in listed:
            path = self.out / f"frame_{int(row['frame']):06}.fits"
            with fits.open(path, do_not_scale_image_data=True) as raw:
                raw.verify("exception")
                self.assertEqual((raw[0].header["BZERO"], raw[0].header["BITPIX"]), (32768, 16))
                stored = raw[0].data.astype("i4") + 32768
            with fits.open(path) as file:
                head, pixels = file[0].header, file[0].data
            self.assertEqual((pixels.dtype.kind, pixels.shape), ("u", (SIDE_PX, SIDE_PX)))
            self.assertTrue((stored == pixels).all(), "by hand as by astropy")
            self.assertEqual(crc32_of(pixels), row["pixel_crc32"])
            self.assertEqual(f"{head['PIXCRC32']:08x}", row["pixel_crc32"])
            for keyword, column in [("QW", "qw"), ("QX", "qx"), ("QY", "qy"), ("QZ", "qz"), ("RA_DEG", "ra_deg"),
                                    ("DEC_DEG", "dec_deg"), ("ROLL_DEG", "roll_deg"), ("GAIN", "gain_e_per_dn"),
                                    ("EXPTIME", "exposure_s")]:
                self.assertEqual(head[keyword], float(row[column]), keyword)
            self.assertEqual((head["FRAME"], head["NSTARS"]), (int(row["frame"]), int(row["stars"])))
            # astropy's own leap seconds and time scales.
            middle = Time(head["T-MID"], scale="utc", format="isot")
            tai_ns = int(row["mid_exposure_tai_ns"])
            self.assertEqual(head["MID_NS"], tai_ns)
            epoch = Time("1970-01-01T00:00:00", scale="tai", format="isot")
            self.assertLess(abs((middle.tai - epoch).to_value("s") - tai_ns * 1e-9), 1e-6)
            start = Time(head["DATE-OBS"], scale="utc", format="isot")
            self.assertAlmostEqual((middle - start).to_value("s"), head["EXPTIME"] / 2, delta=1.5e-6)
            self.assertAlmostEqual(start.mjd, head["MJD-OBS"], delta=1e-10)
        changed = pixels.copy()
        changed[3, 5] ^= 1
        self.assertNotEqual(crc32_of(changed), row["pixel_crc32"], "control: one bit of one pixel")

    def test_a_sequence_has_the_frames_and_their_times(self):
        run(self.folder, SER_RECORDER, "--clock", "virtual", "--duration", "1", status=0)
        ser, listed = Ser(self.out / "frames.ser"), rows_of(self.out)
        self.assertEqual(ser.head, {"lu_id": 0, "color_id": 0, "order": 0, "width": SIDE_PX, "height": SIDE_PX,
                                    "bits": 16, "count": 10})
        self.assertEqual([crc32_of(frame) for frame in ser.frames], [row["pixel_crc32"] for row in listed])
        swapped = crc32_of(ser.frames[0].byteswap())
        self.assertNotEqual(swapped, listed[0]["pixel_crc32"], "control: the other byte order")
        times = [f"{Ser.utc(ticks).isoformat(timespec='microseconds')}Z" for ticks in ser.trailer]
        self.assertEqual(times, [row["mid_exposure_utc"] for row in listed])
        self.assertEqual(ser.start_ticks, (ser.trailer[0],) * 2)
        self.assertEqual(ser.texts[:2], ["starloop", listed[0]["camera"]])
        self.assertEqual(list(self.out.glob("*.fits")), [])

    @unittest.skipUnless(shutil.which("siril-cli"), "no siril-cli: apt-get install --no-install-recommends siril")
    def test_siril_reads_the_sequence(self):
        run(self.folder, SER_RECORDER, "--clock", "virtual", "--duration", "0.5", status=0)
        # Siril reads every frame, cuts a window out of it, and writes a SER file of its own.
        x, y, width, height = 40, 24, 160, 120
        script = self.written("cut.ssf", f"requires 1.0.0\nset16bits\nseqcrop frames {x} {y} {width} {height} -prefix=cut_\n")
        said = output("siril-cli", "-d", self.out, "-s", script, env={**os.environ, "HOME": str(self.folder), "LC_ALL": "C.UTF-8"})
        self.assertIn("Timestamps in the SER file are correctly ordered", said)
        ours, cut = Ser(self.out / "frames.ser"), Ser(self.out / "cut_frames.ser")
        self.assertEqual((cut.head["count"], cut.head["width"], cut.head["height"]), (5, width, height))
        for mine, its in zip(ours.frames, cut.frames):
            window = mine[y : y + height, x : x + width]
            self.assertTrue((its == window).all())
            self.assertFalse((its == mine[y + 1 : y + 1 + height, x : x + width]).all(), "control: a row further down")
        self.assertEqual(cut.trailer, ours.trailer)

    def test_a_killed_run_leaves_a_sequence_with_a_true_count(self):
        ser = self.out / "frames.ser"
        with Running(BINARY, *words_of(self.folder, SER_RECORDER, "--duration", "60")) as running:
            self.wait_for_bytes(running, ser, 178 + 5 * FRAME_BYTES)
            running.stop(signal.SIGKILL)
        left, listed = Ser(ser), rows_of(self.out)
        self.assertGreaterEqual(left.head["count"], 5)
        # A frame is in the sequence before it is in the list.
        self.assertIn(left.head["count"] - len(listed), (0, 1))
        crc32s = [crc32_of(frame) for frame in left.frames]
        self.assertEqual(crc32s[: len(listed)], [row["pixel_crc32"] for row in listed])

    def test_a_full_disk_costs_frames_and_not_those_before(self):
        space = 178 + 7 * FRAME_BYTES + FRAME_BYTES // 2

        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (space, space))

        # restore_signals would make the limit a signal, which kills, instead of an error.
        sinks = SER_RECORDER + '[[extra_sink]]\nkind = "null"\n'
        done = run(self.folder, sinks, "--duration", "2", preexec_fn=limit, restore_signals=False, status=5)
        self.assertIn("frames.ser could not be written", done.stderr)
        summary = self.summary()
        recorder, null = summary["sinks"]
        self.assertIn("frames.ser could not be written", recorder["first_error"])
        self.assertEqual([loss["count"] for loss in summary["losses"]], [recorder["dropped"] + recorder["refused"]])
        self.assertEqual(recorder["frames"], 7)
        self.assertGreater(recorder["refused"], 0)
        self.assertEqual(recorder["frames"] + recorder["refused"] + recorder["dropped"], summary["frames"]["delivered"])
        self.assertEqual(null["frames"] + null["dropped"], summary["frames"]["delivered"])
        self.assertEqual(summary["event_counts"]["sink_refused"], recorder["refused"])
        ser, listed = Ser(self.out / "frames.ser"), rows_of(self.out)
        self.assertEqual([crc32_of(frame) for frame in ser.frames], [row["pixel_crc32"] for row in listed])
        self.assertEqual(len(ser.trailer), 7, "and it includes their times")

    def test_another_process_gets_the_bits_that_are_recorded(self):
        ring_path = self.folder / "ring"
        sinks = f'[sink]\nkind = "recorder"\n[[extra_sink]]\nkind = "shared_memory"\npath = "{ring_path}"\nslots = 16\n'
        running = self.enterContext(Running(BINARY, *words_of(self.folder, sinks, "--duration", "3")))
        self.wait_for_bytes(running, ring_path, 16 * FRAME_BYTES)
        time.sleep(0.05)
        with SharedFrames(ring_path) as ring:
            frames = [frame.head for frame in ring.frames()]
            self.assertEqual(running.process.wait(), 0)
            self.assertFalse(ring_path.exists(), "nothing is left behind")
            published = ring.published
            late = SharedFrames.__new__(SharedFrames)
            late.__dict__ = {**ring.__dict__, "next": 1, "missed": 0}
            last = [frame.head["frame"] for frame in late.frames()]
            self.assertEqual((len(last), late.missed), (16, published - 16), "a slow reader knows what it missed")
        reported = {head["frame"]: f"{head['pixel_crc32']:08x}" for head in frames}
        listed = {int(row["frame"]): row for row in rows_of(self.out)}
        self.assertEqual(len(reported) + ring.missed, published)
        common = reported.keys() & listed.keys()
        self.assertGreater(len(common), 10)
        for head in frames:
            if head["frame"] in common:
                row = listed[head["frame"]]
                self.assertEqual(reported[head["frame"]], row["pixel_crc32"])
                self.assertEqual(head["mid_exposure_tai_ns"], int(row["mid_exposure_tai_ns"]))
                self.assertEqual((head["qw"], head["ra_deg"]), (float(row["qw"]), float(row["ra_deg"])))
        sinks = {sink["place"]: sink for sink in self.summary()["sinks"]}
        self.assertEqual(sinks["extra_sink[0]"]["sink"], "shared_memory")
        self.assertEqual(sinks["extra_sink[0]"]["frames"], published)

    def test_an_iceoryx2_reader_gets_the_bits_that_are_recorded(self):
        service = f"starloop/test/{os.getpid()}"
        sinks = f'[sink]\nkind = "recorder"\n[[extra_sink]]\nkind = "iceoryx2"\nservice = "{service}"\nslots = 16\n'
        running = self.enterContext(Running(BINARY, *words_of(self.folder, sinks, "--duration", "4")))
        reader = None
        while reader is None:
            if running.process.poll() is not None:
                running.ended()
                error = "".join(running.said)
                if "--features iceoryx2" in error:
                    self.skipTest("starloop was built without --features iceoryx2")
                self.fail(error)
            try:
                reader = IceoryxFrames(service)
            except iceoryx2.PublishSubscribeOpenError:
                time.sleep(0.02)
        with reader:
            frames = list(reader.frames())
        self.assertEqual(running.process.wait(), 0)
        listed = {int(row["frame"]): row for row in rows_of(self.out)}
        self.assertGreater(len(frames), 10)
        self.assertEqual([frame.head.frame for frame in frames], sorted({frame.head.frame for frame in frames}))
        for head, pixels in frames:
            row = listed[head.frame]
            with fits.open(self.out / f"frame_{head.frame:06}.fits") as recorded:
                image = recorded[0].data.astype("=u2")
            self.assertEqual(image.shape, (head.height_px, head.width_px))
            self.assertEqual(pixels, image.tobytes())
            image[0, 0] ^= 1
            self.assertNotEqual(pixels, image.tobytes(), "the comparison can fail")
            self.assertEqual(f"{head.pixel_crc32:08x}", row["pixel_crc32"])
            self.assertEqual(head.mid_exposure_tai_ns, int(row["mid_exposure_tai_ns"]))
            self.assertEqual((head.attitude_wxyz[0], head.ra_dec_roll_deg[0]), (float(row["qw"]), float(row["ra_deg"])))
        sinks = {sink["place"]: sink for sink in self.summary()["sinks"]}
        self.assertEqual(sinks["extra_sink[0]"]["sink"], "iceoryx2")
        self.assertEqual(frames[-1].head.serial, sinks["extra_sink[0]"]["frames"], "the last one arrived")
        self.assertEqual(reader.missed, 0)

    def test_an_iceoryx2_reader_waits_for_a_run_that_begins(self):
        # A run has its service a moment before it publishes: a reader must wait for the first publisher.
        service = f"starloop/test/begins/{os.getpid()}"
        node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
        made = node.service_builder(iceoryx2.ServiceName.new(service))
        made = made.publish_subscribe(iceoryx2.Slice[ctypes.c_uint16]).user_header(FrameHead).open_or_create()
        begun = time.monotonic()
        with IceoryxFrames(service) as reader:
            self.assertEqual(list(reader.frames()), [])
        self.assertGreaterEqual(time.monotonic() - begun, SILENCE_S)
        del made, node

    def test_a_recorder_beside_the_first_sink_writes_where_it_says(self):
        disk = self.folder / "other disk"
        sinks = SER_RECORDER + f'[[extra_sink]]\nkind = "recorder"\ndirectory = "{disk}"\n'
        run(self.folder, sinks, "--clock", "virtual", "--duration", "1", status=0)
        place = disk / self.out.name
        self.assertEqual(rows_of(place), rows_of(self.out))
        self.assertEqual(len(list(place.glob("*.fits"))), 10)
        self.assertEqual(list(self.out.glob("extra*")), [])
        reported = {sink["place"]: sink["output"] for sink in self.summary()["sinks"]}
        self.assertEqual(reported["extra_sink[0]"], str(place))
        same = sinks.replace("fits = false", 'fits = false\ndirectory = "a"').replace(str(disk), "./a")
        refused = run(self.folder, same, "--clock", "virtual", "--duration", "1")
        self.assertIn("extra_sink[0].directory", refused.stderr)
        self.assertIn("no other sink has", refused.stderr)

    def test_each_head_has_its_own_sinks(self):
        scenario = ROOT / "configs/scenarios/three_heads.toml"
        settings = ['bench.sink={ kind = "recorder", fits = false, ser = true }',
                    'bench.extra_sink=[{ kind = "recorder" }]', "expect.window_s=1", "expect.recovery_s=1"]
        words = [word for setting in settings for word in ("--set", setting)]
        # Three seconds are too short for what the scenario expects of the pointing.
        starloop("run", scenario, "--clock", "virtual", "--duration", "3", "--out", self.out, *words, status=(0, 4))
        report = json.loads((self.out / "scenario.json").read_text())
        places = [f"head{head} {place}" for head in range(3) for place in ("sink", "extra_sink[0]")]
        self.assertEqual([sink["place"] for sink in report["sinks"]], places)
        crc32s = []
        for head in range(3):
            listed = rows_of(self.out / f"head{head}")
            frames = [crc32_of(frame) for frame in Ser(self.out / f"head{head}/frames.ser").frames]
            self.assertEqual(frames, [row["pixel_crc32"] for row in listed])
            self.assertEqual(rows_of(self.out / f"head{head}/extra_sink_0"), listed)
            self.assertGreater(len(frames), 4)
            crc32s.append(tuple(frames))
        self.assertEqual(len(set(crc32s)), 3, "each head sees another sky")

    def test_simulated_runs_with_several_sinks_repeat_bit_for_bit(self):
        sinks = SER_RECORDER + '[[extra_sink]]\nkind = "recorder"\nfits = true\n[[extra_sink]]\nkind = "null"\n'
        bits = []
        for number in range(2):
            self.out = self.folder / "run"
            run(self.folder, sinks, "--clock", "virtual", "--duration", "1", status=0)
            lines = [(sink["place"], sink["frames"], sink["run_crc32"]) for sink in self.summary()["sinks"]]
            self.assertEqual([line[1] for line in lines], [10, 10, 10])
            bits.append((lines, (self.out / "frames.ser").read_bytes()))
            self.assertEqual(len(list((self.out / "extra_sink_0").glob("*.fits"))), 10)
            self.out.rename(self.folder / f"run{number}")
        self.assertEqual(bits[0], bits[1])
        self.assertEqual(len({line[2] for line in bits[0][0]}), 1, "the same frames in each")


if __name__ == "__main__":
    unittest.main()
