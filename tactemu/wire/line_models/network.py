"""Lines of the machine's network, without a speed: TCP connections, UDP datagrams and WebSocket messages."""

from __future__ import annotations

from typing import ClassVar

from firmware_protocols import Tcp, Udp, WebSocket, WireFrame
from tactemu.wire.line import LineModel


class NetworkLine(LineModel):
    """A line to a port with a number; the two directions do not delay each other."""

    title: ClassVar[str]
    """The name of the protocol."""
    is_network = True

    def duration_ns(self, frame: WireFrame) -> int:
        """Return 0: the time on the network is not modelled."""
        return 0

    def describe(self) -> str:
        """Return the line in words: ``TCP port 6000``."""
        return f"{self.title} port {self.connector.port}"

    def usual_port(self, name: str) -> str:
        """Return the device's own port number, on this machine only."""
        return f"{self.schemes[0]}:127.0.0.1:{self.connector.port}"

    def fresh_port(self, name: str) -> str:
        """Return the address of any free port."""
        return f"{self.schemes[0]}:127.0.0.1:0"


class TcpLine(NetworkLine, connector=Tcp):
    """A connection to a TCP server with the device's own framing: bytes in order."""

    kind = "tcp"
    title = "TCP"
    schemes = ("tcp",)
    faults = ("garbage", "split", "chunk", "merge", "close", "halfopen")
    likely_faults = ("truncate", "lose", "garbage", "chunk", "split", "merge", "silence", "unplug", "halfopen")


class UdpLine(NetworkLine, connector=Udp):
    """A UDP socket: datagrams, each by itself; one that is held back is overtaken."""

    kind = "udp"
    title = "UDP"
    schemes = ("udp",)
    likely_faults = ("truncate", "reorder", "stray", "silence")
    is_byte_stream = False


class WebSocketLine(NetworkLine, connector=WebSocket):
    """A connection to a WebSocket server: messages in order."""

    kind = "websocket"
    title = "WebSocket"
    schemes = ("ws",)
    faults = ("split", "close", "halfopen")
    likely_faults = ("silence", "unplug", "halfopen")
