"""The text of a frame in truth logs and recordings: hex for bytes, ``candump`` notation for CAN.

An error frame has the text of ``candump -L``: the error's class with the error flag in place of an identifier
(``20000008#0000000000000000``). Which frame it disturbed is not visible on the bus.
"""

from __future__ import annotations

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import FD_LENGTHS, frame_of, text_of

PROTOCOL_ERROR = 0x8
"""Error class of a disturbed frame in SocketCAN (``CAN_ERR_PROT``), which stands in place of the identifier."""
_ERROR_FLAG = 0x2000_0000
_ID_MASK = 0x1FFF_FFFF
_MAX_STANDARD_ID = 0x7FF
_FD_FLAG = 4
"""Flag of a CAN-FD frame (``CANFD_FDF``). Linux sets it since 6.1, so that `candump` shows 5 and 4 in place of 1 and
0; the reader accepts both."""
_ERROR_DATA = "00" * 8


def text(frame: WireFrame) -> str:
    """Return the text of a frame in a log."""
    if isinstance(frame, CanFrame) and frame.is_error_frame:
        return f"{_ERROR_FLAG | on_the_bus(frame).arbitration_id:08X}#{_ERROR_DATA}"
    if isinstance(frame, CanFrame) and frame.is_fd:
        ident, _, data = str(frame).partition("##")
        return f"{ident}##{_FD_FLAG | frame.bitrate_switch:X}{data[1:]}"
    return text_of(frame)


def on_the_bus(frame: CanFrame) -> CanFrame:
    """Return the frame as other nodes of the bus receive it: an error frame does not name the frame it disturbed."""
    return CanFrame(arbitration_id=PROTOCOL_ERROR, is_error_frame=True) if frame.is_error_frame else frame


def parse(data: str) -> WireFrame:
    """Return the frame of a text.

    Raises:
        ValueError: the text is no frame, or one that no bus can carry.
    """
    ident, mark, payload = data.partition("#")
    if mark and len(ident) == 8 and int(ident, 16) & _ERROR_FLAG and int(ident, 16) <= _ERROR_FLAG | _ID_MASK:
        return CanFrame(arbitration_id=int(ident, 16) & _ID_MASK, is_error_frame=True)
    frame = frame_of(f"{ident}#R" if payload[:1] == "R" else data)  # candump adds the length that was asked for
    return checked(frame) if isinstance(frame, CanFrame) else frame


def checked(frame: CanFrame) -> CanFrame:
    """Return the frame, or raise if no bus can carry it.

    Raises:
        ValueError: its identifier or its length is not valid.
    """
    most = _ID_MASK if frame.is_extended_id else _MAX_STANDARD_ID
    if not 0 <= frame.arbitration_id <= most:
        raise ValueError(f"CAN id {frame.arbitration_id:#x} is beyond {'29' if frame.is_extended_id else '11'} bits")
    if frame.is_fd and len(frame.data) not in FD_LENGTHS:
        raise ValueError(f"a CAN-FD frame cannot have {len(frame.data)} bytes")
    if not frame.is_fd and len(frame.data) > 8:
        raise ValueError(f"a classic CAN frame has at most 8 bytes, this one {len(frame.data)}")
    return frame
