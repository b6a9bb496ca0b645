"""Tests of `starloop bus` with python-can on the other side: python3 hil_scripts/tests/test_gateways.py

Needs python-can and pyserial (requirements_flight_computer.txt).
"""

import contextlib
import errno
import json
import os
import select
import socket
import tempfile
import time
import unittest

import can

from support import BINARY, Running, starloop, until

# Seconds that a healthy program never needs, on however busy a machine.
PATIENCE_S = 20.0


class Program(Running):
    """`starloop bus` with the three gateways, from its addresses to its summary."""

    def __init__(self, *options):
        self.folder = tempfile.TemporaryDirectory()
        self.pty = os.path.join(self.folder.name, "slcan")
        super().__init__(BINARY, "bus", "--json", "--slcan-tcp", "0", "--slcan-pty", self.pty, "--socketcand", "0", *options)

    def __enter__(self):
        until(lambda: f"three addresses: {self.said}", lambda: self.process.poll() is not None or len(self.printed) >= 3)
        self.addresses = {line["gateway"]: line["address"] for line in map(json.loads, self.printed[:3])}
        return self

    def __exit__(self, *_):
        super().__exit__()
        self.folder.cleanup()

    def port(self, gateway):
        host, port = self.addresses[gateway].rsplit(":", 1)
        assert host == "127.0.0.1", f"listens on {host}"
        return int(port)

    def slcan_tcp(self, **options):
        return self.slcan(f"socket://127.0.0.1:{self.port('slcan_tcp')}", **options)

    def slcan_pty(self, **options):
        return self.slcan(self.pty, **options)

    @staticmethod
    def slcan(channel, **options):
        return can.Bus(interface="slcan", channel=channel, sleep_after_open=0, timeout=0.01, **options)

    def socketcand(self):
        return can.Bus(interface="socketcand", host="127.0.0.1", port=self.port("socketcand"), channel="can0")

    def raw(self, gateway):
        return socket.create_connection(("127.0.0.1", self.port(gateway)), timeout=PATIENCE_S)

    @contextlib.contextmanager
    def all_settled(self):
        """The three buses by name; each reaches the others."""
        with self.slcan_tcp() as tcp, self.slcan_pty() as pty, self.socketcand() as daemon:
            buses = {"slcan_tcp": tcp, "slcan_pty": pty, "socketcand": daemon}
            for sender in buses.values():
                settle(sender, *(bus for bus in buses.values() if bus is not sender))
            yield buses

    def stop(self):
        """Ends the program as Ctrl-C does; its summary, gateways by name."""
        summary = json.loads(super().stop().splitlines()[-1])
        summary["gateways"] = {line["gateway"]: line for line in summary["gateways"]}
        return summary


def receive(bus, count=1):
    """The next `count` frames, or as many as come."""
    messages, end = [], time.monotonic() + PATIENCE_S
    while len(messages) < count and time.monotonic() < end:
        message = bus.recv(timeout=0.2)
        if message is not None:
            messages.append(message)
    return messages


def content(messages):
    return [(m.arbitration_id, bytes(m.data), m.is_fd) for m in messages]


def lengths(messages):
    return [m.is_extended_id for m in messages]


def classic(identifier, data=b""):
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def fd(identifier, data):
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False, is_fd=True, bitrate_switch=True)


def extended(identifier, data=b"", **options):
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=True, **options)


def settle(bus, *others):
    """Opening is not confirmed to python-can: sends until `bus` reaches each of `others`, then until they are quiet."""
    for other in others:
        until("the buses receive from each other", lambda: bus.send(classic(0x7E0)) or other.recv(timeout=0.05), PATIENCE_S)
    for other in others:
        while other.recv(timeout=0.1) is not None:
            pass


def read_until(connection, ending):
    said = b""
    while not said.endswith(ending):
        more = connection.recv(4096)
        if not more:
            break
        said += more
    return said


def open_raw(line):
    """Opens the bus for a client of socketcand."""
    for said, answer in ((b"", b"< hi >"), (b"< open can0 >", b"< ok >"), (b"< rawmode >", b"< ok >")):
        line.sendall(said)
        assert (got := read_until(line, b">")) == answer, got


class FramesGoEverywhere(unittest.TestCase):
    def test_each_reaches_the_others_both_ways(self):
        with Program() as program:
            with program.all_settled() as buses:
                for number, (name, sender) in enumerate(buses.items()):
                    sent = [classic(0x100 + number, bytes(range(length))) for length in range(9)]
                    for message in sent:
                        sender.send(message)
                    for other, bus in buses.items():
                        if bus is not sender:
                            with self.subTest(sender=name, receiver=other):
                                self.assertEqual(content(receive(bus, 9)), content(sent))
                    self.assertIsNone(sender.recv(timeout=0.1), f"{name}: a sender does not receive its own frames")
            summary = program.stop()
            self.assertEqual(program.process.returncode, 0)
            self.assertGreater(summary["load"], 0.0)
            for name, line in summary["gateways"].items():
                self.assertEqual(line["rejects"], {}, name)
                self.assertEqual((line["dropped"], line["stalled"], line["refused"]), (0, 0, 0), name)
                self.assertGreaterEqual(line["from_clients"], 9, name)
            self.assertFalse(os.path.lexists(program.pty), "the link is gone")

    def test_identifiers_of_11_and_29_bits_are_not_confused(self):
        with Program() as program:
            with program.all_settled() as buses:
                sent = [classic(0x123, b"11"), extended(0x123, b"29"), extended(0x18FF1234, b"j"), extended(0x1FFFFFFF)]
                for name, sender in buses.items():
                    for message in sent:
                        sender.send(message)
                    for other, bus in buses.items():
                        if bus is not sender:
                            with self.subTest(sender=name, receiver=other):
                                got = receive(bus, len(sent))
                                self.assertEqual(content(got), content(sent))
                                self.assertEqual(lengths(got), [False, True, True, True])
                long = extended(0x18FF0301, bytes(48), is_fd=True, bitrate_switch=True)
                buses["slcan_tcp"].send(long)
                got = receive(buses["slcan_pty"])
                self.assertEqual((content(got), lengths(got)), (content([long]), [True]))
            for line in program.stop()["gateways"].values():
                self.assertEqual(line["rejects"], {})

    def overtaking(self, waiting, urgent):
        """Returns what a listener receives when one frame is sent after ten that wait for the wire."""
        # 10 kbit/s: a frame takes 10 ms, so that what is queued behind the first is queued in time.
        with Program("--wire", "can_classic", "--bit-rate", "10000") as program:
            with program.socketcand() as low, program.slcan_pty() as high, program.slcan_tcp() as listener:
                settle(high, listener, low)
                settle(low, listener, high)
                for _ in range(10):
                    high.send(waiting)
                time.sleep(0.02)
                low.send(urgent)
                return receive(listener, 11)

    def test_of_the_same_first_11_bits_the_shorter_identifier_goes_first(self):
        order = lengths(self.overtaking(extended(0x123 << 18, b"12345678"), classic(0x123)))
        self.assertEqual(order.count(False), 1)
        self.assertLess(order.index(False), 10, "not the last, although sent last")

    def test_fd_of_every_length_passes_slcan_and_is_withheld_from_socketcand(self):
        with Program() as program:
            with program.slcan_tcp() as tcp, program.slcan_pty() as pty, program.socketcand() as daemon:
                settle(tcp, pty, daemon)
                settle(pty, tcp, daemon)
                sent = [fd(0x300, os.urandom(length)) for length in (0, 1, 8, 12, 16, 20, 24, 32, 48, 64)]
                for sender, receiver in ((tcp, pty), (pty, tcp)):
                    for message in sent:
                        sender.send(message)
                    got = receive(receiver, len(sent))
                    self.assertEqual(content(got), content(sent))
                    self.assertTrue(all(m.bitrate_switch for m in got))
                self.assertIsNone(daemon.recv(timeout=0.1))
            self.assertEqual(program.stop()["gateways"]["socketcand"]["withheld"], 2 * len(sent))

    def test_fd_is_refused_on_a_classic_wire(self):
        with Program("--wire", "can_classic") as program:
            with program.slcan_tcp() as tcp, program.slcan_pty() as pty:
                settle(tcp, pty)
                tcp.send(fd(0x300, b"12345678"))
                tcp.send(classic(0x301, b"after"))
                self.assertEqual(content(receive(pty)), [(0x301, b"after", False)])
            self.assertEqual(program.stop()["gateways"]["slcan_tcp"]["rejects"], {"fd_on_classic_bus": 1})

    def test_the_lowest_identifier_overtakes_what_waits(self):
        order = [message.arbitration_id for message in self.overtaking(classic(0x700, b"12345678"), classic(0x001))]
        self.assertEqual(sorted(order), [0x001] + [0x700] * 10)
        self.assertLess(order.index(0x001), 10, "not the last, although sent last")

    def test_time_stamps_of_socketcand_are_now(self):
        with Program() as program:
            with program.slcan_tcp() as tcp, program.socketcand() as daemon:
                settle(tcp, daemon)
                before = time.time()
                tcp.send(classic(0x42, b"t"))
                stamp = receive(daemon)[0].timestamp
                self.assertTrue(before - 1e-3 < stamp < time.time() + 1e-3, f"{stamp - before} s after it was sent")


class Answers(unittest.TestCase):
    def test_slcan_answers_as_an_adapter_does(self):
        with Program("--data-bit-rate", "5000000") as program, program.raw("slcan_tcp") as line:
            for said, answer in (
                (b"C\r", b"\r"),
                (b"V\r", b"V1013\r"),
                (b"v\r", b"v0100\r"),
                (b"N\r", b"NSTAR\r"),
                (b"t1230\r", b"\x07"),  # not open
                (b"F\r", b"\x07"),
                (b"S6\r", b"\r"),
                (b"S8\r", b"\x07"),  # the bus has 500 kbit/s
                (b"Y5\r", b"\r"),
                (b"Y2\r", b"\x07"),
                (b"M00000000\r", b"\r"),
                (b"mFFFFFFFF\r", b"\r"),
                (b"m00000000\r", b"\x07"),
                (b"Z1\r", b"\r"),
                (b"L\r", b"\r"),
                (b"t1230\r", b"\x07"),  # listens only
                (b"C\r", b"\r"),
                (b"O\r", b"\r"),
                (b"S6\r", b"\x07"),  # open
                (b"F\r", b"F00\r"),
                (b"t1230\r", b"\r"),
                (b"b1239" + b"00" * 12 + b"\r", b"\r"),
                (b"T123456780\r", b"\r"),
                (b"T200000000\r", b"\x07"),  # more than 29 bits
                (b"r1230\r", b"\x07"),
                (b"Q\r", b"\x07"),
            ):
                line.sendall(said)
                self.assertEqual(line.recv(64), answer, said)
            rejects = program.stop()["gateways"]["slcan_tcp"]["rejects"]
            wanted = {"not_open": 2, "other_bit_rate": 2, "filter": 1, "listen_only": 1, "open": 1}
            self.assertEqual(rejects, {**wanted, "bad_value": 1, "remote_request": 1, "unknown_command": 1})

    def test_python_can_reads_version_and_serial_number(self):
        with Program() as program, program.slcan_tcp(bitrate=500000) as tcp:
            self.assertEqual(tcp.get_version(PATIENCE_S), (10, 13))
            self.assertEqual(tcp.get_serial_number(PATIENCE_S), "STAR")

    def test_time_stamps_of_slcan(self):
        with Program() as program, program.raw("slcan_tcp") as line, program.socketcand() as daemon:
            for said in (b"Z1\r", b"O\r"):
                line.sendall(said)
                self.assertEqual(line.recv(64), b"\r")
            daemon.send(classic(0x55, b"\xab"))
            frame = read_until(line, b"\r")
            self.assertTrue(frame.startswith(b"t0551AB") and len(frame) == 12, frame)
            self.assertLess(int(frame[7:11], 16), 60000)

    def test_socketcand_refuses_other_modes_and_goes_on(self):
        with Program() as program, program.raw("socketcand") as line:
            for said, answer in (
                (b"", b"< hi >"),
                (b"< echo >", b"< echo >"),
                (b"< rawmode >", b"< error not_open >"),
                (b"< open can7 >", b"< error unknown_bus >"),
                (b"< open can0 >", b"< ok >"),
                (b"< send 123 0 >", b"< error not_in_raw_mode >"),
                (b"< bcmmode >", b"< error other_mode >"),
                (b"< statistics 100 >", b"< error other_mode >"),
                (b"< rawmode >", b"< ok >"),
                (b"< send 12345678 0 >< echo >", b"< echo >"),
                (b"< send 20000000 0 >", b"< error bad_value >"),
                (b"< send 123 9 1 2 3 4 5 6 7 8 9 >", b"< error bad_value >"),
                (b"< send 123 2 1 >", b"< error bad_length >"),
                (b"< send 123 0 >< echo >", b"< echo >"),
            ):
                line.sendall(said)
                self.assertEqual(read_until(line, b">"), answer, said)
            wanted = {"not_open": 1, "unknown_bus": 1, "not_in_raw_mode": 1, "other_mode": 2}
            wanted |= {"bad_value": 2, "bad_length": 1}
            self.assertEqual(program.stop()["gateways"]["socketcand"]["rejects"], wanted)


class BadClients(unittest.TestCase):
    def test_a_second_client_of_a_line_is_refused_and_the_first_goes_on(self):
        with Program() as program, program.slcan_tcp() as first, program.socketcand() as daemon:
            settle(daemon, first)
            with program.raw("slcan_tcp") as second:
                second.sendall(b"C\rS6\rO\r")
                self.assertEqual(read_until(second, b"never"), b"\x07in use: one client at a time\r")
            daemon.send(classic(0x11, b"still"))
            self.assertEqual(content(receive(first)), [(0x11, b"still", False)])
            line = program.stop()["gateways"]["slcan_tcp"]
            self.assertEqual((line["clients"], line["refused"]), (1, 1))

    def test_a_line_is_free_again_when_its_client_has_left(self):
        with Program() as program:
            for _ in range(3):
                answer, end = b"", time.monotonic() + PATIENCE_S
                while not answer.startswith(b"V") and time.monotonic() < end:
                    with program.raw("slcan_tcp") as line:
                        line.sendall(b"V\r")
                        answer = line.recv(64)
                self.assertEqual(answer, b"V1013\r")
            self.assertEqual(program.stop()["gateways"]["slcan_tcp"]["clients"], 3)

    def test_a_fifth_client_of_socketcand_is_refused(self):
        with Program() as program:
            four = [program.socketcand() for _ in range(4)]
            with program.raw("socketcand") as fifth:
                self.assertEqual(read_until(fifth, b"never"), b"< error too many clients >")
            settle(four[0], *four[1:])
            four[0].send(classic(0x22, b"x"))
            for bus in four[1:]:
                self.assertEqual(content(receive(bus)), [(0x22, b"x", False)])
            for bus in four:
                bus.shutdown()
            self.assertEqual(program.stop()["gateways"]["socketcand"]["refused"], 1)

    def test_oversized_lines_and_garbage_are_counted_and_skipped(self):
        with Program() as program, program.socketcand() as listener:
            with program.raw("slcan_tcp") as line:
                line.sendall(b"O\r" + b"t" + b"1" * 100_000 + b"\r" + bytes(range(14, 256)) + b"\r" + b"t0321FF\r")
                self.assertEqual(content(receive(listener)), [(0x032, b"\xff", False)])
            with program.raw("socketcand") as line:
                open_raw(line)
                noise = bytes(byte for byte in range(128, 256))
                line.sendall(noise + b"< " + b"x" * 100_000 + b">" + b"< send 33 1 fe >")
                self.assertEqual(content(receive(listener)), [(0x033, b"\xfe", False)])
            gateways = program.stop()["gateways"]
            self.assertEqual(gateways["slcan_tcp"]["rejects"], {"too_long": 2})
            self.assertEqual(gateways["socketcand"]["rejects"], {"garbage": 1, "too_long": 1})

    def test_random_bytes_end_nothing(self):
        with Program() as program, program.socketcand() as daemon:
            pty = program.slcan_pty()
            for gateway in ("slcan_tcp", "socketcand"):
                for _ in range(50):
                    self.send_until_closed(program, gateway, os.urandom(4000))
            settle(pty, daemon)
            pty.shutdown()
            gateways = program.stop()["gateways"]
            self.assertGreater(sum(gateways["slcan_tcp"]["rejects"].values()), 100)
            self.assertGreater(sum(gateways["socketcand"]["rejects"].values()), 100)

    @staticmethod
    def send_until_closed(program, gateway, data):
        """Sends, and reads until the connection ends; a reset is an end."""
        with program.raw(gateway) as line:
            try:
                line.sendall(data)
                line.shutdown(socket.SHUT_WR)
                while line.recv(65536):
                    pass
            except (ConnectionResetError, BrokenPipeError):
                pass
            except OSError as error:
                if error.errno != errno.ENOTCONN:
                    raise

    def test_a_request_of_a_web_page_is_not_obeyed_and_counted(self):
        head = b"POST / HTTP/1.1\r\nHost: 127.0.0.1:1\r\nContent-Type: text/plain\r\nContent-Length: 50\r\n\r\n"
        bodies = {"slcan_tcp": b"C\rO\rt1231AB\r", "socketcand": b"< open can0 >< rawmode >< send 123 1 ab >"}
        with Program() as program:
            with program.slcan_pty() as pty, program.socketcand() as daemon:
                settle(pty, daemon)
                settle(daemon, pty)
                for gateway, body in bodies.items():
                    self.send_until_closed(program, gateway, head + body)
                    self.assertIsNone(pty.recv(timeout=0.2), gateway)
                    self.send_until_closed(program, gateway, body)
                    self.assertEqual(content(receive(pty)), [(0x123, b"\xab", False)], "control: without its head it is")
            gateways = program.stop()["gateways"]
            for gateway in bodies:
                self.assertEqual(gateways[gateway]["rejects"].get("http_request"), 1, gateway)

    def test_a_client_reconnects_at_once(self):
        with Program() as program:
            for _ in range(20):
                with program.raw("slcan_tcp") as line:
                    line.sendall(b"O\rV\r")
                    self.assertEqual(read_until(line, b"3\r"), b"\rV1013\r")
            line = program.stop()["gateways"]["slcan_tcp"]
            self.assertEqual((line["clients"], line["refused"], line["rejects"]), (20, 0, {}))

    def test_an_idle_connection_gives_its_seat_to_the_next(self):
        with Program() as program, program.raw("slcan_tcp") as idle, program.raw("slcan_tcp") as line:
            line.sendall(b"O\r")
            self.assertEqual(line.recv(64), b"\r")
            self.assertEqual(idle.recv(64), b"", "hung up on")
            self.assertEqual(program.stop()["gateways"]["slcan_tcp"]["rejects"], {"gave_way": 1})

    def test_a_client_that_never_reads_loses_frames_and_then_its_connection(self):
        count = 100_000
        # 10 Mbit/s: 13.5 us each, 1.35 s of traffic if the sender kept up.
        with Program("--wire", "can_classic", "--bit-rate", "10000000") as program:
            with program.raw("slcan_tcp") as deaf, program.raw("socketcand") as sender, program.socketcand() as healthy:
                deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                deaf.sendall(b"O\r")
                self.assertEqual(deaf.recv(1), b"\r")
                open_raw(sender)
                self.assertEqual(self.count_frames(healthy, sender, count), count)
            line = program.stop()["gateways"]
            self.assertEqual(line["socketcand"]["from_clients"], count)
            self.assertEqual(line["socketcand"]["to_clients"] + line["socketcand"]["dropped"], count)
            self.assertEqual(line["slcan_tcp"]["stalled"], 1)
            self.assertGreater(line["slcan_tcp"]["dropped"], 0)

    def count_frames(self, healthy, sender, count):
        """Sends frames by the thousand, each thousand when the one before has been received."""
        got = 0
        reader = healthy._SocketCanDaemonBus__socket  # python-can's own parsing takes a minute for so many
        rest = b""
        for _ in range(count // 1000):
            sender.sendall(b"< send 123 8 1 2 3 4 5 6 7 8 >" * 1000)
            wanted, end = got + 1000, time.monotonic() + PATIENCE_S
            while got < wanted and time.monotonic() < end:
                if select.select([reader], [], [], 0.2)[0]:
                    rest += reader.recv(65536)
                    got += rest.count(b">")
                    rest = rest[rest.rfind(b">") + 1 :]
        # The deaf one is hung up on two seconds after it could have read.
        time.sleep(3.0)
        return got

    def test_a_terminal_that_no_one_reads_is_closed_and_opens_again(self):
        with Program("--wire", "can_classic", "--bit-rate", "10000000") as program:
            line = os.open(program.pty, os.O_RDWR | os.O_NOCTTY)
            os.write(line, b"O\r")
            with program.raw("socketcand") as sender:
                open_raw(sender)
                sender.sendall(b"< send 123 8 1 2 3 4 5 6 7 8 >" * 1000)
                self.assertTrue(select.select([line], [], [], PATIENCE_S)[0])
                until("without a reader the contents of the line are discarded", lambda: not select.select([line], [], [], 0)[0], PATIENCE_S)
                os.write(line, b"O\r")
                self.assertEqual(os.read(line, 1), b"\r", "what was stale is gone")
                sender.sendall(b"< send 456 0 >")
                self.assertEqual(os.read(line, 6), b"t4560\r")
            os.close(line)
            self.assertEqual(program.stop()["gateways"]["slcan_pty"]["stalled"], 1)


class CommandLine(unittest.TestCase):
    def refused(self, *options):
        return starloop("bus", *options, status=(1, 2), timeout=PATIENCE_S).stderr

    def test_unsupported_requests_are_reported(self):
        self.assertIn("--slcan-tcp", self.refused())
        self.assertIn("ADDRESS:PORT", self.refused("--slcan-tcp", "here"))
        self.assertIn("can_fd", self.refused("--slcan-tcp", "0", "--wire", "can_classic", "--data-bit-rate", "1000000"))
        self.assertIn("no less", self.refused("--slcan-tcp", "0", "--data-bit-rate", "100000"))
        with tempfile.NamedTemporaryFile() as there:
            self.assertIn("nothing at it", self.refused("--slcan-pty", there.name))
            self.assertEqual(os.path.getsize(there.name), 0, "and it is still there")
        with socket.create_server(("127.0.0.1", 0)) as taken:
            self.assertIn("another program", self.refused("--socketcand", str(taken.getsockname()[1])))

    def test_it_ends_by_itself_after_its_duration(self):
        done = starloop("bus", "--slcan-tcp", "0", "--duration", "0.2", timeout=PATIENCE_S)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("slcan (TCP)", done.stdout)
        self.assertIn("0 frames, load 0.0 %", done.stdout)

    def test_an_address_that_is_not_loopback_is_warned_about(self):
        done = starloop("bus", "--slcan-tcp", "0.0.0.0:0", "--duration", "0.2", status=0, timeout=PATIENCE_S)
        self.assertIn("no password", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
