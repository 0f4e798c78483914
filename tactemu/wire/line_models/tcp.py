"""A TCP server with the device's own framing: bytes in order, without a speed."""

from __future__ import annotations

from firmware_protocols import WireFrame
from tactemu.wire.line import LineModel


class TcpLine(LineModel):
    """A TCP connection; the two directions do not delay each other."""

    kind = "tcp"
    schemes = ("tcp",)
    is_network = True

    def duration_ns(self, frame: WireFrame) -> int:
        """Return 0: the time on the network is not modelled."""
        return 0

    def describe(self) -> str:
        """Return the line in words: ``TCP port 6000``."""
        return f"TCP port {self.connector.port}"

    def usual_port(self, name: str) -> str:
        """Return the device's own port number, on this machine only."""
        return f"tcp:127.0.0.1:{self.connector.port}"

    def fresh_port(self, name: str) -> str:
        """Return the address of any free port."""
        return "tcp:127.0.0.1:0"
