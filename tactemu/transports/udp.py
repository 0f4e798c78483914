"""``udp:HOST:PORT``: a UDP socket, for devices that speak in datagrams.

The driver is whoever sent the last datagram: what leaves goes there. ``udp:PORT`` listens on loopback only; name an
address (``udp:0.0.0.0:5000``) to be reached from elsewhere. Port 0 takes a free one.

UDP has no connection. The driver has come when it has sent something (an empty datagram will do, and is nothing else),
and has gone when its machine says that nobody is there any more to take what was sent to it.
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

_RECEIVE_BUFFER = 65_536
"""What the kernel keeps of what is sent while nobody looks [byte, with its own overhead]; the rest is lost."""
_LARGEST = 65_535
"""Of a datagram [byte]."""
_AT_ONCE = 32
"""Datagrams that one look takes at most."""
_ERRORS = {socket.AF_INET: (socket.IPPROTO_IP, 11), socket.AF_INET6: (socket.IPPROTO_IPV6, 25)}
"""IP_RECVERR, IPV6_RECVERR: have the kernel keep what came back; Python has no names for them."""


class UdpTransport(Transport):
    """Datagrams to and from whoever sends some; one peer at a time."""

    scheme = "udp"

    def __init__(self, rest: str):
        self.host, self.port = inet.parse(self.scheme, rest)
        self.address = f"udp://{inet.join(self.host, self.port)}"
        self._socket: socket.socket | None = None
        self._queue: ReceiveQueue | None = None
        self._peer: Any = None
        """Address of the driver."""

    def open(self) -> None:
        """Bind.

        Raises:
            TransportError: the address is not ours, or the port is taken or not allowed.
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
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        port.setsockopt(*_ERRORS[family], 1)
        self._socket, self._queue = port, ReceiveQueue(port.fileno(), size=0)
        close_in_children(self)
        self.port = port.getsockname()[1]
        self.address = f"udp://{inet.join(self.host, self.port)}"
        inet.warn_if_reachable(self.address, where[0])

    def close(self) -> None:
        """Let go of the port."""
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
        """Datagrams of one peer. One that another sent waits for the next look: its answer is not for the first."""
        events: list[Event] = []
        room, number = MAX_CHUNK_BYTES if reading else 0, 0
        if self._peer in self._refused():
            self._peer = None
            events += [Closed(), DROPPED]
        while room > 0 and number < _AT_ONCE and (taken := self._take(of_peer=number > 0)) is not None:
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
            return self._socket.recvfrom(_LARGEST)
        except OSError:  # nothing is there
            return None

    def _refused(self) -> list[Any]:
        """To whom something was sent that came back."""
        refused = []
        with contextlib.suppress(OSError):  # no more
            while self._socket is not None and len(refused) < _AT_ONCE:
                refused.append(self._socket.recvmsg(0, 0, socket.MSG_ERRQUEUE)[3])
        return refused

    def write(self, frame: WireFrame) -> bool:
        """Send one datagram; ``False`` when nobody has spoken yet, or it is too long."""
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
        """Whether somebody has spoken."""
        return self._peer is not None
