"""Lines of the machine's network, without a speed: TCP connections, UDP datagrams, WebSocket messages, DDS topics."""

from __future__ import annotations

from typing import ClassVar

from firmware_protocols import Dds, Tcp, Udp, WebSocket, WireFrame
from tactemu.wire.line import LineModel

DOMAINS = 200
"""Number of domains, from 1 on, among which tests are spread; above about 230 there are no ports left."""


class NetworkLine(LineModel):
    """A line whose time is not modelled, here to a port with a number; the two directions do not delay each other."""

    title: ClassVar[str] = ""
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
    schemes = ("udp", "udpto")
    likely_faults = ("truncate", "reorder", "stray", "silence")
    is_byte_stream = False

    def usual_port(self, name: str) -> str:
        """Return the device's own port number on this machine, or its driver's."""
        return self._to_host(super().usual_port(name))

    def fresh_port(self, name: str) -> str:
        """Return the address of any free port."""
        return self._to_host(super().fresh_port(name))

    def _to_host(self, port: str) -> str:
        return port.replace("udp:", "udpto:") if self.connector.is_of_host else port


class WebSocketLine(NetworkLine, connector=WebSocket):
    """A connection to a WebSocket server: messages in order."""

    kind = "websocket"
    title = "WebSocket"
    schemes = ("ws",)
    faults = ("split", "close", "halfopen")
    likely_faults = ("silence", "unplug", "halfopen")


class DdsLine(NetworkLine, connector=Dds):
    """A DDS domain: the device writes one topic and may read another; a sample that is held back is overtaken."""

    kind = "dds"
    schemes = ("dds",)
    is_byte_stream = False

    def describe(self) -> str:
        """Return the line in words: ``DDS rt/hand/state``."""
        return f"DDS {self.connector.writes.name}"

    def usual_port(self, name: str) -> str:
        """Return the device's own domain, on this machine only."""
        return f"dds:{self.connector.domain}/{self.connector.writes.name}"

    def fresh_port(self, name: str) -> str:
        """Return a domain that depends on the process and the call; after 200 calls it repeats."""
        pid, number = self.fresh_number()
        return f"dds:{(pid * 31 + number) % DOMAINS + 1}/{self.connector.writes.name}"
