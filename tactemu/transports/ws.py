"""``ws:HOST:PORT``: a WebSocket server, for devices that send messages. A frame is one text message.

It has one client at a time, with any path, on loopback unless an address is named, as ``tcp:``. The library
``websockets`` implements the protocol, with pings and the closing handshake, but not the sockets.
"""

from __future__ import annotations

from websockets.exceptions import ProtocolError
from websockets.frames import CTRL_OPCODES
from websockets.frames import Frame as Fragment
from websockets.http11 import Request
from websockets.protocol import OPEN
from websockets.server import ServerProtocol

from tactemu.transports.tcp import TcpTransport
from tactemu.transports.transport import DROPPED, RAISED, Closed, Event, Part, Received

_MAX_MESSAGE_BYTES = 16_384
"""Maximum size of a client's message [byte]; a longer one closes the connection."""
_MAX_UNSENT_BYTES = 65_536
"""Maximum size of the answers that wait for a client that does not read [byte]; further answers are lost."""


class WebSocketTransport(TcpTransport):
    """A WebSocket server for one client, which counts from its handshake on."""

    scheme = url = "ws"

    def __init__(self, location: str):
        super().__init__(location)
        self._protocol = ServerProtocol(max_size=_MAX_MESSAGE_BYTES)
        """The protocol state of the connected client."""
        self._has_shaken_hands = False
        """True once the client has completed the handshake."""
        self._message = b""
        """The fragments of an incomplete message."""

    @property
    def has_reader(self) -> bool:
        """True from a client's handshake until it begins to close."""
        return self._client is not None and self._protocol.state is OPEN

    def hang_up(self, code: int) -> None:
        """Close the connection with a code; for one that must not be sent (1005, 1006, 1015), without a close frame."""
        if not self.has_reader:
            return
        try:
            self._protocol.send_close(code)
        except ProtocolError:
            super().hang_up(code)
        self._answer()
        self._push()

    def _on_connect(self) -> list[Event]:
        self._protocol, self._has_shaken_hands, self._message = ServerProtocol(max_size=_MAX_MESSAGE_BYTES), False, b""
        return []

    def _on_disconnect(self) -> list[Event]:
        return [DROPPED] if self._has_shaken_hands else []

    def _decode(self, chunk: bytes) -> list[Event]:
        """Return what the client sent; a client with a bad handshake or a close frame is dropped."""
        events: list[Event] = []
        self._protocol.receive_data(chunk)
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._protocol.send_response(self._protocol.accept(event))
                self._has_shaken_hands = self._protocol.state is OPEN
                events += [RAISED] if self._has_shaken_hands else []
            elif isinstance(event, Fragment) and event.opcode not in CTRL_OPCODES:
                events += self._put_together(event)
        if self._answer():
            self._push()
            self._drop_client()
            events += [Closed(), *self._on_disconnect()]
        return events

    def _put_together(self, fragment: Fragment) -> list[Event]:
        self._message += bytes(fragment.data)
        if not fragment.fin:
            return []
        message, self._message = self._message, b""
        return [Received(message)] if message else []

    def _answer(self) -> bool:
        """Queue the protocol's own answers to the client, and return True if they end the connection."""
        data = self._protocol.data_to_send()
        if len(self._unsent) < _MAX_UNSENT_BYTES:
            self._unsent += b"".join(data)
        return b"" in data

    def _encode(self, frame: bytes) -> bytes:
        send = (
            self._protocol.send_continuation if self._protocol.expect_continuation_frame else self._protocol.send_text
        )
        send(frame, fin=not isinstance(frame, Part))
        return b"".join(self._protocol.data_to_send())
