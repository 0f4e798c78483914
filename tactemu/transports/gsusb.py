"""``gsusb:HOST:PORT``: the sensor's bus behind a USB CAN adapter, of which the kernel of any machine makes ``can0``.

After ``tactemu attach HOST`` and ``ip link set can0 up type can bitrate 1000000``, bit timing, states and error
counters are the kernel's own. The device is on the bus while the channel is started at the bit rate of the bus; at
another one no node acknowledges, as on a real bus. The protocol is that of candleLight adapters, driver ``gs_usb``.
"""

from __future__ import annotations

from firmware_protocols import Can, CanFrame, Connector, WireFrame
from tactemu.base.errors import TransportError
from tactemu.transports.transport import Event, Received
from tactemu.transports.usb import candle
from tactemu.transports.usb.candle import Candle
from tactemu.transports.usbip import UsbIpPort

MAX_TO_HOST_BYTES = 128 * candle.FD_BYTES
"""Maximum size of the frames that wait for the host; further ones are lost, as in a full receive queue."""


class GsUsbTransport(UsbIpPort):
    """A CAN adapter, attached by one host at a time."""

    scheme = "gsusb"

    def __init__(self, location: str = ""):
        super().__init__(location, Candle())

    @property
    def _adapter(self) -> Candle:
        assert isinstance(self._chip, Candle)
        return self._chip

    def set_connector(self, connector: Connector) -> None:
        """Take the bit rates of the bus from the connector.

        Raises:
            TransportError: the device is not on CAN.
        """
        if not isinstance(connector, Can):
            raise TransportError(f"port '{self.address}': the device is not on CAN")
        self._adapter.bus = connector

    def _decode(self, data: bytes) -> list[Event]:
        found = candle.from_host(data)
        if found is None:
            return []
        frame, echo = found
        if self._adapter.agrees:
            self._reply(echo)
            return [Received(frame)]
        self._reply(candle.unacknowledged())  # and no echo: the frame is never sent
        return []

    def _note_reader(self, has_reader: bool) -> None:
        """Note nothing: a bus has no opening and closing."""
        self._has_reader = has_reader

    def write(self, frame: WireFrame) -> bool:
        """Write one frame; ``False`` where the host's channel is not started at the bit rate of the bus."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        if not self.has_reader or (frame.is_fd and self._adapter.data_bitrate == 0):
            return False
        return frame.is_error_frame or self._put(candle.to_host(frame), MAX_TO_HOST_BYTES)

    @property
    def has_reader(self) -> bool:
        """True while the channel is started at the bit rate of the bus."""
        return self._link is not None and self._adapter.is_started and self._adapter.agrees
