"""The driver of the closed loop's benchmark: ``python -m benchmarks.closed_loop_driver SERVOS PADS SECONDS``.

It closes and opens a gripper of two Feetech servos by sync writes, and reads the pushes of a PaXini board. The output
is JSON with the times of the first bytes of each touch, on the machine's monotonic clock [s].
"""

from __future__ import annotations

import json
import sys
import time

import serial

from firmware_protocols.sums import lrc8

PUSH_ON = bytes.fromhex("55 AA 00 10 17 00 01 00 01 D8")
HEAD, LENGTH, CONTENT = b"\xaa\x56", 6, 6
OPEN, CLOSED, SPEED, TORQUE = 2048, 2048 + 1200, 1500, 40
PERIODS_S = (0.45, 0.23, 0.31, 0.37)
"""Periods without a common divisor with those of the pads."""


def order(goal: int) -> bytes:
    """Return the sync write of goal, speed and torque limit to both servos."""
    values = (goal, 0, SPEED, TORQUE)
    each = b"".join(value.to_bytes(2, "little") for value in values)
    body = bytes([0xFE, 4 + 2 * (len(each) + 1), 0x83, 42, len(each)]) + b"".join(bytes([k]) + each for k in (1, 2))
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def torque_on(ident: int) -> bytes:
    """Return the write that makes a servo hold its position."""
    body = bytes([ident, 4, 3, 40, 1])
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def main() -> None:
    """Drive the gripper for SECONDS, and print the times."""
    servos = serial.Serial(sys.argv[1], 1_000_000)
    pads = serial.Serial(sys.argv[2], 921_600, timeout=0.01)
    servos.write(torque_on(1) + torque_on(2))
    pads.write(PUSH_ON)
    end, turn, turns, touched = time.monotonic() + float(sys.argv[3]), 0.0, 0, False
    buffer, told = b"", []
    while (now := time.monotonic()) < end:
        if now > turn:
            servos.write(order((CLOSED, OPEN)[turns % 2]))
            turn, turns = now + PERIODS_S[turns % len(PERIODS_S)], turns + 1
        buffer += pads.read(max(1, pads.in_waiting))
        at = time.monotonic()
        while (start := buffer.find(HEAD)) >= 0 and len(buffer) >= start + LENGTH:
            size = LENGTH + int.from_bytes(buffer[start + 3 : start + 5], "little")
            if len(buffer) < start + size:
                break
            frame, buffer = buffer[start : start + size], buffer[start + size :]
            if lrc8(frame):
                continue
            touches = any(frame[CONTENT:-1])
            if touches and not touched:
                told.append(at)
            touched = touches
    sys.stdout.write(json.dumps(told))


if __name__ == "__main__":
    main()
