"""What a UART hears of another that talks at another speed: the line's levels, sampled in the wrong places.

The receiver waits for a falling edge, samples the middle of what it takes for the start bit, the data bits and the stop
bit, and hands the byte over whether the stop bit was right or not, as a serial port in raw mode does. The same bytes at
the same two speeds always give the same noise; a few percent of difference still read well, as on a real line.
"""

from __future__ import annotations

from firmware_protocols import SerialWire


def misheard(data: bytes, sent_baud: int, heard_baud: int, wire: SerialWire) -> bytes:
    """``data`` sent at one speed, as heard at another [bit/s]. Idle line before and after."""
    if sent_baud == heard_baud:
        return data
    line = _levels(data, wire)
    heard, edge = bytearray(), line.find(b"\x01\x00") + 1
    while edge > 0:
        byte, stop_at, good = _sample(line, edge, sent_baud, heard_baud, wire.bytesize, wire.parity != "N")
        if byte is not None:
            heard.append(byte)
        if not good:
            stop_at = line.find(b"\x01", stop_at)
            if stop_at < 0:
                break
        edge = line.find(b"\x01\x00", stop_at) + 1
    return bytes(heard)


def _levels(data: bytes, wire: SerialWire) -> bytes:
    """The line bit by bit: one idle bit, then start, data (least significant first), parity, stop of every byte."""
    line = bytearray(b"\x01")
    for byte in data:
        bits = [byte >> k & 1 for k in range(wire.bytesize)]
        line.append(0)
        line.extend(bits)
        if wire.parity != "N":
            line.append(sum(bits) % 2 ^ (wire.parity == "O"))
        line.extend(b"\x01" * wire.stopbits)
    return bytes(line)


def _sample(line: bytes, edge: int, sent: int, heard: int, bytesize: int, parity: bool) -> tuple[int | None, int, bool]:
    """The byte that starts at ``edge``, where its stop bit was looked for, and whether the stop bit was there.

    Times are in units of 1 / (sent * heard) s, so that all is exact in integers.
    """

    def level(k: int) -> tuple[int, int]:
        at = (2 * edge * heard + (2 * k + 1) * sent) // (2 * heard)
        return (line[at] if at < len(line) else 1), at

    start, at = level(0)
    if start:  # the dip was shorter than half a bit: no start bit
        return None, at, True
    byte = sum(level(1 + k)[0] << k for k in range(bytesize))
    stop, at = level(1 + bytesize + parity)
    return byte, at, bool(stop)
