"""Forged Modbus answers: well-formed, with the right checksum, but not the answer to the driver's question.

They are made from recorded answers, so that a driver has only the intended reason to refuse them. On a serial line they
replace the answer; over TCP, which has no checksum, single bits are flipped, so that the transaction number still fits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from firmware_protocols.sums import crc16_modbus
from tactemu.wire.faults.fault import Fault
from tactemu.wire.faults.frames import Flip, Replace, Truncate
from tactemu.wire.faults.options import Ranges

SLAVE_FAILURE = 0x04
"""Exception code of Modbus: the server failed."""
VALUE_MASK = 0x15
"""Bits that are flipped in the values of a forged answer, so that they match no sample."""

NAMES = ("exception", "another unit", "short answer", "another transaction")
"""Names of the forged answers."""


class ForgedReply(NamedTuple):
    """A forged answer."""

    name: str
    why: str
    faults: Callable[[Ranges], list[Fault]]
    """A function that returns the faults which turn the frame with a number into this answer."""


def forged_values(frames: Sequence[str], *, with_checksum: bool) -> list[ForgedReply]:
    """Return the forged answers for frames of Modbus that answer the reading of registers; none for other frames.

    ``with_checksum``: the frames have Modbus's own, because the line has none.
    """
    data = [bytes.fromhex(frame) for frame in frames if "#" not in frame]
    rtu = [frame for frame in data if _is_rtu(frame)]
    tcp = [frame for frame in data if _is_tcp(frame)]
    if with_checksum and rtu:
        return _all(rtu[-1][:-2], 0, lambda old, new, n: [Replace(frames=n, data=_rtu(new))])
    if tcp and not with_checksum:
        other = ForgedReply(
            "another transaction",
            "the answer to another question",
            lambda n: [Flip(frames=n, byte=1, bit=0), *_flips(n, tcp[-1][9:11], _turned(tcp[-1][9:11]), 9)],
        )
        return [*_all(tcp[-1], 6, _by_flips), other]
    return []


def _is_rtu(frame: bytes) -> bool:
    return len(frame) > 6 and frame[1] in (3, 4) and frame[2] == len(frame) - 5 and frame == _rtu(frame[:-2])


def _is_tcp(frame: bytes) -> bool:
    return (
        len(frame) > 10 and frame[2:4] == b"\0\0" and int.from_bytes(frame[4:6], "big") == len(frame) - 6
        and frame[7] in (3, 4) and frame[8] == len(frame) - 9
    )  # fmt: skip


def _rtu(data: bytes) -> bytes:
    return data + crc16_modbus(data).to_bytes(2, "little")


def _turned(data: bytes) -> bytes:
    return bytes(byte ^ VALUE_MASK for byte in data)


def _by_flips(old: bytes, new: bytes, n: Ranges) -> list[Fault]:
    """Return the faults that flip the differing bits of a Modbus TCP answer, with its length, and cut off its end."""
    new = new[:4] + (len(new) - 6).to_bytes(2, "big") + new[6:]
    cut = [Truncate(frames=n, length=len(new))] if len(new) < len(old) else []
    return [*_flips(n, old[4:], new[4:], 4), *cut]


def _flips(n: Ranges, old: bytes, new: bytes, start: int) -> list[Fault]:
    return [
        Flip(frames=n, byte=start + k, bit=bit)
        for k, (a, b) in enumerate(zip(old, new))
        for bit in range(8)
        if (a ^ b) >> bit & 1
    ]


def _all(data: bytes, unit: int, faults: Callable[[bytes, bytes, Ranges], list[Fault]]) -> list[ForgedReply]:
    """Return the forged answers made from one answer.

    ``data`` is the answer without its checksum, ``unit`` the index of its unit number; function and count follow it.
    """
    head, body = data[: unit + 3], data[unit + 3 :]
    turned = _turned(body[:2]) + body[2:]
    other = head[:unit] + bytes([head[unit] ^ 1]) + head[unit + 1 :] + turned
    exception = data[: unit + 1] + bytes([data[unit + 1] | 0x80, SLAVE_FAILURE])
    half = max(2, len(body) // 4 * 2)
    short = data[: unit + 2] + bytes([half]) + body[:half]
    return [
        ForgedReply("exception", "the device reports a failure", lambda n: faults(data, exception, n)),
        ForgedReply("another unit", "an answer from another unit on the line", lambda n: faults(data, other, n)),
        ForgedReply(
            "short answer", "a well-formed answer with fewer registers than requested", lambda n: faults(data, short, n)
        ),
    ]
