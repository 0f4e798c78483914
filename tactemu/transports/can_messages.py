"""Conversion between frames and python-can's messages."""

from __future__ import annotations

import logging

import can

from firmware_protocols import CanFrame
from tactemu.base.frame_text import PROTOCOL_ERROR

logging.getLogger("can").addHandler(logging.NullHandler())  # our own errors report what cannot be opened or read


def message_of(frame: CanFrame, timestamp: float = 0.0, *, received: bool = True) -> can.Message:
    """Return a frame as python-can's message. An error frame has its class in place of an identifier."""
    if frame.is_error_frame:
        return can.Message(
            timestamp=timestamp, arbitration_id=PROTOCOL_ERROR, data=bytes(8), is_error_frame=True,
            is_extended_id=False, is_rx=received, channel=0,
        )  # fmt: skip
    return can.Message(
        timestamp=timestamp,
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        is_extended_id=frame.is_extended_id,
        is_remote_frame=frame.is_remote_frame,
        is_fd=frame.is_fd,
        bitrate_switch=frame.bitrate_switch,
        is_rx=received,
        channel=0,
    )


def frame_of(message: can.Message) -> CanFrame:
    """Return python-can's message as a frame."""
    return CanFrame(
        arbitration_id=message.arbitration_id,
        data=b"" if message.is_remote_frame else bytes(message.data),
        is_extended_id=message.is_extended_id,
        is_remote_frame=message.is_remote_frame,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )
