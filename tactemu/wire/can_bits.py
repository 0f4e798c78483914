"""The exact time of a CAN or CAN-FD frame on the bus, with its own CRC and stuff bits (ISO 11898-1).

A classic frame is stuffed from the start-of-frame bit to the end of the CRC: after five equal bits the sender inserts
one of the other value. A CAN-FD frame is stuffed likewise up to the end of its data; its stuff count and CRC have stuff
bits at fixed places, so that their length does not depend on their value. Bits up to the bit-rate switch and after the
CRC delimiter run at the arbitration rate, those between them at the data rate. All lengths include the three bits of
intermission, after which the next frame may start.
"""

from __future__ import annotations

from dataclasses import replace

from firmware_protocols import CanFrame

TRAILER_BITS = 1 + 2 + 7 + 3
"""CRC delimiter, ACK slot and delimiter, end of frame, intermission: never stuffed."""
_FD_HEAD_STD, _FD_HEAD_EXT = 17, 36
"""Bits from the start of a CAN-FD frame to its bit-rate-switch bit, which is the last at the arbitration rate."""
_FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_ERROR_FRAME = 6 + 6 + 8
"""An error frame at its longest: two superposed flags and the delimiter."""


def frame_bits(frame: CanFrame) -> tuple[int, int]:
    """Return the numbers of bits of ``frame`` at the arbitration rate and at the data rate, intermission included.

    A frame broken by an error frame counts as broken at its last bit, which takes longest.
    """
    if frame.is_error_frame:
        slow, fast = frame_bits(replace(frame, is_error_frame=False))
        return slow + _ERROR_FRAME, fast
    if frame.is_fd:
        return _fd_bits(frame)
    head, length = _classic_head(frame)
    data = b"" if frame.is_remote_frame else frame.data
    length += 8 * len(data)
    body = head << 8 * len(data) | int.from_bytes(data, "big")
    stuffed = body << 15 | _crc15(body, length)
    return length + 15 + _stuff_bits(stuffed, length + 15) + TRAILER_BITS, 0


def frame_ns(frame: CanFrame, bitrate: int, data_bitrate: int | None = None) -> int:
    """Return the time on the bus [ns], intermission included; the data rate counts only with bit-rate switching."""
    arbitration, data = frame_bits(frame)
    return round(1e9 * arbitration / bitrate + 1e9 * data / (data_bitrate or bitrate))


def priority(frame: CanFrame) -> tuple[int, int, int, int, int]:
    """Return the arbitration order: of two frames that start together, the one with the smaller tuple wins the bus."""
    remote = int(frame.is_remote_frame)
    if frame.is_extended_id:
        return frame.arbitration_id >> 18, 1, 1, frame.arbitration_id & 0x3FFFF, remote
    return frame.arbitration_id, remote, 0, 0, 0


def _classic_head(frame: CanFrame) -> tuple[int, int]:
    """Return the bits from start of frame to data length code, as a number and its length in bits."""
    size = len(frame.data)
    remote = int(frame.is_remote_frame)
    if frame.is_extended_id:
        base, extension = frame.arbitration_id >> 18, frame.arbitration_id & 0x3FFFF
        head = (((base << 2 | 0b11) << 18 | extension) << 1 | remote) << 2  # SRR and IDE recessive; r1, r0 dominant
        return head << 4 | size, 39
    return ((frame.arbitration_id << 1 | remote) << 2) << 4 | size, 19  # IDE and r0 dominant


def _fd_bits(frame: CanFrame) -> tuple[int, int]:
    size = len(frame.data)
    brs = int(frame.bitrate_switch)
    if frame.is_extended_id:
        base, extension = frame.arbitration_id >> 18, frame.arbitration_id & 0x3FFFF
        head = (((base << 2 | 0b11) << 18 | extension) << 1) << 3 | 0b100 | brs  # RRS 0, FDF 1, res 0
        head_length = _FD_HEAD_EXT
    else:
        head = ((frame.arbitration_id << 2) << 3) | 0b100 | brs  # RRS 0, IDE 0, FDF 1, res 0
        head_length = _FD_HEAD_STD
    length = head_length + 5 + 8 * size  # ESI and data length code
    body = (head << 5 | _FD_LENGTHS.index(size)) << 8 * size | int.from_bytes(frame.data, "big")
    # A fixed stuff bit follows the last data bit, so a run that ends there needs no other.
    stuff = _stuff_bits(body, length, at_end=False)
    in_head = _stuff_bits(head, head_length)
    crc = 4 + 17 + 6 if size <= 16 else 4 + 21 + 7  # stuff count, CRC, fixed stuff bits
    fast = 5 + 8 * size + (stuff - in_head) + crc
    slow = head_length + in_head + TRAILER_BITS
    return (slow, fast) if brs else (slow + fast, 0)


# -- CRC-15/CAN, a byte at a time ---------------------------------------------------------------------------------


def _crc15_table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 7
        for _ in range(8):
            crc = (crc << 1) ^ (0x4599 if crc & 0x4000 else 0)
        table.append(crc & 0x7FFF)
    return table


CRC15 = _crc15_table()


def _crc15(bits: int, length: int) -> int:
    """Return the CRC over the lowest ``length`` bits; zeros in front that fill a byte do not change it."""
    crc = 0
    for byte in bits.to_bytes((length + 7) // 8, "big"):
        crc = ((crc << 8) & 0x7FFF) ^ CRC15[((crc >> 7) ^ byte) & 0xFF]
    return crc


# -- stuff bits, a byte at a time ----------------------------------------------------------------------------------
# State: 4 * value of the last bit + length of its run - 1 (runs of 1 to 4; the fifth makes a stuff bit, run of 1).

_STATE = 7 << 8
"""Mask of the state in a step's result; the number of stuff bits is in the bits above, bit 0: the last bit made one."""


def _step(state: int, byte: int) -> int:
    """Return the stuff bits that a byte causes, the state after it, and whether its last bit caused one."""
    last, run = state >> 2, (state & 3) + 1
    count, at_end = 0, False
    for shift in range(7, -1, -1):
        bit = byte >> shift & 1
        last, run = (last, run + 1) if bit == last else (bit, 1)
        at_end = run == 5
        if at_end:
            count, last, run = count + 1, 1 - last, 1
    return count << 24 | (4 * last + run - 1) << 8 | at_end


_STEP = [_step(state, byte) for state in range(8) for byte in range(256)]
"""The steps by ``state << 8 | byte``."""
RECESSIVE = 4
"""State of an idle bus: the start bit (0) begins a new run."""


def _stuff_bits(bits: int, length: int, *, at_end: bool = True) -> int:
    """Return the number of stuff bits of a stream from its start-of-frame bit on; ``at_end``: also after its last."""
    pad = -length % 8  # alternating bits that end recessive make no stuff bit
    padded = (0x55 & (1 << pad) - 1) << length | bits
    found = (RECESSIVE if pad % 2 == 0 else RECESSIVE - 4) << 8
    total = 0  # the counts add up, far from the other bits
    for byte in padded.to_bytes((length + pad) // 8, "big"):
        found = _STEP[found & _STATE | byte]
        total += found
    return (total >> 24) - (found & 1 and not at_end)
