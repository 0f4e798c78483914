"""``tcp:HOST:PORT``: a raw TCP server, for pyserial's ``socket://HOST:PORT`` and for devices with TCP protocols.

It has one client at a time, as a port: others are refused until the first has gone. ``tcp:PORT`` listens on loopback
only; name an address (``tcp:0.0.0.0:5000``) to be reached from other machines. Port 0 takes a free one.
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

_SEND_BUFFER_BYTES = 16_384
"""Size of the kernel's buffer for a client that does not read [byte]; about that of a serial port."""
_RECEIVE_BUFFER_BYTES = 16_384
"""Size of the kernel's buffer for what a client sends while the line is busy [byte]."""
_BACKLOG = 16
"""Maximum number of clients that wait to be accepted; a refused one retries only after a second."""


class TcpTransport(Transport):
    """A server for one client. A serial device behind it is a port of a terminal server without settings."""

    scheme = "tcp"
    url = "socket"
    """The scheme of the URL with which pyserial opens the port."""

    def __init__(self, location: str):
        self.host, self.port = inet.parse(self.scheme, location)
        self.address = self._url()
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._unsent = b""
        """Bytes of a frame, or of the protocol around it, that the kernel has not taken yet; they are sent first."""
        self._held = False

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Bind and listen.

        Raises:
            TransportError: the address is not of this machine, or the port is taken or not allowed.
        """
        if self._server is not None:
            return
        try:
            family, where = inet.resolve(self.host, self.port, socket.SOCK_STREAM)
            server = socket.create_server(where, family=family, backlog=_BACKLOG)
        except OSError as error:
            raise inet.cannot_listen(self.scheme, self.host, self.port, error) from None
        server.setblocking(False)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)  # clients inherit it
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
        """Return clients that come and go, and their bytes."""
        events: list[Event] = []
        if self._held:
            return events
        if self._client is not None:
            events += self._read(self._client, reading)
        for _ in range(_BACKLOG):
            if (client := self._accept()) is None:
                break
            if self._client is not None:
                client.close()  # the port has a client already
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
        except OSError:  # no client waits, or it has gone already
            return None
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
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
        """Close the connection; the next poll reports it."""
        if self._client is not None:
            with contextlib.suppress(OSError):  # the client has closed it already
                self._client.shutdown(socket.SHUT_RDWR)

    def hold(self, held: bool) -> None:
        """Neither read nor notice anything while held."""
        self._held = held

    # -- bytes out ---------------------------------------------------------------------------------------------------

    def write(self, frame: WireFrame) -> bool:
        """Send one frame; ``False`` when no client is connected or it does not read."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a TCP connection cannot carry the CAN frame {frame}")
        if not self.has_reader or not self._push():
            return False
        self._unsent = self._encode(frame)
        before = len(self._unsent)
        self._push()
        if len(self._unsent) == before:  # nothing was sent: drop the frame
            self._unsent = b""
            return False
        return True

    def _push(self) -> bool:
        """Send the bytes that are left over, and return True if none remain."""
        if self._client is not None and self._unsent:
            try:
                self._unsent = self._unsent[self._client.send(self._unsent) :]
            except OSError:  # the buffer is full, or the client has gone, which the next read reports
                pass
        return not self._unsent

    @property
    def has_reader(self) -> bool:
        """True while a client is connected."""
        return self._client is not None

    def _url(self) -> str:
        return f"{self.url}://{inet.join(self.host, self.port)}"

    # -- the protocol around the bytes: none ---------------------------------------------------------------------------

    def _on_connect(self) -> list[Event]:
        """Return the events at the port when a client has connected."""
        return [RAISED]

    def _on_disconnect(self) -> list[Event]:
        """Return the events at the port when a client has gone."""
        return [DROPPED]

    def _decode(self, chunk: bytes) -> list[Event]:
        return [Received(chunk)]

    def _encode(self, frame: bytes) -> bytes:
        return frame


def _has_gone(client: socket.socket) -> bool:
    """Return True if a client has closed its end, even if its data still wait to be read."""
    poll = select.poll()
    poll.register(client, select.POLLRDHUP)
    return bool(poll.poll(0))


def _received(client: socket.socket, most: int) -> bytes:
    """Return at most ``most`` bytes; none if the client has sent none, or has gone."""
    try:
        return client.recv(most)
    except OSError:
        return b""
