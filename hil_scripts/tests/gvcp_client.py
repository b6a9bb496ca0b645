"""A client of network cameras for tests: GVCP and GVSP from their definition, features by the reference GenApi.

Shares no code with what it tests. `turned_as_stamped` judges the attitudes that cameras report. Needs genicam (PyPI) for `Client.nodes`. Times are in ns of the camera's clock.
"""

import io
import math
import socket
import struct
import subprocess
import zipfile

PATIENCE_S = 60.0
GVCP_PORT = 3956
READ_REGISTER, WRITE_REGISTER, READ_MEMORY, WRITE_MEMORY, ACTION, EVENT_DATA = 0x80, 0x82, 0x84, 0x86, 0x100, 0xC2
CONTROL, HEARTBEAT_MS = 0xA00, 0x938
STREAM_PORT, STREAM_ADDRESS, PACKET_SIZE = 0xD00, 0xD18, 0xD04
MESSAGE_PORT, MESSAGE_ADDRESS, MESSAGE_TIMEOUT, MESSAGE_RETRIES = 0xB00, 0xB10, 0xB14, 0xB18


class Refused(RuntimeError):
    """The camera answered with an error; its number is `status`."""

    def __init__(self, status):
        super().__init__(f"status {status:x}")
        self.status = status


def arv_tool(address, *words):
    """Returns what Aravis's command says about a camera."""
    command = ["arv-tool-0.8", "-a", address, *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    return done.stdout + done.stderr


def bits_of(address):
    return struct.unpack(">I", socket.inet_aton(address))[0]


def turned_as_stamped(test, places, arcsec):
    """Attitudes (ns, w x y z) turn by as much as their time stamps say, at 1 deg/s."""
    (first_ns, first), rest = places[0], places[1:]
    for at_ns, wxyz in rest:
        turned = 2.0 * math.acos(min(1.0, abs(sum(a * b for a, b in zip(first, wxyz)))))
        test.assertAlmostEqual(turned / arcsec, (at_ns - first_ns) * 1e-9 * 3600.0, delta=2.0)


class Client:
    """Control of a camera, from its creation to `close`."""

    def __init__(self, address, own="127.0.0.1"):
        self.address, self.own = address, own
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.bind((own, 0))
        # A command under the number of the last one is taken for that one again.
        self.number = 0
        self.xml = self.read_xml()
        self.write_words({CONTROL: 2, HEARTBEAT_MS: 600_000})

    def close(self):
        self.write_words({CONTROL: 0})
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def ask(self, code, payload, flags=1):
        self.number = self.number % 65535 + 1
        self.socket.sendto(struct.pack(">BBHHH", 0x42, flags, code, len(payload), self.number) + payload,
                           (self.address, GVCP_PORT))
        answer = self.socket.recv(1024)
        status, reported, length, number = struct.unpack(">HHHH", answer[:8])
        assert (reported, number, length) == (code + 1, self.number, len(answer) - 8), answer
        if status:
            raise Refused(status)
        return answer[8:]

    def read(self, place, length):
        return b"".join(self.ask(READ_MEMORY, struct.pack(">IHH", place + done, 0, min(512, length - done)))[4:]
                        for done in range(0, length, 512))

    def write(self, place, data):
        self.ask(WRITE_MEMORY, struct.pack(">I", place) + bytes(data))

    def word(self, place):
        return struct.unpack(">I", self.ask(READ_REGISTER, struct.pack(">I", place)))[0]

    def write_words(self, words):
        for place, value in words.items():
            self.ask(WRITE_REGISTER, struct.pack(">II", place, value))

    def read_xml(self):
        """The camera's description; who reads it has proven its address."""
        name, place, length = self.read(0x200, 512).split(b"\0")[0].decode().split(";")
        data = self.read(int(place, 16), (int(length, 16) + 3) // 4 * 4)
        if name.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                data = archive.read(archive.namelist()[0])
        return data.decode().rstrip("\n\0")

    def nodes(self, xml=None):
        """The features by the reference GenApi, of the camera's description or another; the object must live as long as they are used."""
        from genicam.genapi import AbstractPort, EAccessMode, NodeMap

        client = self

        class Port(AbstractPort):
            def is_open(self):
                return True

            def get_access_mode(self):
                return EAccessMode.RW

            def read(self, place, length):
                return client.read(place, length)

            def write(self, place, data):
                client.write(place, data)

        nodes = NodeMap()
        nodes.load_xml_from_string(xml or self.xml)
        self.port = Port()
        nodes.connect(self.port, "Device")
        return nodes

    def action(self, device_key, group_key, group_mask, at_ns=None):
        """An action command, at once or at an instant of the camera's clock."""
        payload = struct.pack(">III", device_key, group_key, group_mask)
        if at_ns is None:
            return self.ask(ACTION, payload)
        return self.ask(ACTION, payload + struct.pack(">Q", at_ns), flags=0x81)

    def now_ns(self):
        """The time of the camera's clock, latched."""
        self.write_words({0x944: 2})
        return struct.unpack(">Q", self.read(0x948, 8))[0]


class Messages:
    """The client's end of the message channel. Each event is answered, except the first `left_unanswered`."""

    def __init__(self, client, timeout_ms=200, retries=3, left_unanswered=0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.bind((client.own, 0))
        self.left_unanswered = left_unanswered
        client.write_words({MESSAGE_PORT: self.socket.getsockname()[1], MESSAGE_ADDRESS: bits_of(client.own),
                            MESSAGE_TIMEOUT: timeout_ms, MESSAGE_RETRIES: retries})

    def __del__(self):
        self.socket.close()

    def next(self, patience_s=PATIENCE_S):
        """The next datagram; `None` when none comes."""
        self.socket.settimeout(patience_s)
        try:
            message, sender = self.socket.recvfrom(1024)
        except TimeoutError:
            return None
        key, flags, code, length, number = struct.unpack(">BBHHH", message[:8])
        assert (key, length) == (0x42, len(message) - 8), message
        if self.left_unanswered > 0:
            self.left_unanswered -= 1
        elif flags & 1:
            self.socket.sendto(struct.pack(">HHHH", 0, code + 1, 0, number), sender)
        return message


class Stream:
    """The receiving end of a stream, also of one to a group. Packets that are lost stay lost."""

    def __init__(self, own="127.0.0.1", group=None, port=0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.bind((group or own, port))
        if group:
            self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                                   socket.inet_aton(group) + socket.inet_aton(own))
        self.port = self.socket.getsockname()[1]

    def __del__(self):
        self.socket.close()

    def frame(self, patience_s=PATIENCE_S):
        """The next whole frame: leader's fields and the payload; `None` when none comes."""
        self.socket.settimeout(patience_s)
        block = None
        while True:
            try:
                packet = self.socket.recv(65536)
            except TimeoutError:
                return None
            status, number, kind, _, place = struct.unpack(">HHBBH", packet[:8])
            if kind == 1:
                _, content, stamp_ns, pixel_format, columns, rows = struct.unpack(">HHQIII", packet[8:32])
                frame = {"time_ns": stamp_ns, "format": pixel_format, "size": (columns, rows), "content": content}
                block, parts = number, {}
            elif block == number and kind == 3 and status == 0:
                parts[place] = packet[8:]
            elif block == number and kind == 2 and sorted(parts) == list(range(1, place)):
                return {**frame, "block": number, "data": b"".join(parts[place] for place in sorted(parts))}
