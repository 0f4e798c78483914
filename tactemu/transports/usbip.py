"""``usbip:HOST:PORT``: the sensor as a USB device, which any machine that speaks USB/IP attaches.

``usbip attach -r HOST -b 1-1`` makes it a true USB device of that machine: the machine's own driver binds to it, udev
names it, libusb sees it. The connector says what is soldered on (``Serial(usb=USB(...))``): a board with USB of its own
(CDC-ACM), or an FTDI, CP210x or CH340 chip; ``usbip:ftdi@PORT`` takes another. Several devices on one address are ports
of one hub: 1-1, 1-2 ... ``usbip:`` alone listens on port 3240 of the loopback interface.
"""

from __future__ import annotations

import os
import socket
from collections import deque

from firmware_protocols import USB, Connector, Serial, WireFrame
from tactemu.base.errors import TransportError, nearest
from tactemu.transports import inet
from tactemu.transports.transport import (
    DROPPED,
    MAX_CHUNK_BYTES,
    Closed,
    Event,
    LinesChanged,
    Noted,
    Opened,
    Received,
    SerialSetting,
    Transport,
)  # fmt: skip
from tactemu.transports.usb.chip import Chip
from tactemu.transports.usb.link import HostLink
from tactemu.transports.usb.serial_chips import CHIPS, chip_of
from tactemu.transports.usb.usbip_server import Export, UsbIpServer, shared_server

USUAL_PORT = 3240
MAX_TO_HOST_BYTES = 4096
"""Maximum number of bytes that wait for the host; a frame that finds no room is dropped whole."""


class UsbIpPort(Transport):
    """A USB device, attached by one host at a time.

    Args:
        location: ``HOST:PORT`` or ``PORT``; empty: the usual port on the loopback interface.
        chip: the device.

    Raises:
        TransportError: the address cannot be parsed.
    """

    def __init__(self, location: str, chip: Chip):
        self._host, self._port = inet.parse(self.scheme, location or str(USUAL_PORT))
        self.address = f"{self.scheme}:{location}"
        self._chip = chip
        self._server: UsbIpServer | None = None
        self._export: Export | None = None
        self._link: HostLink | None = None
        self._is_taken = False
        """True while a host has the device."""
        self._attached: deque[socket.socket] = deque()
        """Connections of hosts that another thread may have accepted."""
        self._wake = -1
        """A file descriptor that is readable while there is such a connection."""
        self._has_reader = False
        self._events: deque[Event] = deque()

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Listen, and offer the device.

        Raises:
            TransportError: the address is not of this machine, or the port is taken by another process.
        """
        if self._server is not None:
            return
        self._server = shared_server(self._host, self._port)
        self._port = self._server.port  # after the fault `unplug`, too
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._export = self._server.add(self._chip, self._attach, lambda: not self._is_taken)
        host = inet.join(self._server.host, self._server.port).rpartition(":")[0]
        self.address = f"usbip --tcp-port {self._server.port} attach -r {host} -b {self._export.busid}"

    def close(self) -> None:
        """Pull the cable: the host's node goes. Safe to call twice."""
        self._drop_link()
        if self._server is not None and self._export is not None:
            self._server.remove(self._export)
            os.close(self._wake)
        self._server = self._export = None
        while self._attached:
            self._attached.popleft().close()
        self._events.clear()

    def _attach(self, connection: socket.socket) -> None:
        self._is_taken = True
        os.eventfd_write(self._wake, 1)  # first: whoever finds the connection resets what woke it
        self._attached.append(connection)

    def _drop_link(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        self._has_reader = self._is_taken = False

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the server's file descriptor and those of the host."""
        if self._server is None:
            return []
        own = [self._link.fileno()] if self._link is not None else []
        return [self._server.fileno(), self._wake, *own]

    # -- events ----------------------------------------------------------------------------------------------------

    def poll(self, reading: bool = True) -> list[Event]:
        """Return hosts that come and go, a driver that opens and closes the port, its settings and its bytes."""
        if self._server is None:
            return []
        self._server.serve()
        if self._attached:
            os.eventfd_read(self._wake)
            self._link = HostLink(self._attached.popleft(), self._chip)
            self._events.append(Noted("attached by a host"))
        link = self._link
        if link is not None:
            link.receive()
            self._note_reader(link.has_reader)
            self._events += self._chip.events
            self._chip.events.clear()
            room = MAX_CHUNK_BYTES if reading else 0
            while room > 0 and (data := link.take()) is not None:
                self._events += self._decode(data)
                room -= len(data)
            link.pump()
            link.send()
            if not link.is_alive:
                self._note_reader(False)
                self._drop_link()
                self._events.append(Noted("detached by the host"))
        events = list(self._events)
        self._events.clear()
        return events

    def _note_reader(self, has_reader: bool) -> None:
        if has_reader == self._has_reader:
            return
        self._has_reader = has_reader
        if has_reader:
            self._events.append(Opened())
        else:
            self._events += (Closed(), DROPPED) if self._chip.lines != DROPPED else (Closed(),)
            self._chip.lines = LinesChanged(False, False)

    def _decode(self, data: bytes) -> list[Event]:
        """Return the events that a transfer of the host makes."""
        return [Received(data)] if data else []

    # -- bytes out -------------------------------------------------------------------------------------------------

    def _put(self, data: bytes, most: int) -> bool:
        """Hand a frame to the host; return False if more than ``most`` bytes would wait for it."""
        if self._link is None or self._link.to_host_bytes + len(data) > most:
            return False
        self._reply(data)
        return True

    def _reply(self, data: bytes) -> None:
        """Hand data to the host, however many wait."""
        if self._link is not None:
            self._link.put(data)
            self._link.send()

    @property
    def has_reader(self) -> bool:
        """True while a driver has the port open."""
        return self._has_reader


class UsbIpTransport(UsbIpPort):
    """A USB device with a serial port.

    Raises:
        TransportError: the address cannot be parsed, or there is no such chip.
    """

    scheme = "usbip"

    def __init__(self, location: str = ""):
        chip, at, where = location.rpartition("@")
        if at and chip not in CHIPS:
            known = ", ".join(CHIPS)
            raise TransportError(
                f"port 'usbip:{location}': unknown chip {chip!r}{nearest(chip, CHIPS)}; expected {known}"
            )
        super().__init__(where, CHIPS[chip or "cdc"]())
        self._chip_name = chip

    def set_connector(self, connector: Connector) -> None:
        """Take the chip and its identity from the device.

        Raises:
            TransportError: the device has no serial port.
        """
        if not isinstance(connector, Serial):
            raise TransportError(f"port '{self.address}': the device has no serial port")
        own = chip_of(connector.usb)
        kind = CHIPS[self._chip_name] if self._chip_name else own
        usb = connector.usb
        self._chip = kind(usb if kind is own and isinstance(usb, USB) else None)  # another chip has its maker's ids

    def write(self, frame: WireFrame) -> bool:
        """Write one frame; ``False`` where no driver has the port open, or does not read."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a serial port cannot carry the CAN frame {frame}")
        return self._has_reader and self._put(frame, MAX_TO_HOST_BYTES)

    @property
    def setting(self) -> SerialSetting | None:
        """The setting that the driver has given the chip; unknown until then."""
        return self._chip.setting if self._chip.setting.baud else None
