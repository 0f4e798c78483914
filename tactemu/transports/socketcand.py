"""``socketcand:HOST:PORT``: a CAN bus behind a network daemon, as ``socketcand`` serves one in raw mode.

A driver opens it as ``can.Bus(interface="socketcand", host=HOST, port=PORT, channel="can0")``, with any channel name.
It has one client at a time, on loopback unless an address is named, as ``tcp:``. Classic CAN only.
"""

from __future__ import annotations

import re
import time

from firmware_protocols import CanFrame, WireFrame
from tactemu.base.errors import TransportError
from tactemu.transports.tcp import TcpTransport
from tactemu.transports.transport import Event, Received

_MESSAGE = re.compile(rb"<\s*([^<>]*?)\s*>")
_MAX_MESSAGE_BYTES = 200
"""Maximum length of a message [byte]; of a longer one, only the end is kept."""
_MAX_UNSENT_BYTES = 65_536
"""Maximum size of the answers that wait for a client that does not read [byte]; further answers are lost."""


class SocketcandTransport(TcpTransport):
    """A socketcand daemon. It is on the bus while a client is in raw mode."""

    scheme = url = "socketcand"

    def __init__(self, location: str):
        super().__init__(location)
        self._half = b""
        self._opened = self._raw = False

    @property
    def has_reader(self) -> bool:
        """True while a client is in raw mode."""
        return super().has_reader and self._raw

    def write(self, frame: WireFrame) -> bool:
        """Send one frame; ``False`` without a client, and for FD, remote and error frames, which the protocol lacks."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        if frame.is_fd or frame.is_remote_frame or frame.is_error_frame:
            return False
        ident = f"{frame.arbitration_id:08X}" if frame.is_extended_id else f"{frame.arbitration_id:03X}"
        return super().write(f"< frame {ident} {time.time():.6f} {frame.data.hex().upper()} >".encode("ascii"))

    def poll(self, reading: bool = True) -> list[Event]:
        """Return the client's frames, without openings and closings, which a bus does not have."""
        return [event for event in super().poll(reading) if isinstance(event, Received)]

    def _on_connect(self) -> list[Event]:
        self._half, self._opened, self._raw = b"", False, False
        self._say(b"hi")
        return []

    def _on_disconnect(self) -> list[Event]:
        return []

    def _decode(self, chunk: bytes) -> list[Event]:
        events: list[Event] = []
        received, end = self._half + chunk, 0
        for message in _MESSAGE.finditer(received):
            end = message.end()
            events += self._execute(message[1].split())
        self._half = received[end:][-_MAX_MESSAGE_BYTES:]
        return events

    def _execute(self, words: list[bytes]) -> list[Event]:
        match words:
            case [b"open", _] if not self._opened:
                self._opened = True
                self._say(b"ok")
            case [b"rawmode"] if self._opened:
                self._raw = True
                self._say(b"ok")
            case [b"echo"]:
                self._say(b"echo")
            case [b"send", ident, length, *data] if self._raw:
                frame = frame_of(ident, length, data)
                if frame is None:
                    self._say(b"error invalid frame")
                return [] if frame is None else [Received(frame)]
            case _:
                self._say(b"error unknown command")
        return []

    def _say(self, words: bytes) -> None:
        if len(self._unsent) < _MAX_UNSENT_BYTES:
            self._unsent += b"< " + words + b" >"


def frame_of(ident: bytes, length: bytes, data: list[bytes]) -> CanFrame | None:
    """Return the frame of ``< send 123 2 11 22 >``; an identifier of more than three digits is extended."""
    extended = len(ident) > 3
    try:
        number, values = int(ident, 16), bytes(int(each, 16) for each in data)
        fits = int(length, 16) == len(values) <= 8 and 0 <= number < 1 << (29 if extended else 11)
    except ValueError:
        return None
    return CanFrame(arbitration_id=number, data=values, is_extended_id=extended) if fits else None
