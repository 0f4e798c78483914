"""A half-duplex line (RS-485, one-wire TTL): one sends, all receive; answers to one broadcast leave in turn."""

from __future__ import annotations

from typing import Any

from firmware_protocols import Connector, Rs485, WireFrame
from tactemu.wire.line import DRIVER, Pacing
from tactemu.wire.line_models.serial import SerialLine


class Rs485Line(SerialLine, connector=Rs485):
    """One line for the bytes of the driver and of every device.

    Devices may have different baud rates; a device with other settings than the sender receives noise.
    """

    is_shared = True
    is_half_duplex = True
    has_turns = True

    def __init__(self, connector: Any, *, pacing: Pacing = True):
        super().__init__(connector, pacing=pacing)
        self.turnaround_ns, self.has_echo = connector.turnaround_ns, connector.echo

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Return True: every device receives all that is sent on the line."""
        return True

    def collides(self, sender: str) -> bool:
        """Return True if a device is sending: what the driver sends meanwhile is lost to all."""
        return sender not in ("", DRIVER)

    def agrees(self, other: Connector) -> bool:
        """Return True if the other connector is RS-485, whatever its settings."""
        return isinstance(other, Rs485)

    def describe(self) -> str:
        """Return the line in words: ``RS-485 115200 8N1``."""
        return super().describe().replace("serial", "RS-485")
