"""An I2C bus: nine clocks a byte, one controller, which is the driver's, and targets that answer to their addresses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from firmware_protocols import Connector, I2c, WireFrame
from firmware_protocols.frames import payload
from tactemu.transports.transport import CanFilter
from tactemu.wire.line import LineModel

CLOCKS_PER_BYTE = 9
"""Clocks of a byte: eight bits and the acknowledgement."""
MAX_ADDRESS = 0x7F


class I2cLine(LineModel, connector=I2c):
    """The bus at the clock of the controller; targets do not stretch it."""

    kind = "i2c"
    schemes = ("i2cdriver",)
    likely_faults = ("flip", "silence", "unplug")
    is_shared = True
    is_half_duplex = True

    def duration_ns(self, frame: WireFrame) -> int:
        """Return the time of the bytes of a frame [ns]."""
        return self._clocks_ns(CLOCKS_PER_BYTE * len(payload(frame)))

    def driver_ns(self, frame: WireFrame, setting: Any) -> int:
        """Return the time of a write, or of the address of a read, with its start [ns]."""
        data = payload(frame)
        return self._clocks_ns(1 + CLOCKS_PER_BYTE * (len(data) if I2c.asked(data) is None else 1))

    def _clocks_ns(self, count: int) -> int:
        return round(count * 1e9 / self.connector.clock_hz) if self.pacing else 0

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Return True if a frame of the driver has an address of the device."""
        data = payload(frame)
        return not of_peer and bool(data) and data[0] >> 1 in connector.addresses

    def filters(self, connectors: Iterable[Any]) -> list[CanFilter]:
        """Return a filter for each address, by which the port knows who acknowledges."""
        return [CanFilter(address, MAX_ADDRESS) for connector in connectors for address in connector.addresses]

    def agrees(self, other: Connector) -> bool:
        """Return True if the other device has the same clock and other addresses."""
        if not isinstance(other, I2c) or other.clock_hz != self.connector.clock_hz:
            return False
        return not set(other.addresses) & set(self.connector.addresses)

    def describe(self) -> str:
        """Return the line in words: ``I2C 0x04 100 kHz``."""
        addresses = ", ".join(f"{each:#04x}" for each in self.connector.addresses)
        return f"I2C {addresses} {self.connector.clock_hz // 1000} kHz"
