"""The emulator's side of a CAN bus in the view: sockets that the keeper has opened in the view's network."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

from tactemu.transports.socketcan import SocketCanTransport

WAYS = {
    "native": "{names}: vcan of this kernel",
    "preload": "{names}: by the preload library over Ethernet, since this kernel has no vcan",
}
"""The description of each way to make buses."""


class BusPort(SocketCanTransport):
    """A CAN interface of the view, which exists while the port is open.

    Args:
        ask: sends a request to the keeper.
        name: the name of the interface, such as ``can0``.
        way: ``native`` or ``preload``; empty: native if the kernel can, else preload.
    """

    def __init__(self, ask: Callable[..., tuple[dict[str, Any], list[int]]], name: str, way: str = ""):
        super().__init__(f"socketcan:{name}")
        self._ask, self._wanted = ask, way
        self.way = ""
        """The way in which it was made."""
        self.number = 0
        """Not None, because the name is fixed: the port is opened before ports that take the lowest free number."""

    def _join(self) -> tuple[socket.socket, socket.socket]:
        answer, descriptors = self._ask("bus", name=self.channel, way=self._wanted)
        self.way = answer["way"]
        sockets = [socket.socket(fileno=each) for each in descriptors]
        for each in sockets:
            each.setblocking(False)
        return sockets[0], sockets[-1]

    def close(self) -> None:
        """Leave the bus, and remove the interface."""
        there = self._in is not None
        super().close()
        if there:
            self._ask("no bus", name=self.channel)

    def _is_down(self) -> bool:
        return False

    def _index_now(self) -> int:
        return 1
