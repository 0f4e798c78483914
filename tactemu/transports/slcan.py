"""``slcan:PATH``: a CAN adapter with Lawicel's ASCII protocol, on a pseudo terminal.

A driver opens it as ``can.Bus(interface="slcan", channel=PATH)``, or attaches it to the kernel with ``slcand``. Frames
pass while the channel is open, and only if the adapter is set to the bit rate of the bus, or to none.
"""

from __future__ import annotations

from collections import Counter

from firmware_protocols import Can, CanFrame, Connector, WireFrame
from firmware_protocols.frames import FD_LENGTHS
from firmware_protocols.stuffing import Lines
from tactemu.base.errors import TransportError
from tactemu.transports.pty import PtyTransport
from tactemu.transports.transport import Closed, Event, Received

OK = b"\r"
"""The answer to a valid command."""
BAD = b"\a"
"""The answer to an invalid command."""
BITRATES_BPS = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Bit rates of the commands ``S0`` to ``S8`` [bit/s]."""
FRAME_LETTERS = {"t": (3, False, False), "d": (3, True, False), "b": (3, True, True)}
"""Digits of the identifier, FD and bit rate switch by the letter of a frame; upper case: extended identifier."""
ANSWERS = {b"V": b"V1013\r", b"v": b"v1013\r", b"N": b"N0001\r", b"F": b"F00\r"}
"""Answers to the requests for version, serial number and status."""
SETTINGS = b"sYMmZXUWPA"
"""Letters of settings that are accepted and change nothing."""
_MAX_LINE_BYTES = 160
"""Maximum length of a line [byte]; an FD frame has 138."""


class SlcanTransport(PtyTransport):
    """A serial CAN adapter. It is on the bus while a driver has the port and the channel open."""

    scheme = "slcan"

    def __init__(self, location: str):
        super().__init__(location)
        self._bus = 0
        """The bit rate of the bus [bit/s]; 0: any."""
        self._power_up()

    def _power_up(self) -> None:
        self._cutter = Lines(OK, counters=Counter(), longest=_MAX_LINE_BYTES)
        self._joined, self._may_send, self._bitrate = False, False, 0

    def set_connector(self, connector: Connector) -> None:
        """Take over the bit rate of the bus from the connector."""
        self._bus = connector.bitrate if isinstance(connector, Can) else 0

    @property
    def has_reader(self) -> bool:
        """True while the driver has the channel open at the bus's bit rate."""
        return super().has_reader and self._joined and self._has_bus_bitrate

    @property
    def _has_bus_bitrate(self) -> bool:
        return not self._bus or self._bitrate in (0, self._bus)

    def poll(self, reading: bool = True) -> list[Event]:
        """Return the driver's frames, without openings and closings, which a bus does not have."""
        events: list[Event] = []
        for event in super().poll(reading):
            if isinstance(event, Received) and isinstance(event.data, bytes):
                for line in self._cutter.cut(event.data):
                    events += self._execute(line)
            elif isinstance(event, Closed):
                self._power_up()
        return events

    def _execute(self, line: bytes) -> list[Event]:
        order, argument = line[:1], line[1:]
        answer, frame = OK, None
        if order in b"OL":
            self._joined, self._may_send = True, order == b"O"
        elif order == b"C":
            self._joined = False
        elif order == b"S" and argument.isdigit() and int(argument) < len(BITRATES_BPS) and not self._joined:
            self._bitrate = BITRATES_BPS[int(argument)]
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
    """Return the line of a frame, such as ``t7108...``: letter, identifier, length, data."""
    letter = "r" if frame.is_remote_frame else "b" if frame.bitrate_switch else "d" if frame.is_fd else "t"
    head = (
        f"{letter.upper()}{frame.arbitration_id:08X}" if frame.is_extended_id else f"{letter}{frame.arbitration_id:03X}"
    )
    return f"{head}{FD_LENGTHS.index(len(frame.data)):X}{frame.data.hex().upper()}\r".encode("ascii")


def frame_of(line: bytes) -> CanFrame | None:
    """Return the frame of a line, or None if the line is no frame."""
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
