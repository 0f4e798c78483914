"""``rfc2217:HOST:PORT``: a serial port over the network with its speed, format and modem lines (RFC 2217).

A driver opens ``serial.serial_for_url("rfc2217://HOST:PORT")``. Unlike a pseudo terminal this port has DTR and RTS, and
answers with CTS and DSR raised. The protocol is pyserial's own server side.
"""

from __future__ import annotations

import struct

from serial import rfc2217

from tactemu.transports.tcp import TcpTransport
from tactemu.transports.transport import BaudChanged, Event, LinesChanged, Received

_IAC = b"\xff"


class _Port:
    """The serial port that pyserial's ``PortManager`` believes to manage; notes what is set."""

    cts = dsr = cd = True
    ri = False
    bytesize, parity, stopbits = 8, "N", 1
    xonxoff = rtscts = break_condition = False

    def __init__(self):
        self.changes: list[Event] = []
        self._baud: int | None = None
        self._dtr = self._rts = False

    @property
    def baudrate(self) -> int:
        return self._baud or 9600

    @baudrate.setter
    def baudrate(self, value: int) -> None:
        if value != self._baud:
            self._baud = value
            self.changes.append(BaudChanged(value))

    @property
    def dtr(self) -> bool:
        return self._dtr

    @dtr.setter
    def dtr(self, value: bool) -> None:
        self._dtr = value
        self.changes.append(LinesChanged(self._dtr, self._rts))

    @property
    def rts(self) -> bool:
        return self._rts

    @rts.setter
    def rts(self, value: bool) -> None:
        self._rts = value
        self.changes.append(LinesChanged(self._dtr, self._rts))

    def reset_input_buffer(self) -> None:
        """Nothing to do: what has left is at the client."""

    def reset_output_buffer(self) -> None:
        """Nothing to do: the client's bytes are handed on at once."""


class _Answers:
    """Where ``PortManager`` writes what it has to say to the client."""

    def __init__(self, transport: Rfc2217Transport):
        self._transport = transport

    def write(self, data: bytes) -> None:
        self._transport.answer(data)


class Rfc2217Transport(TcpTransport):
    """A network serial port for one client."""

    scheme = "rfc2217"
    kinds = ("serial",)

    def __init__(self, rest: str):
        super().__init__(rest)
        self._settings = _Port()
        self._protocol: rfc2217.PortManager | None = None

    @property
    def baud(self) -> int | None:
        """The speed that the client set [bit/s]; ``None`` until it does."""
        return self._settings._baud

    def answer(self, data: bytes) -> None:
        """Queue telnet bytes for the client."""
        self._unsent += data
        self._push()

    def _greet(self) -> None:
        self._settings = _Port()
        self._protocol = rfc2217.PortManager(self._settings, _Answers(self))  # pyright: ignore[reportArgumentType]

    def _decode(self, chunk: bytes) -> list[Event]:
        assert self._protocol is not None
        events: list[Event] = []
        data = bytearray()
        for value in chunk:
            data += self._feed(bytes([value]))
            if self._settings.changes:  # keep the order of data and settings
                events += [Received(bytes(data))] if data else []
                events += self._settings.changes
                self._settings.changes.clear()
                data.clear()
        return events + ([Received(bytes(data))] if data else [])

    def _feed(self, byte: bytes) -> bytes:
        """One byte through the telnet filter. Malformed options are the client's fault: forgotten."""
        assert self._protocol is not None
        try:
            return b"".join(self._protocol.filter(byte))
        except (struct.error, ValueError, KeyError, TypeError):
            self._protocol.mode, self._protocol.suboption = rfc2217.M_NORMAL, None
            return b""

    def _encode(self, frame: bytes) -> bytes:
        return frame.replace(_IAC, _IAC + _IAC)
