"""Echo times of a USB device by USB/IP: ``python -m tests.transports.usb_echo [--kernel] [COUNT]``.

Without ``--kernel`` the host is a socket of this process, which sends the requests that a kernel would: what remains is
the device's side and the loopback interface. With it, this machine's kernel has the device, and pyserial the node.
"""

import select
import socket
import statistics
import struct
import sys
import threading
import time

from firmware_protocols import Serial
from tactemu import transports
from tactemu.transports.transport import Received
from tactemu.transports.usb import usbip_protocol as protocol
from tests.drivers.usb_link import UsbLink

CHIPS = ("cdc", "ftdi", "cp210x", "ch341")
MESSAGE = bytes(range(16))
_SUBMIT = struct.Struct(">5IIiIiI8s")
CONNECTOR = Serial(baud=115_200)


class Echo(threading.Thread):
    """A device that returns what it hears."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.port, self.is_done = port, False

    def run(self):
        while not self.is_done:
            select.select(self.port.filenos(), [], [], 0.1)
            for event in self.port.poll():
                if isinstance(event, Received):
                    self.port.write(event.data)


class Socket:
    """A host with one request for data at a time, and one with data."""

    def __init__(self, port, chip):
        words = port.address.split()
        self.link = socket.create_connection(("127.0.0.1", int(words[2])))
        self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.link.sendall(
            protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_IMPORT, 0) + words[-1].encode().ljust(32, b"\0")
        )
        self.link.recv(320, socket.MSG_WAITALL)
        self.chip, self.number = chip, 0
        self.submit(chip.data_in, 512)

    def submit(self, address, room, data=b""):
        self.number += 1
        head = (1, self.number, 0, address >> 7, address & 15, 0, room, 0, 0, 0, bytes(8))
        self.link.sendall(_SUBMIT.pack(*head) + data)

    def exchange(self):
        """Send, and wait for both answers."""
        self.submit(self.chip.data_out, len(MESSAGE), MESSAGE)
        asked, got = self.number - 1, b""
        while not got.endswith(MESSAGE):
            head = self.link.recv(48, socket.MSG_WAITALL)
            number, length = struct.unpack_from(">I", head, 4)[0], struct.unpack_from(">i", head, 24)[0]
            if number == asked:
                got = self.link.recv(length, socket.MSG_WAITALL)
        self.submit(self.chip.data_in, 512)


class Node:
    """The node that this machine's kernel has made."""

    def __init__(self, node):
        import serial

        self.serial = serial.Serial(node, 115_200, timeout=5)
        time.sleep(0.5)

    def exchange(self):
        self.serial.write(MESSAGE)
        assert self.serial.read(len(MESSAGE)) == MESSAGE


def measure(exchange, count: int) -> list[float]:
    """Return the times of some exchanges [ms]."""
    times = []
    for _ in range(count):
        start = time.perf_counter()
        exchange()
        times.append(1e3 * (time.perf_counter() - start))
    return times


def main(count: int, in_kernel: bool) -> None:
    for name in CHIPS:
        if in_kernel:
            link = UsbLink(name, CONNECTOR)
            echo, host = Echo(link.port), None
            close = link.close
        else:
            port = transports.create(f"usbip:{name}@0")
            port.set_connector(CONNECTOR)
            port.open()
            echo, link, close = Echo(port), None, port.close
        echo.start()
        host = Node(link.node) if link else Socket(echo.port, echo.port._chip)
        measure(host.exchange, 20)
        times = sorted(measure(host.exchange, count))
        print(f"{name:8} p50 {statistics.median(times):.2f} ms, p99 {times[int(0.99 * count)]:.2f} ms", flush=True)
        echo.is_done = True
        echo.join()
        close()


if __name__ == "__main__":
    main(int(next((each for each in sys.argv[1:] if each.isdigit()), "1000")), "--kernel" in sys.argv)
