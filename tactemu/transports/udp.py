"""``udp:HOST:PORT``: a UDP socket, for devices that send datagrams.

The driver is the sender of the last datagram: all frames go there. ``udp:PORT`` listens on loopback only; name an
address (``udp:0.0.0.0:5000``) to be reached from other machines. Port 0 takes a free one.

UDP has no connection. The port counts as opened once the driver has sent a datagram (an empty one opens it only), and
as closed when the driver's machine reports that its port is unreachable.
"""

from __future__ import annotations

import contextlib
import socket
from typing import Any

from firmware_protocols import WireFrame
from tactemu.base.errors import TransportError
from tactemu.transports import inet
from tactemu.transports.forks import close_in_children
from tactemu.transports.receive_queue import ReceiveQueue
from tactemu.transports.transport import DROPPED, MAX_CHUNK_BYTES, RAISED, Closed, Event, Opened, Received, Transport

_RECEIVE_BUFFER_BYTES = 65_536
"""Size of the kernel's buffer for datagrams between two polls [byte, with overhead]; further ones are lost."""
_MAX_DATAGRAM_BYTES = 65_535
"""Maximum size of a datagram [byte]."""
_MAX_DATAGRAMS_PER_POLL = 32
"""Maximum number of datagrams that one poll takes."""
_ERRORS = {socket.AF_INET: (socket.IPPROTO_IP, 11), socket.AF_INET6: (socket.IPPROTO_IPV6, 25)}
"""The options IP_RECVERR and IPV6_RECVERR, which report datagrams that came back; Python has no names for them."""


class UdpTransport(Transport):
    """A UDP socket with one peer at a time: the last sender."""

    scheme = "udp"

    def __init__(self, location: str):
        self.host, self.port = inet.parse(self.scheme, location)
        self.address = f"udp://{inet.join(self.host, self.port)}"
        self._socket: socket.socket | None = None
        self._queue: ReceiveQueue | None = None
        self._peer: Any = None
        """The address of the driver."""

    def open(self) -> None:
        """Bind the socket.

        Raises:
            TransportError: the address is not of this machine, or the port is taken or not allowed.
        """
        if self._socket is not None:
            return
        with contextlib.ExitStack() as undo:
            try:
                family, where = inet.resolve(self.host, self.port, socket.SOCK_DGRAM)
                port = undo.enter_context(socket.socket(family, socket.SOCK_DGRAM))
                port.bind(where)
            except OSError as error:
                raise inet.cannot_listen(self.scheme, self.host, self.port, error) from None
            undo.pop_all()
        port.setblocking(False)
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        port.setsockopt(*_ERRORS[family], 1)
        self._socket, self._queue = port, ReceiveQueue(port.fileno(), size=0)
        close_in_children(self)
        self.port = port.getsockname()[1]
        self.address = f"udp://{inet.join(self.host, self.port)}"
        inet.warn_if_reachable(self.address, where[0])

    def close(self) -> None:
        """Close the socket."""
        if self._queue is not None:
            self._queue.close()
            self._queue = None
        if self._socket is not None:
            self._socket.close()
        self._socket = self._peer = None

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the socket."""
        return [self._socket.fileno()] if self._socket is not None and reading else []

    def poll(self, reading: bool = True) -> list[Event]:
        """Return datagrams of one peer; one of another peer waits for the next poll, so that each is answered."""
        events: list[Event] = []
        room, number = MAX_CHUNK_BYTES if reading else 0, 0
        if self._peer in self._refused():
            self._peer = None
            events += [Closed(), DROPPED]
        while room > 0 and number < _MAX_DATAGRAMS_PER_POLL and (taken := self._take(of_peer=number > 0)) is not None:
            data, peer = taken
            events += [Opened(), RAISED] if self._peer is None else []
            events += [Received(data)] if data else []
            self._peer, room, number = peer, room - len(data), number + 1
        return events + self._queue.overflows() if number and self._queue is not None else events

    def _take(self, *, of_peer: bool) -> tuple[bytes, Any] | None:
        if self._socket is None:
            return None
        try:
            if of_peer and self._socket.recvfrom(0, socket.MSG_PEEK)[1] != self._peer:
                return None
            return self._socket.recvfrom(_MAX_DATAGRAM_BYTES)
        except OSError:  # nothing is there
            return None

    def _refused(self) -> list[Any]:
        """Return the addresses whose machines sent datagrams back."""
        refused = []
        with contextlib.suppress(OSError):  # no more
            while self._socket is not None and len(refused) < _MAX_DATAGRAMS_PER_POLL:
                refused.append(self._socket.recvmsg(0, 0, socket.MSG_ERRQUEUE)[3])
        return refused

    def write(self, frame: WireFrame) -> bool:
        """Send one datagram; ``False`` while the driver's address is unknown, or where it is too long."""
        if not isinstance(frame, bytes):
            raise TransportError(f"UDP cannot carry the CAN frame {frame}")
        if self._socket is None or self._peer is None:
            return False
        try:
            self._socket.sendto(frame, self._peer)
        except OSError:
            return False
        return True

    @property
    def has_reader(self) -> bool:
        """True once a driver has sent a datagram."""
        return self._peer is not None
