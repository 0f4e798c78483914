"""A frame as text and back: hex for bytes, ``candump`` notation for CAN. Truth logs and recordings write it.

An error frame stands as it does on the bus and as ``candump -L`` shows it: the error's class with the error flag in
place of an identifier (``20000008#0000000000000000``); which frame it disturbed, nobody on the bus can tell.
"""

from __future__ import annotations

from firmware_protocols import CanFrame, Frame
from firmware_protocols.frames import FD_LENGTHS, frame_of, text_of

PROTOCOL_ERROR = 0x8
"""How SocketCAN tells a program of a disturbed frame: the class of the error in place of the identifier."""
_ERROR_FLAG, _ID_BITS, _STANDARD_IDS = 0x2000_0000, 0x1FFF_FFFF, 0x7FF
_FD_FLAG = 4
"""Flag of an FD frame that says that it is one. Linux sets it since 6.1, so that `candump` shows 5 and 4 in place of 1
and 0, which the reader takes too."""
_ERROR_DATA = "00" * 8


def text(frame: Frame) -> str:
    """Return the frame as logs write it."""
    if isinstance(frame, CanFrame) and frame.is_error_frame:
        return f"{_ERROR_FLAG | on_the_bus(frame).arbitration_id:08X}#{_ERROR_DATA}"
    if isinstance(frame, CanFrame) and frame.is_fd:
        ident, _, data = str(frame).partition("##")
        return f"{ident}##{_FD_FLAG | frame.bitrate_switch:X}{data[1:]}"
    return text_of(frame)


def on_the_bus(frame: CanFrame) -> CanFrame:
    """Return the frame as others on the bus see it: an error frame does not say which one it disturbed."""
    return CanFrame(arbitration_id=PROTOCOL_ERROR, is_error_frame=True) if frame.is_error_frame else frame


def parse(data: str) -> Frame:
    """Return the frame that a text stands for.

    Raises:
        ValueError: it stands for none, or for one that no bus carries.
    """
    ident, mark, rest = data.partition("#")
    if mark and len(ident) == 8 and int(ident, 16) & _ERROR_FLAG and int(ident, 16) <= _ERROR_FLAG | _ID_BITS:
        return CanFrame(arbitration_id=int(ident, 16) & _ID_BITS, is_error_frame=True)
    frame = frame_of(f"{ident}#R" if rest[:1] == "R" else data)  # candump adds the length that was asked for
    return checked(frame) if isinstance(frame, CanFrame) else frame


def checked(frame: CanFrame) -> CanFrame:
    """Return the frame, if a bus can carry it.

    Raises:
        ValueError: its identifier or its length does not exist.
    """
    most = _ID_BITS if frame.is_extended_id else _STANDARD_IDS
    if not 0 <= frame.arbitration_id <= most:
        raise ValueError(f"CAN id {frame.arbitration_id:#x} is beyond {'29' if frame.is_extended_id else '11'} bits")
    if frame.is_fd and len(frame.data) not in FD_LENGTHS:
        raise ValueError(f"a CAN-FD frame cannot have {len(frame.data)} bytes")
    if not frame.is_fd and len(frame.data) > 8:
        raise ValueError(f"a classic CAN frame has at most 8 bytes, this one {len(frame.data)}")
    return frame
