"""LinkerHand's matrices on CAN: fingertips, and the palm of a G20.

Source: linker-bot/linkerhand-python-sdk@b371361 (LinkerHand/core/can/linker_hand_l10_can.py, linker_hand_o6_can.py,
linker_hand_g20_can.py).
A reading is every row of thumb to little, 0..255; of the palm, the bytes behind B6 as they came.

Options: 6x12, 10x4 or palm; right or left.
Not settled by the description: the layout of the palm's answer (the bytes of all frames until a silence; the driver
asks every 15 ms); the low nibble of the row byte (must be 0 here).
"""

import time

from host import Broken, expect, frame, open_can, run, send

KINDS = {"6x12": (0xC6, 12, 6), "10x4": (0xA4, 10, 4)}


def finger(bus, number, command, selector, rows, columns):
    send(bus, number, bytes([command, selector]))
    values = []
    for row in range(rows):
        message = frame(bus, lambda m: m.arbitration_id == number and len(m.data) > 2 and m.data[0] == command)
        expect(message.data[1] == row << 4, f"row byte {message.data[1]:02X}, expected {row << 4:02X}")
        expect(len(message.data) == 2 + columns, f"{len(message.data)} bytes, expected {2 + columns}")
        values += message.data[2:]
    time.sleep(0.0025)
    return values


def palm(bus, number, length):
    """Bytes of one answer. Nothing tells how many there are: the first ends with a silence, others are as long."""
    send(bus, number, b"\xb6")
    values = []
    while length is None or len(values) < length:
        try:
            message = frame(bus, lambda m: m.arbitration_id == number and len(m.data) > 1 and m.data[0] == 0xB6, 0.5)
        except Broken:
            expect(values and length is None, f"{len(values)} bytes in answer to B6, the first time {length}")
            break
        values += message.data[1:]
    return values


def read(channel, kind="6x12", side="right"):
    bus, number = open_can(channel), {"right": 0x27, "left": 0x28}[side]
    length = None
    while True:
        if kind == "palm":
            yield (answer := palm(bus, number, length))
            length = len(answer)
        else:
            yield [v for k in range(5) for v in finger(bus, number, 0xB1 + k, *KINDS[kind])]


if __name__ == "__main__":
    run(read, pause=0.01)
