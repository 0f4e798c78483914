"""What a UART hears of another that is set otherwise: the line's levels, sampled in the wrong places.

The receiver waits for a falling edge, samples the middle of what it takes for the start bit, the data bits, the parity
bit and the stop bit, and hands the byte over whether parity and stop bit were right or not, as a serial port in raw
mode does. The same bytes at the same two settings always give the same noise; a few percent of difference in speed
still read well, as on a real line.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from tactemu.transports.transport import SerialSetting


class _Setting(NamedTuple):
    """A serial setting that leaves nothing open; the defaults are taken for what neither end says."""

    baud: int = 9600
    bytesize: int = 8
    parity: str = "N"
    stopbits: float = 1


def as_received(data: bytes, sent: SerialSetting, heard: SerialSetting) -> bytes:
    """``data`` sent at one setting, as heard at another. Idle line before and after.

    What one end does not say is as at the other: a pseudo terminal, for one, does not tell the driver's byte size.
    """
    if agree(sent, heard):
        return data
    here, there = _filled(sent, heard), _filled(heard, sent)
    samples = _samples(here, there)
    start_at, bits_at, stop_at = samples[0], samples[1 : 1 + there.bytesize], samples[-1]
    levels = _levels(here)
    line = b"\x01" + b"".join([levels[byte] for byte in data])
    end = len(line)
    line += b"\x01" * (stop_at + 1)
    out = bytearray()
    edge = line.find(b"\x01\x00") + 1
    while 0 < edge < end:
        if line[edge + start_at]:  # the dip was shorter than half a bit: no start bit
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
    """Whether two ends hear each other well; a receiver looks at the first stop bit only."""
    return _filled(one, other)[:3] == _filled(other, one)[:3]


def _filled(own: SerialSetting, other: SerialSetting) -> _Setting:
    """``own`` with what it leaves open as at the other end."""
    said = {
        name: getattr(setting, name)
        for setting in (other, own)
        for name in _Setting._fields
        if getattr(setting, name) is not None
    }
    return _Setting(**said)


@lru_cache(maxsize=16)
def _levels(sent: _Setting) -> list[bytes]:
    """Return every byte as levels on the line: start, data (least significant first), parity, stop; shape ``(256,
    n)``.
    """
    return [_levels_of(byte, sent) for byte in range(256)]


def _levels_of(byte: int, sent: _Setting) -> bytes:
    bits = [byte >> k & 1 for k in range(sent.bytesize)]
    odd = sum(bits) % 2
    parity = {"N": [], "E": [odd], "O": [1 - odd], "M": [1], "S": [0]}[sent.parity]
    return bytes([0, *bits, *parity]) + b"\x01" * math.ceil(sent.stopbits)


@lru_cache(maxsize=16)
def _samples(sent: _Setting, heard: _Setting) -> tuple[int, ...]:
    """Where the receiver looks, in bits of the sender after the falling edge: start, data, parity if any, stop."""
    n = 2 + heard.bytesize + (heard.parity != "N")
    return tuple((2 * k + 1) * sent.baud // (2 * heard.baud) for k in range(n))
