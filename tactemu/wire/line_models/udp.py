"""A UDP port: datagrams, each by itself, without a speed."""

from __future__ import annotations

from firmware_protocols import WireFrame
from tactemu.wire.line_models.line_model import LineModel


class UdpLine(LineModel):
    """Both directions are free of each other, and a datagram that is held back is overtaken."""

    kind = "udp"
    schemes = ("udp",)
    is_network = True
    is_byte_stream = False

    def duration_ns(self, frame: WireFrame) -> int:
        """The network takes none that we model."""
        return 0

    def describe(self) -> str:
        """``UDP port 49152``."""
        return f"UDP port {self.connector.port}"

    def usual_port(self, name: str) -> str:
        """Return the device's own port number, on this machine only."""
        return f"udp:127.0.0.1:{self.connector.port}"

    def fresh_port(self, name: str) -> str:
        """Return any free one."""
        return "udp:127.0.0.1:0"
