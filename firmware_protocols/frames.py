"""Frames on the wire: ``bytes`` on a serial line, :class:`CanFrame` on CAN; and both as text, for tables and logs."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""The numbers of data bytes that a CAN-FD frame can have."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CanFrame:
    """One CAN or CAN-FD frame. ``data`` is at most 8 bytes, or a valid FD length when ``is_fd``."""

    arbitration_id: int
    data: bytes = b""
    is_extended_id: bool = False
    is_remote_frame: bool = False
    is_fd: bool = False
    bitrate_switch: bool = False
    is_error_frame: bool = False
    """True for an error frame: the bus was disturbed while this frame was on it. Faults make it, no device does."""

    def __str__(self) -> str:
        """Return the frame in ``candump`` notation: ``027#B1C6`` (classic), ``18FF0000##1AABB`` (FD, flags digit)."""
        ident = f"{self.arbitration_id:08X}" if self.is_extended_id else f"{self.arbitration_id:03X}"
        if self.is_error_frame:
            return f"{ident}#ERROR"
        if self.is_remote_frame:
            return f"{ident}#R"
        mark = f"##{int(self.bitrate_switch)}" if self.is_fd else "#"
        return f"{ident}{mark}{self.data.hex().upper()}"

    @staticmethod
    def parse(text: str) -> CanFrame:
        """Return the frame of a text in ``candump`` notation; spaces between bytes are allowed.

        Raises:
            ValueError: the text is not candump notation.
        """
        ident, mark, content = text.replace(" ", "").partition("#")
        if not mark:
            raise ValueError(f"not a CAN frame: {text!r}; expected candump notation such as 027#B1C6")
        is_fd, remote, error = content.startswith("#"), content == "R", content == "ERROR"
        return CanFrame(
            arbitration_id=int(ident, 16),
            data=b"" if remote or error else bytes.fromhex(content[2:] if is_fd else content),
            is_extended_id=len(ident) > 3,
            is_remote_frame=remote,
            is_fd=is_fd,
            bitrate_switch=is_fd and bool(int(content[1:2] or "0", 16) & 1),
            is_error_frame=error,
        )


WireFrame = bytes | CanFrame
"""A serial frame is ``bytes`` and is written in one ``write()``; a CAN frame is a :class:`CanFrame`."""


def frame_of(text: WireFrame | str) -> WireFrame:
    """Return the frame of a text such as ``"AA 07"`` or ``"201#0700"``; return a frame as it is.

    Raises:
        ValueError: the text is neither hex nor candump notation.
    """
    if not isinstance(text, str):
        return text
    return CanFrame.parse(text) if "#" in text else bytes.fromhex(text)


def text_of(frame: WireFrame) -> str:
    """Return a frame in hex, or in candump notation."""
    return str(frame) if isinstance(frame, CanFrame) else frame.hex()


def payload(frame: WireFrame) -> bytes:
    """Return the data bytes of a frame."""
    return frame.data if isinstance(frame, CanFrame) else frame


def with_payload(frame: WireFrame, data: bytes) -> WireFrame:
    """Return the frame with other data; a CAN-FD frame is padded with zeros to the next valid length."""
    if not isinstance(frame, CanFrame):
        return data
    if frame.is_fd:
        data = data.ljust(next(size for size in FD_LENGTHS if size >= len(data)), b"\0")
    return replace(frame, data=data)


def matches(pattern: WireFrame | str, frame: WireFrame) -> bool:
    """Return True if a frame matches a pattern.

    The pattern is a frame itself, or text in which ``..`` is any byte, ``..{12}`` twelve of them and ``*`` any number.
    """
    if not isinstance(pattern, str):
        return pattern == frame
    regex = re.sub(r"(\.\.|[0-9A-F]{2})\{(\d+)\}", r"(?:\1){\2}", pattern.upper().replace(" ", ""))
    return re.fullmatch(regex.replace("*", "(?:..)*"), text_of(frame).upper()) is not None
