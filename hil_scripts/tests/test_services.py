"""Tests that a web page can do nothing to a run: python3 hil_scripts/tests/test_services.py

A real browser sends cross-origin POST requests, with bodies that the ports would obey, to the slcan, socketcand and
control ports, while a flight computer flies over one of them. STARLOOP_CHROMIUM names the browser (default chromium).
Needs python-can and cantools (requirements_flight_computer.txt).
"""

import http.server
import json
import math
import re
import socket
import threading
import time
import unittest

from support import BINARY, PATIENCE_S, ROOT, InAFolder, Running
from starloop import flight_computer
from starloop.client import Starloop
from starloop.wire import CanTransport, Codec
import test_flight as flights
from test_live import CHROMIUM, Browser

# Both the page and the ports are on loopback; newer browsers may ask the user all the same, and then nothing would be sent.
BROWSER_OPTIONS = ("--disable-features=LocalNetworkAccessChecks,BlockInsecurePrivateNetworkRequests",)
# A flight at rest: what is echoed is the attitude that was sent.
LIMIT_ARCSEC = 1.0
LEAST_FRAMES = 10
# Longer than so many frames take on a busy machine.
WAIT_S = 20.0
STOP = {"Opcode": 4, "Token": 77}


class Page(http.server.BaseHTTPRequestHandler):
    """An empty page on a port, and so an origin, of its own."""

    def do_GET(self):
        body = b"<!DOCTYPE html><title>page</title>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


class Recorder:
    """A port that answers anything, and keeps what was sent to it."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.received = []
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.record, args=(connection,), daemon=True).start()

    def record(self, connection):
        with connection:
            connection.settimeout(1.0)
            said = b""
            try:
                while part := connection.recv(65536):
                    said += part
            except OSError:
                pass
            self.received.append(said)
            connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")

    def close(self):
        self.listener.close()


class Visitor:
    """A browser that shows a page of another origin."""

    def __init__(self):
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.browser = Browser((800, 600), *BROWSER_OPTIONS)
        self.browser.open(f"http://127.0.0.1:{self.server.server_address[1]}/")

    def post(self, port, body):
        """Sends the body to a port as a page may: no leave is asked for text. What came of it, which says nothing."""
        asks = f"""fetch("http://127.0.0.1:{port}/", {{ method: "POST", mode: "no-cors",
            headers: {{ "Content-Type": "text/plain" }}, body: {json.dumps(body)}, signal: AbortSignal.timeout(20000) }})
            .then(() => "answered", (error) => "failed: " + error)"""
        return self.browser.value(asks)

    def close(self):
        self.browser.close()
        self.server.shutdown()
        self.server.server_close()


def port_of(stimulator, gateway):
    return int(stimulator.gateways[gateway].rsplit(":", 1)[1])


def bodies():
    """Text that opens the bus and stops the session, by gateway."""
    codec = Codec()
    identifier, data = codec.identifier("CMD"), codec.payload("CMD", STOP)
    slcan = f"C\rO\rt{identifier:03X}{len(data)}{data.hex().upper()}\r"
    numbers = " ".join(f"{byte:x}" for byte in data)
    socketcand = f"< open can0 >< rawmode >< send {identifier:x} {len(data)} {numbers} >"
    return {"slcan (TCP)": slcan, "socketcand": socketcand}


class Flight:
    """A flight computer at rest over socketcand, in a thread of its own."""

    def __init__(self, stimulator):
        transport = CanTransport("socketcand", "can0", False, host="127.0.0.1", port=port_of(stimulator, "socketcand"))
        initial = flight_computer.pointed(*map(math.radians, (83.8, -5.4, 20.0)))
        slew = flight_computer.Slew(initial, (0.3, 1.0, 0.2), 0.0, math.inf, 1.0)
        self.transport, self.computer = transport, flight_computer.FlightComputer(transport, slew, 50.0)
        # At rest a predicted attitude is the same: none is too old to be compared.
        self.computer.oldest_us = 10_000_000
        self.computer.shake_hands()
        self.over, self.compared = threading.Event(), 0
        self.thread = threading.Thread(target=self.fly)
        self.thread.start()

    def fly(self):
        while not self.over.is_set():
            self.computer.fly(self.computer.now_s() + 0.1)
            self.compared = len(self.computer.errors_arcsec())

    def wait_for_frames(self, count):
        """Flies on until so many more frames have shown an attitude, or none comes any more; whether they have."""
        wanted, until = self.compared + count, time.monotonic() + WAIT_S
        while self.compared < wanted and time.monotonic() < until:
            time.sleep(0.05)
        return self.compared >= wanted

    def end(self):
        self.over.set()
        self.thread.join()
        self.transport.close()


class Gateways(unittest.TestCase):
    def flown(self, disturb):
        """The errors of a flight that was disturbed in its middle, arcsec; whether its attitudes were drawn afterwards; the
        run's summary."""
        # Whether frames are in time is not what is examined.
        with flights.Gateways("timing.frame_rate_hz=4", "timing.deadline_policy=late") as stimulator:
            flight = Flight(stimulator)
            try:
                self.assertTrue(flight.wait_for_frames(LEAST_FRAMES), "it flies")
                disturb(stimulator)
                goes_on = flight.wait_for_frames(LEAST_FRAMES)
            finally:
                flight.end()
            text = stimulator.stop()
        errors = [off for _, off in flight.computer.errors_arcsec()]
        return errors, goes_on, text

    @unittest.skipUnless(CHROMIUM, "no chromium: wanted the package of that name, or STARLOOP_CHROMIUM")
    def test_a_page_of_another_origin_changes_nothing_and_is_counted(self):
        visitor, recorder = Visitor(), Recorder()
        self.addCleanup(visitor.close)
        self.addCleanup(recorder.close)

        def disturb(stimulator):
            for gateway, body in bodies().items():
                visitor.post(recorder.port, body)
                visitor.post(port_of(stimulator, gateway), body)

        errors, goes_on, text = self.flown(disturb)
        for body in bodies().values():
            sent = [said for said in recorder.received if said.startswith(b"POST / HTTP/1.1\r\n") and said.endswith(body.encode())]
            self.assertTrue(sent, f"control: the browser sends the body: {recorder.received}")
            self.assertIn(b"\r\nOrigin: http://127.0.0.1:", sent[0], "from another origin")
        self.assertTrue(goes_on, "the session runs on")
        self.assertLess(max(errors), LIMIT_ARCSEC)
        self.assertRegex(text, r"session_run 1\b")
        self.assertNotIn("session_halt", text)
        self.assertEqual(len(re.findall(r"refused [1-9]\d* times: http request", text)), 2, "counted by both gateways")

    def test_the_same_body_without_the_head_of_a_request_is_obeyed(self):
        for gateway, body in bodies().items():
            with self.subTest(gateway):

                def disturb(stimulator):
                    with socket.create_connection(("127.0.0.1", port_of(stimulator, gateway)), PATIENCE_S) as line:
                        line.sendall(body.encode())
                        line.shutdown(socket.SHUT_WR)
                        while line.recv(65536):
                            pass

                _, goes_on, text = self.flown(disturb)
                self.assertRegex(text, r"session_halt 1\b")
                self.assertFalse(goes_on, "dark from then on")
                self.assertNotIn("times: ", text, "nothing was refused")


class Control(InAFolder):
    def setUp(self):
        super().setUp()
        scenario = ROOT / "configs/scenarios/acquisition.toml"
        settings = ["--set", "duration_s=3.0", "--set", "bench.camera=../cameras/small_tracker.toml", "--set", "expect.window_s=1.0"]
        command = [BINARY, "run", scenario, "--clock", "virtual", "--quiet", "--control", "127.0.0.1:0", "--out", self.out, *settings]
        program = self.enterContext(Running(*command))
        self.port = int(program.wait_for(r"^control: listening on .*:(\d+)")[1])
        self.token = program.wait_for("^control: token ([0-9a-f]{32}), ")[1]
        self.victim = self.written("victim.txt", "precious")

    def body(self):
        requests = [{"request": "step", "frames": 1}]
        requests += [{"request": "frame", "path": str(path)} for path in (self.victim, "page.fits")]
        return "".join(json.dumps(request) + "\n" for request in requests)

    @unittest.skipUnless(CHROMIUM, "no chromium: wanted the package of that name, or STARLOOP_CHROMIUM")
    def test_a_page_of_another_origin_changes_nothing_and_is_counted(self):
        visitor = Visitor()
        self.addCleanup(visitor.close)
        visitor.post(self.port, self.body())
        # Not even one that has guessed the token: it cannot come first.
        visitor.post(self.port, json.dumps({"request": "hello", "token": self.token}) + "\n" + self.body())
        with Starloop.connect("127.0.0.1", self.port) as loop:
            self.assertEqual(loop.hello["now_s"], -1.0, "without a step: a run starts a second before its first exposure")
            report = loop.finish()
        self.assertEqual(self.victim.read_text(), "precious")
        self.assertFalse((self.out / "page.fits").exists())
        self.assertGreaterEqual(report["control_refusals"]["http_request"], 2)

    def test_the_same_body_behind_the_token_is_obeyed_below_the_output_folder(self):
        hello = json.dumps({"request": "hello", "token": self.token}) + "\n"
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE_S) as line, line.makefile("rb") as replies:
            line.sendall((hello + self.body()).encode())
            answers = [json.loads(replies.readline()) for _ in range(4)]
        self.assertEqual([answer["ok"] for answer in answers], [True, True, False, True], answers)
        self.assertEqual(self.victim.read_text(), "precious")
        self.assertTrue((self.out / "page.fits").exists())


if __name__ == "__main__":
    unittest.main(verbosity=2)
