"""A UDP port: datagrams, each by itself, without a speed."""

from __future__ import annotations

from firmware_protocols import WireFrame
from tactemu.wire.line import LineModel


class UdpLine(LineModel):
    """A UDP socket; the two directions do not delay each other, and a datagram that is held back is overtaken."""

    kind = "udp"
    schemes = ("udp",)
    is_network = True
    is_byte_stream = False

    def duration_ns(self, frame: WireFrame) -> int:
        """Return 0: the time on the network is not modelled."""
        return 0

    def describe(self) -> str:
        """Return the line in words: ``UDP port 49152``."""
        return f"UDP port {self.connector.port}"

    def usual_port(self, name: str) -> str:
        """Return the device's own port number, on this machine only."""
        return f"udp:127.0.0.1:{self.connector.port}"

    def fresh_port(self, name: str) -> str:
        """Return the address of any free port."""
        return "udp:127.0.0.1:0"
