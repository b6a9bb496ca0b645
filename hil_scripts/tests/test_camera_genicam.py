"""A network camera whose exposures its client commands: python3 hil_scripts/tests/test_camera_genicam.py

`starloop run` on the real clock with a network camera; arv-tool and Aravis from Python set exposure, gain and triggers
by the names of GenICam SFNC. Needs aravis-tools-cli, gir1.2-aravis-0.8, python3-gi and python3-numpy (apt).
"""

import json
import re
import sys
import tempfile
import time
import unittest
from pathlib import Path

from gvcp_client import arv_tool, turned_as_stamped
from support import ADDRESSES, ARCSEC, BINARY, CAMERA, SYSTEM_PYTHON, Running, ran, until

PATIENCE_S = 60.0
BLACK_DN, FULL_DN, GAIN_E_PER_DN, READ_NOISE_E = 100.0, 4095.0, 25.1, 55.0
#: Signal of every pixel, e-/s.
LIGHT_E_PER_S = 80000.0
#: Chunks that are read, by type.
CHUNKS = {
    "float": ["ChunkExposureTime", "ChunkGain", "ChunkBlackLevel", "ChunkTriggerDelay",
              "ChunkAttitudeW", "ChunkAttitudeX", "ChunkAttitudeY", "ChunkAttitudeZ", "ChunkRateX", "ChunkRateY"],
    "integer": ["ChunkFrameID", "ChunkTimestamp"],
    "string": ["ChunkStartedBy"],
}

BENCH = """name = "commanded"
camera = "small.toml"
seed = 1
[timing]
frame_rate_hz = 10.0
duration_s = 600.0
[flight_computer]
kind = "simulated"
attitude_hz = 100.0
ra_deg = 84.05
dec_deg = -1.2
{slew}
[sink]
kind = "network_camera"
address = "{address}"
{events}
"""


class Bench(Running):
    """A run with a network camera, until the end of a `with` block."""

    def __init__(self, slew="", events="", head=""):
        self.folder = tempfile.TemporaryDirectory()
        folder = Path(self.folder.name)
        camera = CAMERA.read_text()
        for key, value in (("prnu", 0.0), ("dsnu_e_rms", 0.0), ("dark_e_per_s", LIGHT_E_PER_S), ("limiting_mag", 3.5)):
            camera, changed = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value}", camera)
            assert changed == 1, key
        (folder / "small.toml").write_text(camera)
        self.address = next(ADDRESSES)
        (folder / "bench.toml").write_text(BENCH.format(slew=slew, events=events, address=self.address) + head)
        super().__init__(BINARY, "run", folder / "bench.toml", "--clock", "real", "--json")

    def __enter__(self):
        is_there = lambda: self.process.poll() is not None or "Width" in self.arv_tool("control", "Width")
        until(lambda: "".join(self.said), is_there, PATIENCE_S, every_s=0.1)
        assert self.process.poll() is None, "".join(self.said)
        return self

    def __exit__(self, *_):
        self.process.terminate()
        try:
            self.ended(PATIENCE_S)
        finally:
            super().__exit__()
            self.folder.cleanup()

    def arv_tool(self, *words):
        return arv_tool(self.address, *words)

    def client(self, what, **wanted):
        """Runs a function of this file as a client, in the system's Python."""
        request = json.dumps({"address": self.address, "what": what, **wanted})
        done = ran(SYSTEM_PYTHON, __file__, "--client", request, timeout=4 * PATIENCE_S)
        assert done.returncode == 0, done.stderr + "".join(self.said)[-2000:]
        return json.loads(done.stdout.splitlines()[-1])


# --- the client, run by the system's Python ---------------------------------------------------------------------------


class Client:
    """A camera under Aravis, with chunks."""

    def __init__(self, address):
        from aravis import Aravis, stream_of

        self.camera = Aravis.Camera.new(address)
        self.device = self.camera.get_device()
        self.device.set_boolean_feature_value("ChunkModeActive", True)
        self.stream = stream_of(self.camera)
        self.parser = self.camera.create_chunk_parser()

    def set(self, **features):
        for name, value in features.items():
            if isinstance(value, str):
                self.device.set_string_feature_value(name, value)
            elif isinstance(value, float):
                self.device.set_float_feature_value(name, value)
            else:
                self.device.set_integer_feature_value(name, value)

    def frame(self, patience_s=10.0):
        """The next whole frame: pixels and chunks; `None` when none comes."""
        import numpy

        until = time.monotonic() + patience_s
        while time.monotonic() < until:
            buffer = self.stream.timeout_pop_buffer(100_000)
            if buffer is None:
                continue
            reported = None
            if buffer.get_status().value_nick == "success":
                size = buffer.get_image_height(), buffer.get_image_width()
                pixels = numpy.frombuffer(buffer.get_image_data()[: 2 * size[0] * size[1]], "<u2").astype(float).reshape(size)
                reported = pixels, self.chunks(buffer)
            self.stream.push_buffer(buffer)
            if reported:
                return reported
        return None

    def chunks(self, buffer):
        read = {"float": self.parser.get_float_value, "integer": self.parser.get_integer_value, "string": self.parser.get_string_value}
        return {name[5:]: read[kind](buffer, name) for kind, names in CHUNKS.items() for name in names}


def measure(client, request):
    """Sets of features, and of each: mean, noise by differences, and what the frames say of themselves."""
    import numpy

    reported = []
    client.camera.start_acquisition()
    for features in request["sets"]:
        client.set(**features)
        is_wanted = lambda chunks: abs(chunks["ExposureTime"] - features["ExposureTime"]) < 0.5 and abs(chunks["Gain"] - features["Gain"]) < 1e-9
        frames = []
        for _ in range(200):
            pixels, chunks = client.frame()
            if is_wanted(chunks):
                frames.append(pixels)
            if len(frames) == 12:
                break
        noise = [numpy.var(a - b) / 2.0 for a, b in zip(frames[::2], frames[1::2])]
        reported.append({"mean": float(numpy.mean(frames)), "noise": float(numpy.mean(noise)), "frames": len(frames), "chunks": chunks})
    client.camera.stop_acquisition()
    return reported


def follow(client, request):
    """An exposure loop of the client: each frame sets the next exposure."""
    reported = []
    exposure_us, target = 1000.0, request["target_dn"]
    client.set(ExposureTime=exposure_us)
    client.camera.start_acquisition()
    until = time.monotonic() + request["seconds"]
    while time.monotonic() < until:
        pixels, chunks = client.frame()
        signal = pixels.mean() - chunks["BlackLevel"]
        reported.append([chunks["ExposureTime"], float(signal)])
        wanted = min(max(chunks["ExposureTime"] * target / max(signal, 1.0), 20.0), 90000.0)
        if abs(wanted - exposure_us) > 0.005 * exposure_us:
            exposure_us = wanted
            client.set(ExposureTime=exposure_us)
    client.camera.stop_acquisition()
    return reported


def automatic(client, request):
    """ExposureAuto once: what the camera chose, by its features and by its frames."""
    client.set(ExposureTime=100.0)
    client.camera.start_acquisition()
    client.frame()
    client.set(ExposureAuto="Once")
    frames = 0
    while client.device.get_string_feature_value("ExposureAuto") != "Off" and frames < 100:
        frames += 1
        client.frame()
    for _ in range(5):
        pixels, chunks = client.frame()
    client.camera.stop_acquisition()
    chosen = client.device.get_float_feature_value("ExposureTime")
    return {"frames": frames, "chosen_us": chosen, "chunks": chunks, "mean": float(pixels.mean())}


def trigger(client, request):
    """Software triggers: when each was sent and answered, TAI in ns, and the frame that it started."""
    reported = []
    client.set(TriggerSelector="FrameStart", TriggerMode="On", TriggerSource="Software", ExposureTime=20000.0,
               TriggerDelay=request["delay_us"])
    client.camera.start_acquisition()
    while client.frame(patience_s=1.0):
        pass
    for _ in range(request["triggers"]):
        before = time.clock_gettime_ns(time.CLOCK_REALTIME)
        client.camera.software_trigger()
        after = time.clock_gettime_ns(time.CLOCK_REALTIME)
        got = client.frame()
        reported.append({"before": before, "after": after, "chunks": got and got[1]})
    reported.append({"more": client.frame(patience_s=1.0) is not None})
    client.camera.stop_acquisition()
    return reported


def regions(client, request):
    """Two regions at a rate that is too high for whole frames: what features and frames say, and the pixels."""
    device = client.device
    reported = {"most_hz": [device.get_float_feature_value("AcquisitionFrameRate") and client.camera.get_frame_rate_bounds()[1]]}
    for number, (left, top, width, height) in enumerate(request["regions"]):
        client.set(RegionSelector=f"Region{number}")
        client.set(RegionMode="On")
        client.set(Width=width)
        client.set(Height=height)
        client.set(OffsetX=left)
        client.set(OffsetY=top)
    reported["most_hz"].append(client.camera.get_frame_rate_bounds()[1])
    client.set(ExposureTime=request["exposure_us"], AcquisitionFrameRate=request["rate_hz"])
    reported["payload"] = client.camera.get_payload()
    client.camera.start_acquisition()
    frames = [client.frame() for _ in range(request["frames"])]
    client.camera.stop_acquisition()
    reported["sizes"] = [list(pixels.shape) for pixels, _ in frames]
    reported["chunks"] = [chunks for _, chunks in frames]
    reported["pixels"] = [pixels.tolist() for pixels, _ in frames[-2:]]
    return reported


CLIENTS = {"automatic": automatic, "regions": regions, "measure": measure, "follow": follow, "trigger": trigger}


# --- tests ------------------------------------------------------------------------------------------------------------


class Commanded(unittest.TestCase):
    def test_arv_tool_sets_exposure_and_gain_and_refuses_what_cannot_be(self):
        with Bench() as bench:
            reported = bench.arv_tool("control", "ExposureTime=50000", "Gain=6", "ExposureTime", "Gain", "BlackLevel")
            self.assertRegex(reported, r"ExposureTime = 50000 us")
            self.assertRegex(reported, r"Gain = 6 dB")
            reported = bench.arv_tool("control", "Gain=99", "Gain")
            self.assertNotRegex(reported, r"Gain = 99", reported)
            reported = bench.arv_tool("features")
            for name in ("ExposureAuto", "GainAuto", "TriggerDelay", "TriggerOverlap", "AcquisitionFrameRateEnable"):
                self.assertIn(f"'{name}'", reported)

    def test_light_and_noise_follow_exposure_and_gain(self):
        sets = [{"ExposureTime": 20000.0, "Gain": 0.0}, {"ExposureTime": 50000.0, "Gain": 0.0}, {"ExposureTime": 50000.0, "Gain": 6.0}]
        with Bench() as bench:
            reported = bench.client("measure", sets=sets)
        for features, got in zip(sets, reported):
            self.assertEqual(got["frames"], 12, got)
            dn_per_e = 10.0 ** (features["Gain"] / 20.0) / GAIN_E_PER_DN
            mean = LIGHT_E_PER_S * features["ExposureTime"] * 1e-6 * dn_per_e
            self.assertAlmostEqual((got["mean"] - BLACK_DN) / mean, 1.0, delta=0.01, msg=str(features))
            noise = dn_per_e * mean + (dn_per_e * READ_NOISE_E) ** 2 + 1.0 / 12.0
            self.assertAlmostEqual(got["noise"] / noise, 1.0, delta=0.015, msg=str(features))
        self.assertGreater(reported[2]["mean"] / reported[1]["mean"], 1.5, "control: not all the same")

    def test_an_exposure_loop_of_the_client_follows_the_light(self):
        brighter = f"[[event]]\nat_s = 12.0\nfor_s = 600.0\ndo = \"stray_light\"\ne_per_s = {29.0 * LIGHT_E_PER_S}\n"
        target = 250.0
        with Bench(events=brighter) as bench:
            reported = bench.client("follow", target_dn=target, seconds=20.0)
        is_near = [abs(signal / target - 1.0) < 0.03 for _, signal in reported]
        first = is_near.index(True)
        exposure_us = target * GAIN_E_PER_DN / LIGHT_E_PER_S * 1e6
        jump = next(k for k in range(first, len(reported)) if reported[k][1] > 3.0 * target)
        self.assertTrue(all(is_near[first + 3:jump]), reported[:jump])
        self.assertTrue(all(is_near[-10:]), reported[-20:])
        # Every frame's own exposure time is that of its pixels.
        for exposure, signal in reported[jump - 10:jump] + reported[-10:]:
            light = LIGHT_E_PER_S if exposure > exposure_us / 5.0 else 30.0 * LIGHT_E_PER_S
            self.assertAlmostEqual(signal / (exposure * 1e-6 * light / GAIN_E_PER_DN), 1.0, delta=0.02)

    def test_automatic_exposure_once_ends_and_is_read_back(self):
        stray_light = "[[event]]\nat_s = 0.0\nfor_s = 600.0\ndo = \"stray_light\"\ne_per_s = 1000000.0\n"
        with Bench(events=stray_light) as bench:
            reported = bench.client("automatic")
        target = 0.25 * (FULL_DN - BLACK_DN)
        self.assertLess(reported["frames"], 100, "ExposureAuto reads Off")
        self.assertAlmostEqual((reported["mean"] - BLACK_DN) / target, 1.0, delta=0.03)
        self.assertAlmostEqual(reported["chosen_us"], reported["chunks"]["ExposureTime"], places=3)
        self.assertAlmostEqual(reported["chosen_us"] * 1e-6 * (LIGHT_E_PER_S + 1e6) / GAIN_E_PER_DN / target, 1.0, delta=0.03)

    def test_regions_are_sent_alone_at_a_rate_of_their_own(self):
        places, exposure_us, rate_hz, frames = [[30, 20, 64, 32], [100, 200, 40, 16]], 5000.0, 80.0, 40
        with Bench() as bench:
            reported = bench.client("regions", regions=places, exposure_us=exposure_us, rate_hz=rate_hz, frames=frames)
        # 20 ms for 256 rows.
        for most_hz, rows in zip(reported["most_hz"], (256, 48)):
            self.assertAlmostEqual(most_hz, 50.0 * 256 / rows, places=6)
        self.assertEqual(reported["sizes"], [[48, 64]] * frames, "one below the other, as wide as the widest")
        self.assertGreater(reported["payload"], 2 * 48 * 64)
        self.assertLess(reported["payload"], 4 * 48 * 64, "control: no whole image")
        stamps = [chunks["Timestamp"] for chunks in reported["chunks"]]
        periods = [later - stamp for stamp, later in zip(stamps, stamps[1:])]
        self.assertEqual(sorted(periods)[len(periods) // 2], round(1e9 / rate_hz))
        import numpy

        dark, light = BLACK_DN, LIGHT_E_PER_S * exposure_us * 1e-6 / GAIN_E_PER_DN
        for pixels in map(numpy.array, reported["pixels"]):
            self.assertTrue((pixels[32:, 40:] == 0).all(), "beside the narrower one")
            for part in (pixels[:32], pixels[32:, :40]):
                self.assertGreater(part.min(), dark - 20.0, "no pixel that was not read out")
                self.assertAlmostEqual((numpy.median(part) - dark) / light, 1.0, delta=0.1)

    def test_software_triggers_start_exposures_of_a_slew(self):
        delay_us, exposure_ns = 1500.0, 20_000_000
        slew = "[flight_computer.motion]\nkind = \"constant_rate\"\nrate_deg_s = [0.0, 1.0, 0.0]\n"
        with Bench(slew=slew) as bench:
            reported = bench.client("trigger", triggers=20, delay_us=delay_us)
        self.assertEqual(reported.pop(), {"more": False}, "an exposure for each trigger")
        calls, places = [], []
        for shot in reported:
            chunks = shot["chunks"]
            self.assertIsNotNone(chunks, shot)
            self.assertEqual((chunks["StartedBy"], chunks["TriggerDelay"]), ("software", delay_us))
            places.append((chunks["Timestamp"], [chunks[f"Attitude{axis}"] for axis in "WXYZ"]))
            calls.append((shot["before"], chunks["Timestamp"] - exposure_ns // 2 - round(delay_us * 1e3), shot["after"]))
        # The camera's clock and the host's differ by a constant: with it every trigger's instant is within its call.
        least = max(before - stamp for before, stamp, _ in calls)
        most = min(after - stamp for _, stamp, after in calls)
        self.assertLessEqual(least, most)
        before, stamp, after = calls[7]
        self.assertLess(min(most, after - (stamp + 100_000_000_000)), least, "control: an exposure that starts later")
        turned_as_stamped(self, places, ARCSEC)
        delays = sorted((stamp + least - before) * 1e-3 for before, stamp, _ in calls)
        print(f"\ncall to trigger, us beyond the shortest: p50 {delays[len(delays) // 2]:.0f}, p99 and largest {delays[-1]:.0f} of {len(delays)}")


def main():
    if sys.argv[1:2] == ["--client"]:
        request = json.loads(sys.argv[2])
        print(json.dumps(CLIENTS[request["what"]](Client(request["address"]), request)))
        return
    unittest.main()


if __name__ == "__main__":
    main()
