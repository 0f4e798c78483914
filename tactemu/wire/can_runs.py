"""The times of many CAN frames on the bus: what :mod:`tactemu.wire.can_bits` counts, by NumPy."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np

from firmware_protocols.can_frames import CanFrames
from tactemu.wire.can_bits import CRC15, RECESSIVE, TRAILER_BITS, frame_bits

_HEAD = 19
"""Bits from the start of a frame with a standard identifier to the end of its data length code."""
_STATE = 7 << 16
"""Mask of the state in the result of a step; the number of stuff bits is in the bits above."""


def run_ns(frames: CanFrames, bitrate: int) -> np.ndarray:
    """Return the time of each frame on the bus [ns], intermission included; int64, shape ``(n,)``."""
    return np.rint(1e9 * run_bits(frames) / bitrate).astype(np.int64)


def run_bits(frames: CanFrames) -> np.ndarray:
    """Return the number of bits of each frame, stuff bits and intermission included; shape ``(n,)``."""
    array = frames.array
    if array["len"].min() < 8:
        return np.array([frame_bits(frame)[0] for frame in frames])
    head, crc = _heads(array["can_id"].tobytes())
    data = np.ascontiguousarray(array["data"])
    crc = crc ^ np.bitwise_xor.reduce(_crc_tables(10)[_PLACES, data], axis=1)
    step, last = _steps()
    words = data.view(">u2").astype(np.int32)
    total = found = head  # the stuff bits add up, the state is that of the last step
    for k in range(4):
        found = step[found & _STATE | words[:, k]]
        total = total + found
    total = total + last[(found & _STATE) >> 1 | crc]
    return (total >> 24) + (_HEAD + 64 + 15 + TRAILER_BITS)


_PLACES = np.arange(2, 10)
"""Positions of the data bytes among the bytes under the CRC, counted from the end of a head filled up to 24 bits."""


@lru_cache(256)
def _heads(idents: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return state and stuff bits at the end of the heads of frames with 8 data bytes, and their share of the CRC."""
    bits = np.frombuffer(idents, np.uint32).astype(np.int32) << 7 | 8
    state, count = np.full(len(bits), RECESSIVE), np.zeros(len(bits), np.int32)
    for shift, size in ((16, 3), (8, 8), (0, 8)):
        made, after = _step(size)
        some = bits >> shift & (1 << size) - 1
        state, count = after[state, some], count + made[state, some]
    tables = _crc_tables(11)
    crc = tables[0][bits >> 16] ^ tables[1][bits >> 8 & 0xFF] ^ tables[2][bits & 0xFF]
    return count << 24 | state << 16, crc


@cache
def _crc_tables(n: int) -> np.ndarray:
    """Return the CRC of a byte at each of ``n`` places, zeros elsewhere; shape ``(n, 256)``. A CRC is their XOR."""
    one = np.array(CRC15, np.int32)
    tables = [one]
    for _ in range(n - 1):
        before = tables[0]
        tables.insert(0, (before << 8 & 0x7FFF) ^ one[before >> 7])
    return np.array(tables)


@cache
def _steps() -> tuple[np.ndarray, np.ndarray]:
    """Return two tables of stuff bits ``<< 24`` and state ``<< 16``: after two bytes, by ``state << 16 | bytes``, and
    after the 15 bits of a CRC, by ``state << 15 | bits``.
    """
    tables = []
    for size in (8, 7):
        (made, after), (more, then) = _step(size), _step(8)
        high, low = np.divmod(np.arange(1 << size + 8), 256)
        between = after[:, high]
        tables.append((made[:, high] + more[between, low] << 24 | then[between, low] << 16).ravel())
    return tables[0], tables[1]


@cache
def _step(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the stuff bits that ``size`` bits cause after each state, and the state then; shape ``(8, 2**size)``."""
    bits = np.arange(1 << size)
    state = np.repeat(np.arange(8, dtype=np.int32)[:, None], len(bits), axis=1)
    count = np.zeros_like(state)
    for shift in range(size - 1, -1, -1):
        bit, last, run = bits >> shift & 1, state >> 2, (state & 3) + 1
        run = np.where(bit == last, run + 1, 1)
        count += run == 5
        state = np.where(run == 5, 4 * (1 - bit), 4 * bit + run - 1).astype(np.int32)
    return count, state
