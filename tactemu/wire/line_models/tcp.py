"""A TCP server with a framing of its own: bytes in order, without a speed."""

from __future__ import annotations

from firmware_protocols import WireFrame
from tactemu.wire.line_models.line_model import LineModel


class TcpLine(LineModel):
    """Both directions are free of each other."""

    kind = "tcp"
    schemes = ("tcp",)
    is_network = True

    def duration_ns(self, frame: WireFrame) -> int:
        """The network takes none that we model."""
        return 0

    def describe(self) -> str:
        """``TCP port 6000``."""
        return f"TCP port {self.connector.port}"

    def usual_port(self, name: str) -> str:
        """Return the device's own port number, on this machine only."""
        return f"tcp:127.0.0.1:{self.connector.port}"

    def fresh_port(self, name: str) -> str:
        """Return any free one."""
        return "tcp:127.0.0.1:0"
