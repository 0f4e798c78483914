"""What every transport promises, tried on all of the registry. A new scheme needs a driver's end in ``DRIVERS``."""

import select
import socket
import struct
import time
from dataclasses import dataclass

import can
import pytest
import serial
import websocket

from firmware_protocols import CanFrame, Dds, Topic
from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import (
    DROPPED,
    RAISED,
    Closed,
    LinesChanged,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
)

FRAME = bytes(range(256)) + b"\r\n\xff\xff"


class PySerialEnd:
    """The driver's end is pyserial, unmodified."""

    frame, request = FRAME, b"\x00\xff\xf0\r\n?\x11\x13"

    def __init__(self, port, url):
        # RFC 2217 negotiates while it opens, so our side must run meanwhile: a thread of the test plays the loop.
        self.port, self.url = port, url

    def open(self, seen):
        with pumping(self.port, seen):
            self.serial = serial.serial_for_url(self.url, timeout=2)

    def write(self, data):
        self.serial.write(data)

    def read(self, frame):
        return self.serial.read(len(frame))

    def close(self):
        self.serial.close()


class CanEnd:
    frame = CanFrame(arbitration_id=0x18FF0001, is_extended_id=True, data=b"12345678")
    request = CanFrame(arbitration_id=0x123, data=b"\x01")

    def __init__(self, port, url):
        interface, _, channel = url.partition(":")
        self.bus = can.Bus(interface=interface, channel=channel)

    def open(self, seen):
        pass

    def write(self, frame):
        self.bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False))

    def read(self, frame):
        message = self.bus.recv(2)
        while message is not None and message.arbitration_id == 0x123:  # multicast returns what we sent
            message = self.bus.recv(2)
        assert message is not None
        return CanFrame(
            arbitration_id=message.arbitration_id, is_extended_id=message.is_extended_id, data=bytes(message.data)
        )

    def close(self):
        self.bus.shutdown()


class SlcanEnd(CanEnd):
    """python-can's, unmodified."""

    def __init__(self, port, url):
        self.port, self.url = port, url

    def open(self, seen):
        with pumping(self.port, seen):
            self.bus = can.Bus(interface="slcan", channel=self.url, bitrate=1_000_000, sleep_after_open=0.1)

    def close(self):
        self.bus.shutdown()


class SocketcandEnd(SlcanEnd):
    def open(self, seen):
        host, _, port = self.url.removeprefix("socketcand://").rpartition(":")
        with pumping(self.port, seen):
            self.bus = can.Bus(interface="socketcand", host=host, port=int(port), channel="can0")


class MemoryEnd:
    frame, request = FRAME, b"?"

    def __init__(self, port, url):
        self.driver = port.driver
        self.driver.is_open = False

    def open(self, seen):
        self.driver.open()

    def write(self, data):
        self.driver.write(data)

    def read(self, frame):
        return b"".join(self.driver.read())

    def close(self):
        self.driver.close()


class WebSocketEnd:
    """The driver's end is websocket-client, unmodified."""

    frame, request = '{"force": "µN"}'.encode(), b"?"

    def __init__(self, port, url):
        self.port, self.url = port, url

    def open(self, seen):
        with pumping(self.port, seen):
            self.client = websocket.create_connection(self.url, timeout=2)

    def write(self, data):
        self.client.send(data.decode())

    def read(self, frame):
        return self.client.recv().encode()

    def close(self):
        self.client.send_close()


class UdpEnd:
    frame, request = FRAME, b"\x12\x34"

    def __init__(self, port, url):
        self.port, (host, number) = port, url.removeprefix("udp://").rsplit(":", 1)
        self.where = host.strip("[]"), int(number)

    def open(self, seen):
        self.socket = socket.socket(socket.AF_INET6 if ":" in self.where[0] else socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(2)
        self.socket.connect(self.where)
        self.socket.send(b"")

    def write(self, data):
        self.socket.send(data)

    def read(self, frame):
        return self.socket.recv(65_536)

    def close(self):
        self.socket.close()
        assert self.port.write(self.frame), "what is sent to nobody comes back"


class DdsEnd:
    """The driver's end is Cyclone DDS with types of its own."""

    frame, request = b"\x01\x00\x00\x00\x00\x00\x80\x3f", b"\x02\x00\x00\x00\x00\x00\x80\x3f"
    topics = Dds(
        writes=Topic(name="rt/there", type="test::Note_"),
        reads=Topic(name="rt/back", type="test::Note_"),
        idl="struct test::Note_ { uint32 number; float value; };",
    )

    def __init__(self, port, url):
        self.domain = int(url.partition("/")[0].rpartition(":")[2])
        self.topic = url.partition("/")[2] or "rt/there"

    def open(self, seen):
        from cyclonedds import domain, idl, pub, sub, topic
        from cyclonedds.idl import annotations, types

        @dataclass
        @annotations.final
        @annotations.autoid("sequential")
        class Note(idl.IdlStruct, typename="test.Note_"):
            number: types.uint32
            value: types.float32

        participant = domain.DomainParticipant(self.domain)
        self.note = Note
        self.reader = sub.DataReader(participant, topic.Topic(participant, self.topic, Note))
        self.writer = pub.DataWriter(participant, topic.Topic(participant, "rt/back", Note))

    def write(self, data):
        self.writer.write(self.note(int.from_bytes(data[:4], "little"), 1.0))

    def read(self, frame):
        (sample,) = self.reader.take(9)
        return struct.pack("<If", sample.number, sample.value)

    def close(self):
        del self.reader, self.writer


def create(address):
    """A port; what it carries is said to one that must know."""
    port = transports.create(address)
    port.set_connector(DdsEnd.topics)
    return port


DRIVERS = {
    "memory": [("memory:", MemoryEnd)],
    "pty": [("pty:", PySerialEnd), ("pty:{tmp}/tty", PySerialEnd)],
    "tcp": [("tcp:0", PySerialEnd), ("tcp:[::1]:0", PySerialEnd)],
    "ws": [("ws:0", WebSocketEnd), ("ws:[::1]:0", WebSocketEnd)],
    "dds": [("dds:71", DdsEnd), ("dds:lo:72/rt/elsewhere", DdsEnd)],
    "udp": [("udp:0", UdpEnd), ("udp:[::1]:0", UdpEnd)],
    "slcan": [("slcan:{tmp}/can", SlcanEnd)],
    "socketcand": [("socketcand:0", SocketcandEnd)],
    "rfc2217": [("rfc2217:127.0.0.1:0", PySerialEnd)],
    "can": [("can:virtual:contract", CanEnd), ("can:udp_multicast:239.74.163.9", CanEnd)],
}
CASES = [pytest.param(*case, id=case[0]) for cases in DRIVERS.values() for case in cases]


class pumping:
    """Polls a port from another thread, as the loop would while the driver opens it."""

    def __init__(self, port, seen):
        import threading

        self.port, self.seen, self.done = port, seen, threading.Event()
        self.thread = threading.Thread(target=self._run)

    def _run(self):
        while not self.done.is_set():
            self.seen += self.port.poll()
            time.sleep(0.002)

    def __enter__(self):
        self.thread.start()

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()


def look(port, seen, kind, seconds=2.0):
    end = time.monotonic() + seconds
    while not any(isinstance(event, kind) for event in seen) and time.monotonic() < end:
        if port.filenos():
            select.select(port.filenos(), [], [], 0.05)
        seen += port.poll()
    return seen


def test_every_scheme_has_a_driver():
    assert set(DRIVERS) == set(transports.TRANSPORTS)


@pytest.mark.parametrize(("address", "end"), CASES)
def test_a_driver_comes_talks_and_goes_twice(address, end, tmp_path):
    with create(address.format(tmp=tmp_path)) as port:
        driver = end(port, port.address)
        bus, adapter = type(driver) is CanEnd, isinstance(driver, CanEnd)
        for _ in range(1 if bus else 2):
            assert port.has_reader == bus
            if not bus:
                assert not port.write(driver.frame), "nobody listens"
            seen = []
            driver.open(seen)
            if not adapter:
                look(port, seen, LinesChanged)
                assert seen[0] == Opened() and [e for e in seen if isinstance(e, LinesChanged)][-1] == RAISED
            while adapter and not bus and not port.has_reader:
                port.poll()
            assert port.has_reader
            assert port.write(driver.frame)
            assert driver.read(driver.frame) == driver.frame
            driver.write(driver.request)
            seen = look(port, [], Received)
            assert [event.data for event in seen if isinstance(event, Received)] == [driver.request]
            assert port.poll() == [], "own frames do not come back"
            driver.close()
            if not adapter:
                assert look(port, [], Closed)[-2:] == [Closed(), DROPPED]
            look(port, [], Closed, seconds=0.1)


@pytest.mark.parametrize(("address", "end"), CASES)
def test_closing_is_safe_at_any_time(address, end, tmp_path):
    port = create(address.format(tmp=tmp_path))
    port.close()
    assert port.poll() == [] and not port.has_reader
    for _ in range(3):
        port.open()
        port.open()
        assert all(fileno >= 0 for fileno in port.filenos())
        port.close()
        port.close()
    assert port.filenos() == [] and not port.has_reader


@pytest.mark.parametrize(
    "address",
    [
        "",
        "nope:",
        "can:",
        "can:socketcan",
        "tcp:",
        "tcp:host:",
        "tcp:1:99999",
        "udp:1:99999",
        "ws:x",
        "dds:",
        "dds:300",
        "dds:lo",
        "udp:no.such.host.invalid:1",
        "rfc2217:x",
        "tcp:no.such.host.invalid:1",
    ],
)
def test_wrong_addresses_say_what_is_expected(address):
    with pytest.raises(TransportError, match=r"expected|choose"):
        transports.create(address).open()


@pytest.mark.parametrize("address", ["can:socketcan:nosuchcan0", "can:nosuchinterface:x"])
def test_a_missing_can_interface_names_the_fix(address):
    with pytest.raises(TransportError, match=r"ip link add dev nosuchcan0 type vcan|choose an interface.*socketcan"):
        transports.create(address).open()


@pytest.mark.parametrize("scheme", ["tcp", "udp", "ws"])
def test_a_taken_port(scheme):
    with transports.create(f"{scheme}:0") as first, pytest.raises(TransportError, match="in use"):
        transports.create(f"{scheme}:{first.port}").open()


@pytest.mark.parametrize(
    ("address", "warns"),
    [("tcp:0", 0), ("tcp:[::1]:0", 0), ("tcp:0.0.0.0:0", 1), ("tcp:[::]:0", 1), ("udp:0", 0), ("udp:0.0.0.0:0", 1)],
)
def test_a_port_that_others_reach_says_so_in_one_line(address, warns, caplog):
    with transports.create(address) as port:
        assert [record.getMessage().count("\n") for record in caplog.records] == [0] * warns
        assert all(port.address in record.getMessage() for record in caplog.records)


def test_a_client_that_comes_and_goes_and_comes_again_does_not_wait():
    """A full queue of clients costs the next one a second: the kernel forgets it, and it asks again."""
    with transports.create("tcp:0") as port:
        began = time.monotonic()
        for _ in range(8):
            socket.create_connection(("127.0.0.1", port.port)).close()
        assert time.monotonic() - began < 0.9
        with socket.create_connection(("127.0.0.1", port.port)):
            assert look(port, [], Received, seconds=0.2).count(Opened()) == 9
            assert port.has_reader


def test_a_second_tcp_client_is_turned_away():
    with transports.create("tcp:0") as port:
        first = serial.serial_for_url(port.address, timeout=1)
        seen = look(port, [], Opened)
        second = serial.serial_for_url(port.address, timeout=1)
        for _ in range(3):
            seen += port.poll()
        with pytest.raises(serial.SerialException):
            second.read(1)
        port.write(b"first")
        assert first.read(5) == b"first" and seen == [Opened(), RAISED]
        first.close()


def test_a_tcp_client_that_does_not_read_loses_whole_frames():
    with transports.create("tcp:0") as port:
        driver = serial.serial_for_url(port.address, timeout=0.2)
        look(port, [], Opened)
        frame = bytes(range(250)) * 4
        taken = sum(port.write(frame) for _ in range(20_000))
        assert taken < 20_000
        got = b""
        while len(got) < taken * len(frame) and (chunk := driver.read(100_000)):
            got += chunk
            port.poll()
        assert got == frame * taken
        driver.close()


def test_rfc2217_speed_and_modem_lines():
    with transports.create("rfc2217:0") as port:
        seen = []
        with pumping(port, seen):
            driver = serial.serial_for_url(port.address, baudrate=460_800, timeout=1)
            driver.dtr = False
            driver.rts = False
            driver.baudrate = 123_456
            driver.bytesize, driver.parity, driver.stopbits = 7, "E", 2
            assert driver.cts and driver.dsr
            driver.write(b"\xff\xff\x00" * 10)
            time.sleep(0.1)
            driver.close()
        assert {event.setting.baud for event in seen if isinstance(event, SettingChanged)} == {460_800, 123_456}
        assert port.setting == SerialSetting(123_456, 7, "E", 2)
        assert [event for event in seen if isinstance(event, LinesChanged)][-1] == LinesChanged(False, False)
        assert b"".join(event.data for event in seen if isinstance(event, Received)) == b"\xff\xff\x00" * 10
        assert Closed() in seen


def test_rfc2217_survives_malformed_options():
    import numpy as np

    rng = np.random.default_rng(5)
    with transports.create("rfc2217:0") as port:
        client = socket.create_connection(("127.0.0.1", port.port))
        look(port, [], Opened)
        for _ in range(300):
            parts = [b"\xff\xfa\x2c", b"\xff\xf0", b"\xff", b"\x01", bytes(rng.integers(0, 256, 3, np.uint8))]
            client.sendall(b"".join(parts[k] for k in rng.integers(0, 5, 12)))
            port.poll()
            client.setblocking(False)
            try:
                while client.recv(65_536):
                    pass
            except BlockingIOError:
                client.setblocking(True)
        assert port.has_reader
        client.close()
