"""The exact time of a CAN or CAN-FD frame on the bus, with its own CRC and stuff bits (ISO 11898-1).

A classic frame is stuffed from the start-of-frame bit to the end of the CRC: after five equal bits the sender inserts
one of the other value. A CAN-FD frame is stuffed likewise up to the end of its data; its stuff count and CRC have stuff
bits at fixed places, so that their length does not depend on their value. Bits up to the bit-rate switch and after the
CRC delimiter run at the arbitration rate, those between them at the data rate. All lengths include the three bits of
intermission, after which the next frame may start.

Stuff bits and CRC are looked up for two bytes at a time, and remembered for the heads of frames, which are few.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np

from firmware_protocols import CanFrame
from firmware_protocols.can_frames import CanFrames

TRAILER_BITS = 1 + 2 + 7 + 3
"""CRC delimiter, ACK slot and delimiter, end of frame, intermission: never stuffed."""
_FD_HEAD_STD, _FD_HEAD_EXT = 17, 36
"""Bits from the start of a CAN-FD frame to its bit-rate-switch bit, which is the last at the arbitration rate."""
_FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_CRC_BITS, _CRC_POLYNOMIAL = 15, 0x4599
_ERROR_FRAME = 6 + 6 + 8
"""An error frame at its longest: two superposed flags and the delimiter."""
_MAX_HEADS = 4096
"""Maximum number of heads of frames that are remembered."""


def frame_bits(frame: CanFrame) -> tuple[int, int]:
    """Return the numbers of bits of ``frame`` at the arbitration rate and at the data rate, intermission included.

    A frame broken by an error frame counts as broken at its last bit, which takes longest.
    """
    if frame.is_error_frame:
        slow, fast = frame_bits(replace(frame, is_error_frame=False))
        return slow + _ERROR_FRAME, fast
    if frame.is_fd:
        return _fd_bits(frame)
    head = _classic_head(frame.arbitration_id, frame.is_extended_id, frame.is_remote_frame, len(frame.data))
    return _classic_bits(head, b"" if frame.is_remote_frame else frame.data), 0


def frame_ns(frame: CanFrame, bitrate: int, data_bitrate: int | None = None) -> int:
    """Return the time on the bus [ns], intermission included; the data rate counts only with bit-rate switching."""
    arbitration, data = frame_bits(frame)
    arbitration_ns = 1e9 * arbitration / bitrate
    return round(arbitration_ns + 1e9 * data / (data_bitrate or bitrate) if data else arbitration_ns)


def run_ns(frames: CanFrames, bitrate: int) -> list[int]:
    """Return the time of each frame of an array on the bus [ns], intermission included."""
    return [
        round(1e9 * _classic_bits(_classic_head(ident, False, False, size), data[:size]) / bitrate)
        for ident, size, data in frames.unpacked()
    ]


def priority(frame: CanFrame) -> tuple[int, int, int, int, int]:
    """Return the arbitration order: of two frames that start together, the one with the smaller tuple wins the bus."""
    remote = int(frame.is_remote_frame)
    if frame.is_extended_id:
        return frame.arbitration_id >> 18, 1, 1, frame.arbitration_id & 0x3FFFF, remote
    return frame.arbitration_id, remote, 0, 0, 0


@lru_cache(_MAX_HEADS)
def _classic_head(ident: int, is_extended: bool, is_remote: bool, size: int) -> tuple[int, int, int]:
    """Return what the bits from start of frame to data length code leave behind: the scan for stuff bits, the CRC
    (shifted as in :func:`tables`), and the length of the frame without stuff bits."""
    remote = int(is_remote)
    if is_extended:
        base, extension = ident >> 18, ident & 0x3FFFF
        head = (((base << 2 | 0b11) << 18 | extension) << 1 | remote) << 2  # SRR and IDE recessive; r1, r0 dominant
        length = 39
    else:
        head, length = (ident << 1 | remote) << 2, 19  # IDE and r0 dominant
    head = head << 4 | size
    crc_table, crc = tables()[2], 0
    for word in _words(head, length):  # zeros in front do not change the CRC
        crc = crc_table[crc ^ word]
    return _scanned_head(head, length), crc, length + (0 if is_remote else 8 * size) + _CRC_BITS + TRAILER_BITS


def _classic_bits(head: tuple[int, int, int], data: bytes) -> int:
    """Return the number of bits of a classic frame with this head."""
    found, crc, length = head
    stuff, stuff_of_byte, crc_table = tables()
    total = found
    for word in _WORDS[len(data)](data):
        found = stuff[found & _STATE | word]
        total += found
        crc = crc_table[crc ^ word]
    if len(data) & 1:
        byte = data[-1]
        found = stuff_of_byte[(found & _STATE) >> 8 | byte]
        total += found
        crc = crc << 8 & 0xFFFF ^ crc_table[crc >> 8 ^ byte]
    # a 16th bit that differs from the last bit of the CRC makes no stuff bit
    return length + (total + stuff[found & _STATE | crc | ~crc >> 1 & 1] >> _COUNT_SHIFT)


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
    found = total = _scanned_head(head << 5 | _FD_LENGTHS.index(size), head_length + 5)  # ESI and data length code
    stuff, stuff_of_byte, _ = tables()
    for word in _WORDS[size](frame.data):
        found = stuff[found & _STATE | word]
        total += found
    if size & 1:
        found = stuff_of_byte[(found & _STATE) >> 8 | frame.data[-1]]
        total += found
    # A fixed stuff bit follows the last data bit, so a run that ends there needs no other.
    stuffed = (total >> _COUNT_SHIFT) - (found & 1)
    in_head = _scanned_head(head, head_length) >> _COUNT_SHIFT
    crc = 4 + 17 + 6 if size <= 16 else 4 + 21 + 7  # stuff count, CRC, fixed stuff bits
    fast = 5 + 8 * size + (stuffed - in_head) + crc
    slow = head_length + in_head + TRAILER_BITS
    return (slow, fast) if brs else (slow + fast, 0)


# -- stuff bits and CRC-15/CAN, two bytes at a time -------------------------------------------------------------------
# A scan is one number: the stuff bits so far << 24, the state << 16, and in bit 0 whether the last bit caused one. The
# state is 4 * value of the last bit + length of its run - 1 (runs of 1 to 4; the fifth makes a stuff bit, run of 1).
# Scans of consecutive words may be added up for the count (of the 33 words of the longest frame, states do not reach
# its bits); the state is that of the last.

_COUNT_SHIFT = 24
_STATE = 7 << 16
_RECESSIVE, _DOMINANT = 4 << 16, 0
"""States after a single bit; on an idle bus, the start bit (0) begins a new run."""
_WORDS = [struct.Struct(f">{size // 2}H{'x' * (size % 2)}").unpack for size in range(65)]
"""The functions that split so many data bytes into words, without the last byte of an odd number."""


@lru_cache(_MAX_HEADS)
def _scanned_head(bits: int, length: int) -> int:
    """Return the scan of the first bits of a frame, from its start bit on."""
    pad = -length % 16  # alternating bits that end recessive make no stuff bit
    found = total = _DOMINANT if pad % 2 else _RECESSIVE
    stuff = tables()[0]
    for word in _words((0x5555 & (1 << pad) - 1) << length | bits, length + pad):
        found = stuff[found & _STATE | word]
        total += found
    return total & -1 << _COUNT_SHIFT | found & (1 << _COUNT_SHIFT) - 1


def _words(bits: int, length: int) -> tuple[int, ...]:
    """Return ``length`` bits as words, with zeros in front."""
    size = (length + 15) // 16 * 2
    return _WORDS[size](bits.to_bytes(size, "big"))


@cache
def tables() -> tuple[array[int], array[int], array[int]]:
    """Return three tables: the scan of a word by ``state << 16 | word``, the scan of a byte by ``state << 8 | byte``,
    and the CRC of a word, ``<< 1``, by the word XOR the CRC before it, ``<< 1``."""
    count, state, at_end = _scanned_bytes()
    high, low = np.divmod(np.arange(1 << 16), 256)
    between = state[:, high]
    words = count[:, high] + count[between, low] << _COUNT_SHIFT | state[between, low] << 16 | at_end[between, low]
    byte_scans = count << _COUNT_SHIFT | state << 16 | at_end
    crc = np.arange(256) << _CRC_BITS - 8
    for _ in range(8):
        crc = crc << 1 & 0x7FFF ^ np.where(crc & 0x4000, _CRC_POLYNOMIAL, 0)
    crcs = crc[high] << 8 & 0x7FFF ^ crc[crc[high] >> 7 ^ low]
    return array("I", words.tobytes()), array("I", byte_scans.tobytes()), array("H", (crcs << 1).astype("u2").tobytes())


def _scanned_bytes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the stuff bits that a byte causes after each state, the state then, and whether its last bit caused one;
    uint32, shape ``(8, 256)``."""
    bits = np.arange(256)
    state = np.repeat(np.arange(8)[:, None], 256, axis=1)
    count, at_end = np.zeros_like(state), np.zeros_like(state)
    for shift in range(7, -1, -1):
        bit, last, run = bits >> shift & 1, state >> 2, (state & 3) + 1
        run = np.where(bit == last, run + 1, 1)
        at_end = run == 5
        count += at_end
        state = np.where(at_end, 4 * (1 - bit), 4 * bit + run - 1)
    return count.astype(np.uint32), state.astype(np.uint32), at_end.astype(np.uint32)
