"""``ws:HOST:PORT``: a WebSocket server, for devices that speak in messages. A frame is one text message.

One client at a time, on loopback unless an address is named, as for ``tcp:``. Any path will do. The protocol is that of
``websockets``, without its sockets; pings and the closing handshake are its own.
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

_LARGEST = 16_384
"""Of a message of the client [byte]; a longer one closes the connection."""
_UNSENT_LIMIT = 65_536
"""Answers to pings that wait for a client that does not read [byte]; those beyond are lost."""


class WebSocketTransport(TcpTransport):
    """A server for one client, which is there once it has shaken hands."""

    scheme = url = "ws"

    def __init__(self, rest: str):
        super().__init__(rest)
        self._protocol = ServerProtocol(max_size=_LARGEST)
        """Of the client that is connected."""
        self._has_shaken_hands = False
        """Whether it has shaken hands."""
        self._message = b""
        """Fragments of one that is not whole."""

    @property
    def has_reader(self) -> bool:
        """Whether a client has shaken hands, and not begun to leave."""
        return self._client is not None and self._protocol.state is OPEN

    def hang_up(self, code: int) -> None:
        """Close the connection with a code; one that must not be sent (1005, 1006, 1015) closes it without a word."""
        if not self.has_reader:
            return
        try:
            self._protocol.send_close(code)
        except ProtocolError:
            super().hang_up(code)
        self._answer()
        self._push()

    def _on_connect(self) -> list[Event]:
        self._protocol, self._has_shaken_hands, self._message = ServerProtocol(max_size=_LARGEST), False, b""
        return []

    def _on_disconnect(self) -> list[Event]:
        return [DROPPED] if self._has_shaken_hands else []

    def _decode(self, chunk: bytes) -> list[Event]:
        """What the client sent. One that shakes no hands, or has said that it leaves, is dropped."""
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
        """Queue what the protocol itself has to say to the client; whether that was its last word."""
        data = self._protocol.data_to_send()
        if len(self._unsent) < _UNSENT_LIMIT:
            self._unsent += b"".join(data)
        return b"" in data

    def _encode(self, frame: bytes) -> bytes:
        send = (
            self._protocol.send_continuation if self._protocol.expect_continuation_frame else self._protocol.send_text
        )
        send(frame, fin=not isinstance(frame, Part))
        return b"".join(self._protocol.data_to_send())
