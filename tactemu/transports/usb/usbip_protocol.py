"""The messages of USB/IP, version 1.1.1 (Linux, ``Documentation/usb/usbip_protocol.rst``); big-endian."""

from __future__ import annotations

import struct
from typing import NamedTuple

VERSION = 0x0111
OP_REQ_DEVLIST, OP_REP_DEVLIST = 0x8005, 0x0005
OP_REQ_IMPORT, OP_REP_IMPORT = 0x8003, 0x0003
OP = struct.Struct(">HHI")
"""The head of a request for a list or a device: version, code, status."""
BUSID_BYTES = 32
FULL_SPEED = 2

_ABOUT = struct.Struct(">256s32sIIIHHH6B")
CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
HEADER_BYTES = 48
_HEAD = struct.Struct(">5I")
_SUBMIT = struct.Struct(">IiIiI8s")
_RET_SUBMIT = struct.Struct(">5Iiiiii8x")
_UNLINKED = struct.Struct(">I24x")
_RET_UNLINK = struct.Struct(">5Ii24x")


class Submit(NamedTuple):
    """A request (URB) of the host for one transfer."""

    number: int
    endpoint: int
    to_host: bool
    length: int
    """The length of the data, or the room for them [byte]."""
    setup: bytes
    data: bytes


class Unlink(NamedTuple):
    """The withdrawal of a request."""

    number: int
    withdrawn: int


def about(busid: str, number: int, device: bytes, interface_count: int) -> bytes:
    """Return what a list says of a device; ``device`` is its device descriptor."""
    vid, pid, release = struct.unpack_from("<HHH", device, 8)
    path = f"/sys/devices/tactemu/usb1/{busid}".encode()
    return _ABOUT.pack(
        path, busid.encode(), 1, number, FULL_SPEED, vid, pid, release, *device[4:7], 1, device[17], interface_count
    )


def parsed(buffer: bytes | bytearray, at: int) -> tuple[Submit | Unlink, int] | None:
    """Return the message at an offset and the offset after it, or None if it has not come whole.

    Raises:
        ValueError: it is no message of USB/IP.
    """
    if len(buffer) - at < HEADER_BYTES:
        return None
    command, number, _, direction, endpoint = _HEAD.unpack_from(buffer, at)
    if command == CMD_UNLINK:
        return Unlink(number, *_UNLINKED.unpack_from(buffer, at + _HEAD.size)), at + HEADER_BYTES
    if command != CMD_SUBMIT or direction > 1 or endpoint > 15:
        raise ValueError(f"USB/IP: command {command}, direction {direction}, endpoint {endpoint}")
    _, length, _, _, _, setup = _SUBMIT.unpack_from(buffer, at + _HEAD.size)
    if not 0 <= length <= MAX_TRANSFER_BYTES:
        raise ValueError(f"USB/IP: a transfer of {length} bytes")
    end = at + HEADER_BYTES + (0 if direction else length)
    if len(buffer) < end:
        return None
    data = bytes(buffer[at + HEADER_BYTES : end])
    return Submit(number, endpoint, bool(direction), length, setup, data), end


def submitted(number: int, status: int, length: int, data: bytes = b"") -> bytes:
    """Return the answer to a request: its status (0, or a negative ``errno``), the transferred length, the data."""
    return _RET_SUBMIT.pack(RET_SUBMIT, number, 0, 0, 0, status, length, 0, 0, 0) + data


def unlinked(number: int, status: int) -> bytes:
    """Return the answer to a withdrawal: ``-ECONNRESET`` if the request was still waiting, else 0."""
    return _RET_UNLINK.pack(RET_UNLINK, number, 0, 0, 0, status)


MAX_TRANSFER_BYTES = 1 << 20
"""Maximum length of a transfer; bounds the memory that a client can take. Drivers ask for at most 64 kB."""
