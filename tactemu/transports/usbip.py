"""``usbip:HOST:PORT``: the sensor as a USB device, which any machine that speaks USB/IP attaches.

``usbip attach -r HOST -b 1-1`` makes it a true USB device of that machine: the machine's own driver binds to it, udev
names it, libusb sees it. The connector says what is soldered on (``Serial(usb=USB(...))``): a board with USB of its own
(CDC-ACM), or an FTDI, CP210x or CH340 chip; ``usbip:ftdi@PORT`` takes another. A HID, or a device of a
vendor's class, is that (``Hid``, ``Bulk``). Several devices on one address are ports
of one hub: 1-1, 1-2 ...; two with an FT2232 and the same identity are the two channels of one chip. ``usbip:`` alone
listens on port 3240 of the loopback interface.
"""

from __future__ import annotations

from firmware_protocols import Connector, WireFrame
from tactemu.base.errors import TransportError, nearest
from tactemu.transports import inet
from tactemu.transports.transport import MAX_CHUNK_BYTES, Event, Noted, Received
from tactemu.transports.usb.chip import MAX_TO_HOST_BYTES, Chip
from tactemu.transports.usb.devices import device_of
from tactemu.transports.usb.link import HostLink
from tactemu.transports.usb.port import UsbPort
from tactemu.transports.usb.serial_chips import CHIPS
from tactemu.transports.usb.shared_device import SharedDevice
from tactemu.transports.usb.usbip_server import UsbIpServer, shared_server

USUAL_PORT = 3240


class UsbIpPort(UsbPort):
    """A USB device, attached by one host at a time.

    Args:
        location: ``HOST:PORT`` or ``PORT``; empty: the usual port on the loopback interface.
        chip: the device.

    Raises:
        TransportError: the address cannot be parsed.
    """

    def __init__(self, location: str, chip: Chip):
        super().__init__(chip)
        self._host, self._port = inet.parse(self.scheme, location or str(USUAL_PORT))
        self.address = f"{self.scheme}:{location}"
        self._channel_number: int | None = None
        """The number of the port's channel on a chip with several; None: the first one that is free."""
        self._shared: SharedDevice | None = None
        self._server: UsbIpServer | None = None
        self._link: HostLink | None = None

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Listen, and offer the device.

        Raises:
            TransportError: the address is not of this machine, or the port is taken by another process.
        """
        if self._server is not None:
            return
        server = shared_server(self._host, self._port)
        self._port = server.port  # after the fault `unplug`, too
        if self._shared is None:
            self._shared, self._chip = self._taken_from(server)
        busid = server.plug_in(self._shared, self._chip)
        self._server = server
        host = inet.join(server.host, server.port).rpartition(":")[0]
        self.address = f"usbip --tcp-port {server.port} attach -r {host} -b {busid}"

    def _taken_from(self, server: UsbIpServer) -> tuple[SharedDevice, Chip]:
        """Return a free channel of a device that is there, or of a new one."""
        number = self._channel_number
        if len(self._device.channels) > 1 and (found := server.shared(self._device, number)):
            return found
        shared = SharedDevice(self._device)
        channel = shared.take(number)
        if channel is None:
            raise TransportError(f"port '{self.address}': the chip has no interface {number}")
        return shared, channel

    def close(self) -> None:
        """Pull the cable: the host's node goes. Safe to call twice."""
        if self._server is not None and self._shared is not None:
            self._server.unplug(self._shared, self._chip)
            if self._link is not None:
                with self._shared.lock:
                    self._link.release()
        self._server = self._link = None
        self._forget()

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the server's file descriptor and those of the host."""
        if self._server is None or self._shared is None:
            return []
        own = [self._link.fileno()] if self._link is not None and self._link.is_alive else []
        return [self._server.fileno(), self._shared.fileno(self._chip), *own]

    # -- events ----------------------------------------------------------------------------------------------------

    def poll(self, reading: bool = True) -> list[Event]:
        """Return hosts that come and go, a driver that opens and closes the port, its settings and its bytes."""
        if self._server is None or self._shared is None:
            return []
        self._server.serve()
        with self._shared.lock:
            newest = self._shared.link(self._chip)
            if self._link is None and newest is not None:
                self._link = newest
                newest.users += 1
                self._events.append(Noted("attached by a host"))
            if self._link is not None:
                self._work(self._shared, self._link, reading)
        return self._take_events()

    def _work(self, shared: SharedDevice, link: HostLink, reading: bool) -> None:
        """Take what the host has sent, and send what waits for it."""
        if link.receive():
            shared.wake(but=self._chip)
        self._note_reader(link.has_reader(self._chip))
        self._note_chip()
        room = MAX_CHUNK_BYTES if reading else 0
        while room > 0 and (data := link.take(self._chip)) is not None:
            self._events += self._decode(data)
            room -= len(data)
        link.pump(self._chip)
        link.send()
        if not link.is_alive:
            self._note_reader(False)
            self._link = None
            shared.drop(link)
            link.release()
            self._events.append(Noted("detached by the host"))

    def _decode(self, data: bytes) -> list[Event]:
        """Return the events that a transfer of the host makes."""
        return [Received(data)] if data else []

    # -- bytes out -------------------------------------------------------------------------------------------------

    def _put(self, data: bytes, most: int) -> bool:
        """Hand a frame to the host; return False if more than ``most`` bytes would wait for it."""
        if self._link is None or self._shared is None:
            return False
        with self._shared.lock:
            if self._link.to_host_bytes(self._chip) + len(data) > most:
                return False
            self._reply(data)
        return True

    def _reply(self, data: bytes) -> None:
        """Hand data to the host, however many wait."""
        if self._link is not None and self._shared is not None:
            with self._shared.lock:
                self._link.put(self._chip, data)
                self._link.send()


class UsbIpTransport(UsbIpPort):
    """A USB device with a serial port, a HID, or one of a vendor's class.

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
            TransportError: the device is none on USB, or the address names a chip that has no place in it.
        """
        self._device, self._channel_number = device_of(connector, self.address, self._chip_name)
        self._chip = self._device.channels[0]

    def write(self, frame: WireFrame) -> bool:
        """Write one frame; ``False`` where no driver has the port open, or does not read."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a USB device cannot carry the CAN frame {frame}")
        return self._has_reader and self._put(frame, MAX_TO_HOST_BYTES)
