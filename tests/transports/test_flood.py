"""Clients that write without pause: each look at a port is short, and what is not read holds the client up.

With a real emulator and client (``tactemu run`` and a process each) on an idle machine: ``pytest -m idle``.
"""

import contextlib
import json
import os
import random
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import serial
import websocket

from tactemu.transports import create
from tactemu.transports.transport import MAX_CHUNK_BYTES, Closed, Opened, Received

ROOT = Path(__file__).parents[2]
PREAMBLE = """
import random, socket, sys
port = sys.argv[1]
noise = random.Random(1).randbytes(65_536)
"""
SERIAL = """
import serial
driver = serial.serial_for_url(port, baudrate=115_200, timeout=0)
print(flush=True)
while True:
    driver.write({data})
    driver.read(65_536)
"""
SOCKET = """
from urllib.parse import urlsplit
url = urlsplit(port)
client = socket.create_connection((url.hostname, url.port))
print(flush=True)
while True:
    client.sendall({data})
"""
UDP = """
from urllib.parse import urlsplit
url = urlsplit(port)
client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
client.connect((url.hostname, url.port))
print(flush=True)
while True:
    client.send({data})
"""
CAN = """
import can
interface, _, channel = port.partition(":")
bus = can.Bus(interface=interface, channel=channel)
request = can.Message(arbitration_id={ident}, data=[0xB1, 0xC6], is_extended_id=False)
print(flush=True)
while True:
    bus.send(request)
"""
REGISTERS = 'bytes.fromhex("0001 0000 0006 01 03 0BB8 0010") * 4000'
CASES = {
    "usb": ("anyskin", "pty:{tmp}/tty", SERIAL.format(data="noise")),
    "uart at another speed": ("flexitac", "pty:{tmp}/tty", SERIAL.format(data="noise")),
    "tcp": ("anyskin", "tcp:0", SOCKET.format(data="noise")),
    "registers asked for over tcp, answers not read": (
        "inspire_rh56dftp",
        "tcp:0",
        SOCKET.format(data=REGISTERS),
    ),
    "datagrams": ("ati_net_ft", "udp:0", UDP.format(data='bytes.fromhex("1234 0002 00000000")')),
    "long datagrams": ("ati_net_ft", "udp:0", UDP.format(data="noise[:60_000]")),
    "rfc2217, plain data": ("anyskin", "rfc2217:0", SOCKET.format(data='noise.replace(b"\\xff", b"")')),
    "rfc2217, telnet only": ("anyskin", "rfc2217:0", SOCKET.format(data='b"\\xff\\xfd\\x2c" * 20_000')),
    "rfc2217, an option without end": ("anyskin", "rfc2217:0", SOCKET.format(data='b"\\xff\\xfa" + b"a" * 65_536')),
    "can, requests": ("linker_hand_l6", "can:udp_multicast:239.74.163.77", CAN.format(ident=0x28)),
    "can, of no concern": ("linker_hand_l6", "can:udp_multicast:239.74.163.78", CAN.format(ident=0x700)),
}


def drain(port, client_done):
    """Return all that is taken, poll by poll, while the client goes on, until nothing has come for a while."""
    looks, idle = [], 0
    while idle < 50 or not client_done.is_set():
        data = b"".join(event.data for event in port.poll() if isinstance(event, Received))
        looks += [data] if data else []
        idle = 0 if data else idle + 1
        if not data:
            time.sleep(0.002)
    return looks


@pytest.mark.parametrize("address", ["pty:", "tcp:0", "rfc2217:0"])
def test_a_look_takes_a_chunk_and_nothing_is_lost(address):
    sent = random.Random(3).randbytes(50_000).replace(b"\xff", b"\xff\xff")
    with create(address) as port, client_of(port) as write:
        done = threading.Event()
        thread = threading.Thread(target=lambda: (write(sent), done.set()))
        thread.start()
        looks = drain(port, done)
        thread.join()
    assert max(map(len, looks)) <= MAX_CHUNK_BYTES
    assert b"".join(looks) == (sent.replace(b"\xff\xff", b"\xff") if address.startswith("rfc") else sent)


@pytest.mark.parametrize("address", ["pty:", "tcp:0", "rfc2217:0"])
def test_what_is_not_read_holds_the_client_up_and_wakes_nobody(address):
    with create(address) as port, client_of(port) as write:
        done = threading.Event()

        def flood():
            with contextlib.suppress(OSError):  # until the port goes
                write(b"a" * 20_000_000)
            done.set()

        thread = threading.Thread(target=flood, daemon=True)
        thread.start()
        assert not done.wait(0.5)
        while port.poll(reading=False):
            pass
        assert not select.select(port.filenos(reading=False), [], [], 0)[0]
        assert select.select(port.filenos(), [], [], 1)[0]
        assert not any(isinstance(event, Received) for _ in range(50) for event in port.poll(reading=False))
        port.close()
        thread.join(5)


@pytest.mark.parametrize("address", ["pty:", "tcp:0", "rfc2217:0"])
def test_a_client_that_goes_leaves_its_last_bytes_and_nobody_waits(address):
    with create(address) as port:
        for reading in (True, False):
            with client_of(port) as write:
                write(b"a" * 5000)
            events = []
            end = time.monotonic() + 5
            while Closed() not in events and time.monotonic() < end:
                events += port.poll(reading)
            assert b"".join(event.data for event in events if isinstance(event, Received)) == b"a" * 5000
            assert Closed() in events and not port.has_reader
            port.poll()


def test_a_client_that_asks_and_does_not_read_fills_no_memory():
    with create("rfc2217:0") as port, client_of(port) as write:
        write(b"\xff\xfd\x63" * 5000)
        for _ in range(2000):
            port.poll()
        assert len(port._unsent) < 70_000
        write(b"\xff\xfa" + b"a" * 10_000)
        for _ in range(100):
            port.poll()
        assert len(port._protocol.suboption or b"") <= 64


class pumped:
    """A WebSocket client, of the judge's library, at a port that looks often."""

    def __init__(self, port):
        self.port, self.events, self.done = port, [], threading.Event()
        self.thread = threading.Thread(target=self._look)

    def _look(self):
        while not self.done.is_set():
            self.events += self.port.poll()
            time.sleep(0.001)

    def heard(self):
        time.sleep(0.1)
        return [event.data for event in self.events if isinstance(event, Received)]

    def __enter__(self):
        self.thread.start()
        self.client = websocket.create_connection(self.port.address, timeout=2)
        return self

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()
        self.client.shutdown()


def test_messages_in_fragments_of_a_client_are_put_together_and_long_ones_refused():
    with create("ws:0") as port, pumped(port) as end:
        for data, opcode, fin in (("a", 1, 0), ("b", 0, 0), ("c", 0, 1)):
            end.client.send_frame(websocket.ABNF.create_frame(data, opcode, fin))
        end.client.send_binary(b"\x00")
        end.client.ping("x")
        assert end.heard() == [b"abc", b"\x00"]
        assert end.client.recv_data(control_frame=True) == (websocket.ABNF.OPCODE_PONG, b"x")
        for k in range(9):
            end.client.send_frame(websocket.ABNF.create_frame("a" * 2000, 0 if k else 1, 0))
        last = end.client.recv_frame()
        assert (last.opcode, last.data[:2]) == (websocket.ABNF.OPCODE_CLOSE, (1009).to_bytes(2, "big")), "too big"


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", b"HTTP/1.1 426 "),
        (b"\x00\xff\r\n\r\n", b""),
        (b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 10_000, b"HTTP/1.1 431 "),
        (b"a" * 100_000, b""),
    ],
)
def test_who_shakes_no_hands_is_dropped_and_the_next_is_served(sent, answer):
    with create("ws:0") as port:
        with socket.create_connection(("127.0.0.1", port.port), timeout=2) as client, contextlib.suppress(OSError):
            seen = threading.Thread(target=lambda: [(port.poll(), time.sleep(0.001)) for _ in range(300)])
            seen.start()
            client.sendall(sent)
            assert client.recv(100).startswith(answer)
        seen.join()
        assert not port.has_reader and not port.write(b"frame")
        with pumped(port):
            assert port.has_reader


def test_pings_without_end_fill_no_memory():
    with create("ws:0") as port, pumped(port) as end:
        ping = websocket.ABNF.create_frame(b"p" * 100, websocket.ABNF.OPCODE_PING).format()
        end.client.sock.settimeout(0.5)
        with contextlib.suppress(OSError):
            for _ in range(20_000):
                end.client.sock.sendall(ping)
        assert len(port._unsent) < 70_000 and len(port._protocol.reader.buffer) < 70_000


@pytest.mark.parametrize(("size", "most"), [(0, 32), (8, 32), (100, 6), (60_000, 1)])
def test_a_look_takes_few_datagrams_and_the_kernel_keeps_few(size, most):
    with create("udp:0") as port, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect(("127.0.0.1", port.port))
        for _ in range(2000):
            client.send(bytes(size))
        looks = []
        while select.select(port.filenos(), [], [], 0)[0]:
            looks.append([event.data for event in port.poll() if isinstance(event, Received)])
        assert all(len(look) <= most for look in looks) and len(looks) <= 2000
        assert {len(data) for look in looks for data in look} <= {size}
        assert sum(len(data) for look in looks for data in look) < 200_000, "the rest is lost, as in any full queue"


def test_datagrams_of_two_peers_are_looked_at_in_turn_so_that_each_gets_its_answers():
    with contextlib.ExitStack() as stack:
        port = stack.enter_context(create("udp:0"))
        clients = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in "ab"]
        for client in clients:
            client.settimeout(2)
            client.connect(("127.0.0.1", port.port))
        for k in range(6):
            clients[k // 2 % 2].send(b"%d" % k)
        for pair in (b"01", b"23", b"45"):
            heard = [event.data for event in port.poll() if isinstance(event, Received)]
            assert b"".join(heard) == pair
            assert port.write(pair)
        assert [clients[k].recv(9) for k in (0, 0, 1)] == [b"01", b"45", b"23"]


class client_of:
    """A client of a port that only writes, and blocks while it must."""

    def __init__(self, port):
        self.port = port

    def __enter__(self):
        if url := urlsplit(self.port.address).port:
            self.client = socket.create_connection(("127.0.0.1", url))
            write = self.client.sendall
        else:
            self.fileno = os.open(self.port.address, os.O_RDWR | os.O_NOCTTY)
            write = self._write
        while Opened() not in self.port.poll(reading=False):
            time.sleep(0.001)
        return write

    def _write(self, data):
        while data:
            data = data[os.write(self.fileno, data) :]

    def __exit__(self, *_):
        if urlsplit(self.port.address).port:
            self.client.close()
        else:
            os.close(self.fileno)


class Run:
    """``tactemu run`` with its reports."""

    def __init__(self, device, port):
        command = [sys.executable, "-m", "tactemu", "run", device, "--port", port, "--json", "--rate", "100"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT)
        self.port = self.report("ready")["port"]

    def report(self, event="running"):
        assert self.process.stdout
        for line in self.process.stdout:
            if (entry := json.loads(line))["event"] == event:
                return entry
        raise AssertionError("the run has ended")

    def memory(self):
        """Resident memory [byte]."""
        pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


class Flood:
    def __init__(self, code, port):
        command = [sys.executable, "-c", PREAMBLE + code, port]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT)
        assert self.process.stdout and self.process.stdout.readline()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


CARRIERS = ("pty", "tcp", "udp", "rfc2217", "can")


@pytest.mark.idle("it compares the samples of a second with the device's rate, beside a flood that takes a core")
@pytest.mark.parametrize("carrier", CARRIERS)
def test_a_flood_takes_neither_memory_nor_samples_nor_signals(carrier, tmp_path):
    for device, port, code in (case for case in CASES.values() if case[1].partition(":")[0] == carrier):
        withstands(device, port.format(tmp=tmp_path), code)


def withstands(device, port, code):
    with Run(device, port) as run:
        run.report()
        memory = run.memory()
        with Flood(code, run.port):
            before = run.report()
            run.report()
            after, grown = run.report(), run.memory() - memory
        elapsed = after["t_s"] - before["t_s"]
        assert after["samples"] - before["samples"] >= 0.9 * 100 * elapsed
        assert grown < 20e6
        if not port.startswith(("can:", "udp:")):
            time.sleep(1)
            with serial.serial_for_url(run.port, baudrate=2_000_000, timeout=1) as driver:
                if device != "inspire_rh56dftp":
                    assert driver.read(1), "served again"
        with Flood(code, run.port):
            time.sleep(0.3)
            asked = time.monotonic()
            run.process.send_signal(signal.SIGTERM)
            run.report("summary")
            assert time.monotonic() - asked < 0.5
