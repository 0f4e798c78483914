"""A driver's end for every transport; a new scheme needs one in ``DRIVERS``."""

import socket
import struct
import threading
import time
from dataclasses import dataclass

import can
import pytest
import serial
import websocket

from firmware_protocols import CanFrame, Dds, Topic
from tactemu import transports
from tactemu.transports.transport import CanFilter, Received

FRAME = bytes(range(256)) + b"\r\n\xff\xff"


class PySerialEnd:
    """A driver's end of unmodified pyserial."""

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
    """A driver's end of unmodified python-can."""

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
    """A driver's end of unmodified websocket-client."""

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
    """A driver's end of Cyclone DDS with its own types."""

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


class I2cEnd(PySerialEnd):
    """A host of an I2CDriver that waits for the bytes of a read."""

    target = 0x04
    frame, request = bytes(range(60)), bytes([target << 1, 0x01, 0x80, 0x06])

    def __init__(self, port, url):
        super().__init__(port, url)
        port.set_filters([CanFilter(self.target, 0x7F)])

    def open(self, seen):
        with pumping(self.port, seen):
            self.serial = serial.Serial(self.url, 1_000_000, timeout=2)
            self.serial.write(b"@" * 65 + bytes([ord("s"), self.target << 1 | 1, 0x80 + len(self.frame) - 1]))
            assert self.serial.read(1) == b"1", "the target acknowledges"
            end = time.monotonic() + 2
            while not any(isinstance(event, Received) for event in seen) and time.monotonic() < end:
                time.sleep(0.002)

    def write(self, data):
        self.serial.write(bytes([ord("s"), data[0], 0xC0 + len(data) - 2]) + data[1:] + b"p")


def create(address):
    """Return a port that has the connector it needs."""
    port = transports.create(address)
    port.set_connector(DdsEnd.topics)
    return port


DRIVERS = {
    "memory": [("memory:", MemoryEnd)],
    "i2cdriver": [("i2cdriver:{tmp}/i2c", I2cEnd)],
    "pty": [("pty:", PySerialEnd), ("pty:{tmp}/tty", PySerialEnd)],
    "tcp": [("tcp:0", PySerialEnd), ("tcp:[::1]:0", PySerialEnd)],
    "ws": [("ws:0", WebSocketEnd), ("ws:[::1]:0", WebSocketEnd)],
    "dds": [("dds:71", DdsEnd), ("dds:lo:72/rt/elsewhere", DdsEnd)],
    "udp": [("udp:0", UdpEnd), ("udp:[::1]:0", UdpEnd)],
    "udpto": [],  # it receives nothing: test_udp_to.py
    "slcan": [("slcan:{tmp}/can", SlcanEnd)],
    "socketcand": [("socketcand:0", SocketcandEnd)],
    "serial": [],  # a real port: test_serial_port.py
    "gadget": [],  # a USB device of the machine: test_gadget.py
    "gsusb": [],  # a USB device: test_usb_in_a_kernel.py
    "usbip": [],  # a USB device: test_usbip.py
    "rfc2217": [("rfc2217:127.0.0.1:0", PySerialEnd)],
    "can": [("can:virtual:contract", CanEnd), ("can:udp_multicast:239.74.163.9", CanEnd)],
}
CASES = [pytest.param(*case, id=case[0]) for cases in DRIVERS.values() for case in cases]


class pumping:
    """A context in which another thread polls a port, as the loop would while the driver opens it."""

    def __init__(self, port, seen):
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
