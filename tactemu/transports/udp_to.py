"""``udpto:HOST:PORT``: datagrams to a driver that listens on this address and sends none.

``udpto:PORT`` is a port of this machine, on loopback; port 0 takes a free one, on which the driver then has to listen.
The port counts as opened all the time, as UDP has no connection, and what comes back is discarded.
"""

from __future__ import annotations

import contextlib
import socket

from tactemu.base.errors import TransportError, reason_of
from tactemu.transports import inet
from tactemu.transports.forks import close_in_children
from tactemu.transports.transport import Event
from tactemu.transports.udp import UdpTransport

_MAX_DISCARDED_PER_POLL = 32
"""Maximum number of datagrams that one poll discards."""


class UdpToTransport(UdpTransport):
    """A UDP socket that sends to a given address."""

    scheme = "udpto"

    def open(self) -> None:
        """Find the address to send to.

        Raises:
            TransportError: there is no such host, or no free port.
        """
        if self._socket is not None:
            return
        try:
            family, self._peer = inet.resolve(self.host, self.port, socket.SOCK_DGRAM)
            if not self.port:
                with socket.socket(family, socket.SOCK_DGRAM) as free:
                    free.bind(self._peer)
                    self._peer = free.getsockname()
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            where = inet.join(self.host, self.port)
            raise TransportError(f"cannot send to {where}: {reason_of(error)}; choose another address") from None
        self._socket.setblocking(False)
        close_in_children(self)
        self.port = self._peer[1]
        self.address = f"udp://{inet.join(self.host, self.port)}"

    def poll(self, reading: bool = True) -> list[Event]:
        """Discard what comes back."""
        if self._socket is not None:
            with contextlib.suppress(OSError):  # nothing is there
                for _ in range(_MAX_DISCARDED_PER_POLL):
                    self._socket.recv(0)
        return []
