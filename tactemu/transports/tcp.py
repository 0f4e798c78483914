"""``tcp:HOST:PORT``: a raw TCP server, for pyserial's ``socket://HOST:PORT`` and for devices that speak over TCP.

One client at a time, as on a port: another is turned away until the first has gone. ``tcp:PORT`` listens on loopback
only; name an address (``tcp:0.0.0.0:5000``) to be reached from elsewhere. Port 0 takes a free one.
"""

from __future__ import annotations

import contextlib
import select
import socket

from firmware_protocols import WireFrame
from tactemu.base.errors import TransportError
from tactemu.transports import inet
from tactemu.transports.forks import close_in_children
from tactemu.transports.transport import (
    DROPPED,
    MAX_CHUNK_BYTES,
    MAX_LEFTOVER_BYTES,
    RAISED,
    Closed,
    Event,
    Opened,
    Received,
    Transport,
)

_SEND_BUFFER = 16_384
"""What the kernel keeps for a client that does not read [byte]; about as much as a serial port does."""
_RECEIVE_BUFFER = 16_384
"""What the kernel keeps of what a client sends while the line is busy [byte]."""
_BACKLOG = 16
"""Clients that may wait to be accepted: one that comes, goes and comes again at once must not wait for a second."""


class TcpTransport(Transport):
    """A server for one client. A serial device behind it is a port of a terminal server without settings."""

    scheme = "tcp"
    url = "socket"
    """Scheme of the URL with which pyserial opens it."""

    def __init__(self, rest: str):
        self.host, self.port = inet.parse(self.scheme, rest)
        self.address = self._url()
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._unsent = b""
        """What the kernel did not take yet of a frame (or of the protocol around it): it goes first."""
        self._held = False

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Listen.

        Raises:
            TransportError: the address is not ours, or the port is taken or not allowed.
        """
        if self._server is not None:
            return
        try:
            family, where = inet.resolve(self.host, self.port, socket.SOCK_STREAM)
            server = socket.create_server(where, family=family, backlog=_BACKLOG)
        except OSError as error:
            raise inet.cannot_listen(self.scheme, self.host, self.port, error) from None
        server.setblocking(False)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)  # clients inherit it
        self._server = server
        close_in_children(self)
        self.port = server.getsockname()[1]
        self.address = self._url()
        inet.warn_if_reachable(self.address, where[0])

    def close(self) -> None:
        """Stop listening and drop the client."""
        self._drop_client()
        if self._server is not None:
            self._server.close()
            self._server = None

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the server's socket and the client's."""
        if self._held:
            return []
        return [each.fileno() for each in (self._server, self._client if reading else None) if each is not None]

    # -- events ------------------------------------------------------------------------------------------------------

    def poll(self, reading: bool = True) -> list[Event]:
        """Clients that come and go, and their bytes."""
        events: list[Event] = []
        if self._held:
            return events
        if self._client is not None:
            events += self._read(self._client, reading)
        for _ in range(_BACKLOG):
            if (client := self._accept()) is None:
                break
            if self._client is not None:
                client.close()  # taken
                continue
            self._client = client
            events += [Opened(), *self._on_connect()]
            events += self._read(client, reading)
        return events

    def _accept(self) -> socket.socket | None:
        if self._server is None:
            return None
        try:
            client, _ = self._server.accept()
        except OSError:  # nobody there, or already gone
            return None
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        return client

    def _read(self, client: socket.socket, reading: bool) -> list[Event]:
        events: list[Event] = []
        gone = _has_gone(client)
        room = MAX_CHUNK_BYTES if reading else MAX_LEFTOVER_BYTES if gone else 0
        while room > 0 and (chunk := _received(client, min(room, MAX_CHUNK_BYTES))):
            events += self._decode(chunk)
            room -= len(chunk)
        if gone and self._client is client and (room > 0 or not reading):
            self._drop_client()
            events += [Closed(), *self._on_disconnect()]
        self._push()
        return events

    def _drop_client(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client, self._unsent = None, b""

    def hang_up(self, code: int) -> None:
        """Close the connection; the next look finds the client gone."""
        if self._client is not None:
            with contextlib.suppress(OSError):  # gone by itself
                self._client.shutdown(socket.SHUT_RDWR)

    def hold(self, held: bool) -> None:
        """Neither read nor notice anything while held."""
        self._held = held

    # -- bytes out ---------------------------------------------------------------------------------------------------

    def write(self, frame: WireFrame) -> bool:
        """Send one frame; ``False`` when nobody is connected or the client does not read."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a TCP connection cannot carry the CAN frame {frame}")
        if not self.has_reader or not self._push():
            return False
        self._unsent = self._encode(frame)
        before = len(self._unsent)
        self._push()
        if len(self._unsent) == before:  # nothing went: drop it whole
            self._unsent = b""
            return False
        return True

    def _push(self) -> bool:
        """Send what is left over; whether all is gone."""
        if self._client is not None and self._unsent:
            try:
                self._unsent = self._unsent[self._client.send(self._unsent) :]
            except OSError:  # full, or gone: the next read tells
                pass
        return not self._unsent

    @property
    def has_reader(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    def _url(self) -> str:
        return f"{self.url}://{inet.join(self.host, self.port)}"

    # -- the protocol around the bytes: none ---------------------------------------------------------------------------

    def _on_connect(self) -> list[Event]:
        """A client has connected: what that does to the port."""
        return [RAISED]

    def _on_disconnect(self) -> list[Event]:
        """A client has gone: what that does to the port."""
        return [DROPPED]

    def _decode(self, chunk: bytes) -> list[Event]:
        return [Received(chunk)]

    def _encode(self, frame: bytes) -> bytes:
        return frame


def _has_gone(client: socket.socket) -> bool:
    """Whether a client has closed its end, whatever of it still waits to be read."""
    poll = select.poll()
    poll.register(client, select.POLLRDHUP)
    return bool(poll.poll(0))


def _received(client: socket.socket, most: int) -> bytes:
    """At most so many bytes, or nothing: the client has sent nothing, or has gone."""
    try:
        return client.recv(most)
    except OSError:
        return b""
