"""``slcan:PATH``: a CAN adapter on a serial port that speaks Lawicel's ASCII protocol, on a pseudo terminal.

A driver opens it as ``can.Bus(interface="slcan", channel=PATH)``, or hands it to the kernel with ``slcand``. Frames
pass while the channel is open, and only if the adapter was set to the bit rate of the bus, or to none.
"""

from __future__ import annotations

from collections import Counter

from firmware_protocols import Can, CanFrame, Connector, WireFrame
from firmware_protocols.frames import FD_LENGTHS
from firmware_protocols.framing import Lines
from tactemu.base.errors import TransportError
from tactemu.transports.pty import PtyTransport
from tactemu.transports.transport import Closed, Event, Received

OK, BAD = b"\r", b"\a"
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Of ``S0`` to ``S8``."""
FRAME_LETTERS = {"t": (3, False, False), "d": (3, True, False), "b": (3, True, True)}
"""Digits of the identifier, FD, bit rate switch, by the letter of a frame; in upper case the identifier is extended."""
ANSWERS = {b"V": b"V1013\r", b"v": b"v1013\r", b"N": b"N0001\r", b"F": b"F00\r"}
"""Version, serial number, status."""
SETTINGS = b"sYMmZXUWPA"
"""Letters of settings that are taken and change nothing."""
_LONGEST = 160
"""Of a line [byte]: an FD frame has 138."""


class SlcanTransport(PtyTransport):
    """The adapter. On the bus while a driver has the port and the channel open."""

    scheme = "slcan"

    def __init__(self, rest: str):
        super().__init__(rest)
        self._bus = 0
        """Bit rate of the bus; 0: any will do."""
        self._power_up()

    def _power_up(self) -> None:
        self._cutter = Lines(OK, counters=Counter(), longest=_LONGEST)
        self._joined, self._may_send, self._bitrate = False, False, 0

    def set_connector(self, connector: Connector) -> None:
        """Learn the bit rate of the bus."""
        self._bus = connector.bitrate if isinstance(connector, Can) else 0

    @property
    def has_reader(self) -> bool:
        """Whether the driver has opened the channel, at the bus's bit rate."""
        return super().has_reader and self._joined and self._has_bus_bitrate

    @property
    def _has_bus_bitrate(self) -> bool:
        return not self._bus or self._bitrate in (0, self._bus)

    def poll(self, reading: bool = True) -> list[Event]:
        """Return the driver's frames. A bus has no open and close: who is not there hears nothing."""
        events: list[Event] = []
        for event in super().poll(reading):
            if isinstance(event, Received) and isinstance(event.data, bytes):
                for line in self._cutter.cut(event.data):
                    events += self._execute(line)
            elif isinstance(event, Closed):
                self._power_up()
        return events

    def _execute(self, line: bytes) -> list[Event]:
        order, rest = line[:1], line[1:]
        answer, frame = OK, None
        if order in b"OL":
            self._joined, self._may_send = True, order == b"O"
        elif order == b"C":
            self._joined = False
        elif order == b"S" and rest.isdigit() and int(rest) < len(BITRATES) and not self._joined:
            self._bitrate = BITRATES[int(rest)]
        elif line in ANSWERS:
            answer = ANSWERS[line]
        elif (frame := frame_of(line)) is not None and self._may_send and self._joined:
            answer = b"Z\r" if frame.is_extended_id else b"z\r"
        elif order not in SETTINGS:
            answer, frame = BAD, None
        super().write(answer)
        return [Received(frame)] if frame is not None and self._has_bus_bitrate else []

    def write(self, frame: WireFrame) -> bool:
        """Write one frame as a line; ``False`` when the channel is closed or the driver does not read."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        return self.has_reader and (frame.is_error_frame or super().write(line_of(frame)))


def line_of(frame: CanFrame) -> bytes:
    """``t7108...``: letter, identifier, length, data."""
    letter = "r" if frame.is_remote_frame else "b" if frame.bitrate_switch else "d" if frame.is_fd else "t"
    head = (
        f"{letter.upper()}{frame.arbitration_id:08X}" if frame.is_extended_id else f"{letter}{frame.arbitration_id:03X}"
    )
    return f"{head}{FD_LENGTHS.index(len(frame.data)):X}{frame.data.hex().upper()}\r".encode("ascii")


def frame_of(line: bytes) -> CanFrame | None:
    """Return the frame that a line is; ``None``: it is none."""
    letter = line[:1].decode("latin-1")
    remote, extended = letter in "rR", letter.isupper()
    if not letter or (not remote and letter.lower() not in FRAME_LETTERS):
        return None
    digits, fd, switch = FRAME_LETTERS["t" if remote else letter.lower()]
    digits = 8 if extended else digits
    try:
        ident, code = int(line[1 : 1 + digits], 16), int(line[1 + digits : 2 + digits], 16)
        data = bytes.fromhex(line[2 + digits :].decode("ascii"))
    except ValueError:
        return None
    length = FD_LENGTHS[code] if fd else code
    if ident >> (29 if extended else 11) or length > (64 if fd else 8) or len(data) != (0 if remote else length):
        return None
    return CanFrame(
        arbitration_id=ident,
        data=data,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=switch,
    )
