"""Tests of the network camera's events and actions: python3 hil_scripts/tests/test_camera_events.py

Events of the message channel are taken by the reference GenApi and by tshark; actions start exposures, at once and at an
instant, and the attitude of a slew is that of their exposures. Needs genicam (PyPI), tshark and aravis-tools-cli (apt).
"""

import struct
import tempfile
import unittest
from pathlib import Path

from support import ARCSEC, output
from gvcp_client import ACTION, STREAM_ADDRESS, STREAM_PORT, Client, Messages, Refused, Stream, bits_of, turned_as_stamped
from test_camera_genicam import Bench

SECOND_NS = 1_000_000_000
PERIOD_NS = SECOND_NS // 10
EXPOSURE_NS = 20_000_000
SLEW = "[flight_computer.motion]\nkind = \"constant_rate\"\nrate_deg_s = [0.0, 1.0, 0.0]\n"
EVENTS = {"FrameTrigger": 0x0002, "ExposureStart": 0x0003, "ExposureEnd": 0x0004, "FrameTriggerMissed": 0x9001}
KEYS = 11, 22, 6


def truth_of(nodes, frame):
    """Frame number, attitude and trigger delay of a frame, from its chunk data at the addresses that the XML states."""
    data = frame["data"]
    chunk_id, length = struct.unpack(">II", data[-8:])
    assert chunk_id == 2, "the truth comes last"
    truth = data[-8 - length:-8]
    # Fields have 8 bytes, in the order of guide/frame_facts.md.
    number, _, exposure_us, *attitude = struct.unpack(">qqddddd", truth[:56])
    return {"number": number, "exposure_us": exposure_us, "attitude": attitude}


class Receiver:
    """A client with features, events in GenApi's nodes, and a stream with chunk data."""

    def __init__(self, bench):
        from genicam.genapi import EventAdapterGEV

        self.client = Client(bench.address)
        self.nodes = self.client.nodes()
        self.adapter = EventAdapterGEV()
        self.adapter.attach_node_map(self.nodes.pointer)
        self.stream = Stream()
        self.set(ChunkModeActive=True, ExposureTime=EXPOSURE_NS / 1e3)
        self.client.write_words({STREAM_ADDRESS: bits_of("127.0.0.1"), STREAM_PORT: self.stream.port})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        # GenApi wants them apart before they go.
        self.adapter.detach_node_map()
        self.client.close()

    def set(self, **features):
        for name, value in features.items():
            self.nodes.get_node(name).value = value

    def get(self, name):
        return self.nodes.get_node(name).value

    def do(self, name):
        self.nodes.get_node(name).execute()

    def want(self, *events):
        for event in events:
            self.set(EventSelector=event, EventNotification="On")

    def event(self, name, message):
        """Time and frame of an event as GenApi reads them out of a message."""
        self.adapter.deliver_message(message)
        return self.get(f"Event{name}Timestamp"), self.get(f"Event{name}FrameID")


def event_id(message):
    return struct.unpack(">H", message[10:12])[0]


def dissected(messages):
    """Returns each message as tshark dissects it: command, event, time stamp."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "messages.pcap"
        # Raw IPv4 packets.
        with path.open("wb") as capture:
            capture.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101))
            for number, message in enumerate(messages):
                udp = struct.pack(">HHHH", 50_000, 3956, 8 + len(message), 0) + message
                head = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, bytes([127, 0, 0, 1]), bytes([127, 0, 0, 1]))
                capture.write(struct.pack("<IIII", number, 0, len(head + udp), len(head + udp)) + head + udp)
        fields = ["gvcp.cmd.command", "gvcp.cmd.event.id", "gvcp.cmd.event.timestamp", "_ws.malformed"]
        command = ["tshark", "-r", str(path), "-T", "fields", *(word for field in fields for word in ("-e", field))]
        return [line.split("\t") for line in output(*command).splitlines()]


class Events(unittest.TestCase):
    def test_exposures_report_start_and_end_with_their_instants_and_frames(self):
        with Bench() as bench, Receiver(bench) as receiver:
            messages = Messages(receiver.client)
            receiver.want("ExposureStart", "ExposureEnd")
            receiver.do("AcquisitionStart")
            frames, reported = {}, {"ExposureStart": {}, "ExposureEnd": {}}
            names = {number: name for name, number in EVENTS.items()}
            all_messages = []
            while len(frames) < 20:
                frame = receiver.stream.frame()
                truth = truth_of(receiver.nodes, frame)
                frames[truth["number"]] = frame["time_ns"]
                while message := messages.next(patience_s=0.001):
                    all_messages.append(message)
                    name = names[event_id(message)]
                    at_ns, number = receiver.event(name, message)
                    reported[name][number] = at_ns
            receiver.do("AcquisitionStop")
        both = [number for number in frames if number in reported["ExposureStart"] and number in reported["ExposureEnd"]]
        self.assertGreater(len(both), 15, reported)
        for number in both:
            self.assertEqual(reported["ExposureStart"][number], frames[number] - EXPOSURE_NS // 2, number)
            self.assertEqual(reported["ExposureEnd"][number], frames[number] + EXPOSURE_NS // 2, number)
        self.assertNotEqual(reported["ExposureEnd"][both[0]], frames[both[0]], "control")
        lines = dissected(all_messages)
        self.assertEqual(len(lines), len(all_messages))
        for line, message in zip(lines, all_messages):
            self.assertEqual(int(line[0], 0), 0xC2, line)
            self.assertEqual(int(line[1], 0), event_id(message), line)
            self.assertEqual(line[3], "", line)
        malformed = dissected([all_messages[0][:-12]])[0]
        self.assertNotEqual(malformed[1:], dissected([all_messages[0]])[0][1:], "control: a message cut short")

    def test_triggers_and_missed_ones_are_events(self):
        with Bench() as bench, Receiver(bench) as receiver:
            messages = Messages(receiver.client)
            receiver.want("FrameTrigger", "FrameTriggerMissed")
            receiver.set(TriggerMode="On", TriggerSource="Software", TriggerOverlap="Off")
            receiver.do("AcquisitionStart")
            while receiver.stream.frame(patience_s=1.0):
                pass
            receiver.do("TriggerSoftware")
            receiver.do("TriggerSoftware")
            got = [messages.next(patience_s=5.0) for _ in range(2)]
            self.assertEqual(sorted(event_id(message) for message in got), [EVENTS["FrameTrigger"], EVENTS["FrameTriggerMissed"]])
            self.assertIsNone(messages.next(patience_s=0.5), "one of each")
            self.assertIsNotNone(receiver.stream.frame(patience_s=5.0))
            self.assertIsNone(receiver.stream.frame(patience_s=0.5), "one frame")

    def test_a_message_that_is_not_answered_comes_again_under_its_number(self):
        with Bench() as bench, Receiver(bench) as receiver:
            messages = Messages(receiver.client, timeout_ms=50, retries=3, left_unanswered=2)
            receiver.want("ExposureEnd")
            got = [messages.next() for _ in range(6)]
        self.assertEqual((got[0], got[1]), (got[1], got[2]), "twice again, then answered")
        numbers = [struct.unpack(">H", message[6:8])[0] for message in got[2:]]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + 4)))


class Actions(unittest.TestCase):
    def prepared(self, receiver):
        device, group, mask = KEYS
        receiver.set(ActionDeviceKey=device, ActionGroupKey=group, ActionGroupMask=mask, TriggerMode="On", TriggerSource="Action1")
        receiver.do("AcquisitionStart")
        while receiver.stream.frame(patience_s=1.0):
            pass

    def test_scheduled_actions_start_exposures_of_a_slew_at_their_instants(self):
        with Bench(slew=SLEW) as bench, Receiver(bench) as receiver:
            self.prepared(receiver)
            places, lateness_ns = [], []
            for number in range(10):
                at_ns = receiver.client.now_ns() + 150_000_000 + 1_234_567 * number
                receiver.client.action(*KEYS, at_ns=at_ns)
                frame = receiver.stream.frame(patience_s=5.0)
                self.assertIsNotNone(frame, number)
                places.append((frame["time_ns"], truth_of(receiver.nodes, frame)["attitude"]))
                lateness_ns.append(frame["time_ns"] - EXPOSURE_NS // 2 - at_ns)
            with self.assertRaises(Refused) as late:
                receiver.client.action(*KEYS, at_ns=receiver.client.now_ns() - 1_000_000)
            self.assertEqual(late.exception.status, 0x8016, "too late")
            self.assertIsNone(receiver.stream.frame(patience_s=0.5))
        self.assertEqual(lateness_ns, [0] * len(lateness_ns), "to the nanosecond")
        turned_as_stamped(self, places, ARCSEC)

    def test_actions_at_once_start_exposures_of_a_slew(self):
        with Bench(slew=SLEW) as bench, Receiver(bench) as receiver:
            self.prepared(receiver)
            places, delays_us = [], []
            for number in range(30):
                before = receiver.client.now_ns()
                receiver.client.action(*KEYS)
                after = receiver.client.now_ns()
                frame = receiver.stream.frame(patience_s=5.0)
                self.assertIsNotNone(frame, number)
                start_ns = frame["time_ns"] - EXPOSURE_NS // 2
                self.assertTrue(before <= start_ns <= after, (before, start_ns, after))
                delays_us.append((start_ns - before) * 1e-3)
                places.append((frame["time_ns"], truth_of(receiver.nodes, frame)["attitude"]))
            self.assertFalse(before <= start_ns + SECOND_NS <= after, "control: an exposure that starts later")
            # The same keys without a group in common.
            payload = struct.pack(">III", KEYS[0], KEYS[1], 8)
            receiver.client.socket.sendto(struct.pack(">BBHHH", 0x42, 0, ACTION, 12, 9) + payload, (bench.address, 3956))
            self.assertIsNone(receiver.stream.frame(patience_s=0.5), "meant for other cameras")
        turned_as_stamped(self, places, ARCSEC)
        delays_us.sort()
        middle, most = delays_us[len(delays_us) // 2], delays_us[-1]
        print(f"\naction to exposure, us: p50 {middle:.0f}, p99 and largest {most:.0f} of {len(delays_us)}")


if __name__ == "__main__":
    unittest.main()
