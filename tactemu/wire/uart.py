"""The noise that a UART receives from one with other settings: the line's levels, sampled in the wrong places.

The receiver waits for a falling edge, samples the middle of what it takes for the start bit, the data bits, the parity
bit and the stop bit, and hands the byte over whether parity and stop bit were right or not, as a serial port in raw
mode does. The same bytes at the same two settings always give the same noise; with a few percent of difference in
speed they are received correctly, as on a real line.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from tactemu.transports.transport import SerialSetting


class _Setting(NamedTuple):
    """A serial setting without unknowns; the defaults stand for what neither end reports."""

    baud: int = 9600
    bytesize: int = 8
    parity: str = "N"
    stopbits: float = 1


def as_received(data: bytes, sent: SerialSetting, received: SerialSetting) -> bytes:
    """Return ``data``, sent at one setting, as a UART with another receives them; the line is idle before and after.

    What one end does not report is as at the other: a pseudo terminal, for example, does not report the byte size.
    """
    if agree(sent, received):
        return data
    here, there = _filled(sent, received), _filled(received, sent)
    samples = _samples(here, there)
    start_at, bits_at, stop_at = samples[0], samples[1 : 1 + there.bytesize], samples[-1]
    levels = _levels(here)
    line = b"\x01" + b"".join([levels[byte] for byte in data])
    end = len(line)
    line += b"\x01" * (stop_at + 1)
    out = bytearray()
    edge = line.find(b"\x01\x00") + 1
    while 0 < edge < end:
        if line[edge + start_at]:  # the low level was shorter than half a bit: no start bit
            edge = line.find(b"\x01\x00", edge + start_at) + 1
            continue
        byte = 0
        for k, at in enumerate(bits_at):
            byte |= line[edge + at] << k
        out.append(byte)
        idle = line.find(b"\x01", edge + stop_at)  # where the stop bit was, or should have been, the line is high again
        edge = line.find(b"\x01\x00", idle) + 1
    return bytes(out)


def agree(one: SerialSetting, other: SerialSetting) -> bool:
    """Return True if two ends receive each other correctly; a receiver samples the first stop bit only."""
    return _filled(one, other)[:3] == _filled(other, one)[:3]


def _filled(own: SerialSetting, other: SerialSetting) -> _Setting:
    """Return ``own`` with its unknowns taken from the other end."""
    known = {
        name: getattr(setting, name)
        for setting in (other, own)
        for name in _Setting._fields
        if getattr(setting, name) is not None
    }
    return _Setting(**known)


@lru_cache(maxsize=16)
def _levels(sent: _Setting) -> list[bytes]:
    """Return the levels of every byte: start, data (least significant first), parity, stop; shape ``(256, n)``."""
    return [_levels_of(byte, sent) for byte in range(256)]


def _levels_of(byte: int, sent: _Setting) -> bytes:
    bits = [byte >> k & 1 for k in range(sent.bytesize)]
    odd = sum(bits) % 2
    parity = {"N": [], "E": [odd], "O": [1 - odd], "M": [1], "S": [0]}[sent.parity]
    return bytes([0, *bits, *parity]) + b"\x01" * math.ceil(sent.stopbits)


@lru_cache(maxsize=16)
def _samples(sent: _Setting, received: _Setting) -> tuple[int, ...]:
    """Return the receiver's sampling points in bits of the sender after the falling edge: start, data, parity, stop."""
    n = 2 + received.bytesize + (received.parity != "N")
    return tuple((2 * k + 1) * sent.baud // (2 * received.baud) for k in range(n))
