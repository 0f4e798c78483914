"""A half-duplex line (RS-485, one-wire TTL): one talks, all hear; answers to one broadcast leave in turn."""

from __future__ import annotations

from typing import Any

from firmware_protocols import Connector, Rs485, WireFrame
from tactemu.wire.line_models.line_model import DRIVER
from tactemu.wire.line_models.serial import SerialLine


class Rs485Line(SerialLine):
    """The driver's bytes and every device's share one line. Devices may have baud rates of their own; who is set
    differently hears noise."""

    is_shared = True
    is_half_duplex = True

    def order(self, turn: int, ready_ns: int) -> tuple[int, int]:
        """By turn, then by when it is ready."""
        return (turn, ready_ns)

    def turnaround_ns(self) -> int:
        """As the connector says."""
        return self.connector.turnaround_ns

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Everything that is said on the line."""
        return True

    def collides(self, sender: str) -> bool:
        """A device holds the line: what the driver says into it is lost to all."""
        return sender not in ("", DRIVER)

    def echoes(self) -> bool:
        """As the connector says."""
        return self.connector.echo

    def agrees(self, other: Connector) -> bool:
        """Any two devices of this kind can be wired together."""
        return isinstance(other, Rs485)

    def describe(self) -> str:
        """``RS-485 115200 8N1``."""
        return super().describe().replace("serial", "RS-485")
