"""``rfc2217:HOST:PORT``: a serial port over the network with its speed, format and modem lines (RFC 2217).

A driver opens ``serial.serial_for_url("rfc2217://HOST:PORT")``. Unlike a pseudo terminal this port has byte size,
parity, DTR and RTS, and reports CTS and DSR as raised. The protocol is implemented by pyserial's server side.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

from serial import rfc2217

from tactemu.transports.tcp import TcpTransport
from tactemu.transports.transport import DROPPED, Event, Received, SerialSetting, SettingChanged

_IAC = b"\xff"
_MAX_OPTION_BYTES = 64
"""Maximum length of a telnet option [byte]; those of RFC 2217 that a client sends are shorter, except a signature."""
_MAX_UNSENT_BYTES = 65_536
"""Maximum size of the answers that wait for a client that does not read [byte]; further answers are lost."""


def _entry(name: str, usual: Any) -> Any:
    """Return a property for an entry of a port's :class:`SerialSetting`; ``usual`` until the client has set it."""

    def get(port: _Port) -> Any:
        value = getattr(port.setting, name)
        return usual if value is None else value

    def put(port: _Port, value: Any) -> None:
        before, port.setting = port.setting, replace(port.setting, **{name: value})
        if port.setting != before:
            port.changes.append(SettingChanged(port.setting))

    return property(get, put)


def _line(name: str) -> Any:
    """Return a property for a modem line of a port, which the client may set."""

    def put(port: _Port, value: bool) -> None:
        port.lines = replace(port.lines, **{name: value})
        port.changes.append(port.lines)

    return property(lambda port: getattr(port.lines, name), put)


class _Port:
    """A stand-in for the serial port that pyserial's ``PortManager`` manages; it records what is set."""

    cts = dsr = cd = True
    ri = False
    xonxoff = rtscts = break_condition = False
    baudrate, bytesize = _entry("baud", 9600), _entry("bytesize", 8)
    parity, stopbits = _entry("parity", "N"), _entry("stopbits", 1)
    dtr, rts = _line("dtr"), _line("rts")

    def __init__(self):
        self.changes: list[Event] = []
        self.setting = SerialSetting()
        self.lines = DROPPED

    def reset_input_buffer(self) -> None:
        """Do nothing: sent data are already with the client."""

    def reset_output_buffer(self) -> None:
        """Do nothing: the client's bytes are passed on at once."""


class _Answers:
    """The file to which ``PortManager`` writes its answers to the client."""

    def __init__(self, transport: Rfc2217Transport):
        self._transport = transport

    def write(self, data: bytes) -> None:
        self._transport.answer(data)


class Rfc2217Transport(TcpTransport):
    """A network serial port for one client."""

    scheme = url = "rfc2217"

    def __init__(self, location: str):
        super().__init__(location)
        self._port = _Port()
        self._protocol: rfc2217.PortManager | None = None

    @property
    def setting(self) -> SerialSetting | None:
        """The settings that the client has chosen; others are ``None``."""
        return self._port.setting

    def answer(self, data: bytes) -> None:
        """Queue telnet bytes for the client; all answers of one poll leave together."""
        if len(self._unsent) < _MAX_UNSENT_BYTES:
            self._unsent += data

    def _on_connect(self) -> list[Event]:
        self._port = _Port()
        self._protocol = rfc2217.PortManager(self._port, _Answers(self))  # pyright: ignore[reportArgumentType]
        return []

    def _on_disconnect(self) -> list[Event]:
        return [DROPPED] if self._port.lines != DROPPED else []

    def _decode(self, chunk: bytes) -> list[Event]:
        """Return data and settings in their order; only bytes of the protocol pass the filter one by one."""
        assert self._protocol is not None
        events: list[Event] = []
        data = bytearray()
        at = 0
        while at < len(chunk):
            if self._protocol.mode == rfc2217.M_NORMAL and self._protocol.suboption is None:
                special = chunk.find(_IAC, at)
                end = special if special >= 0 else len(chunk)
                data += chunk[at:end]
                at = end
            data += self._feed(chunk[at : at + 1])
            at += 1
            if self._port.changes:
                events += [Received(bytes(data))] if data else []
                events += self._port.changes
                self._port.changes.clear()
                data.clear()
        return events + ([Received(bytes(data))] if data else [])

    def _feed(self, byte: bytes) -> bytes:
        """Return the data that one byte yields in the telnet filter; malformed options are ignored."""
        assert self._protocol is not None
        try:
            data = b"".join(self._protocol.filter(byte))
            if len(self._protocol.suboption or b"") <= _MAX_OPTION_BYTES:
                return data
        except (struct.error, ValueError, KeyError, TypeError):
            data = b""
        self._protocol.mode, self._protocol.suboption = rfc2217.M_NORMAL, None
        return data

    def _encode(self, frame: bytes) -> bytes:
        return frame.replace(_IAC, _IAC + _IAC)
