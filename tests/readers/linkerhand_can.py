"""LinkerHand's matrices on CAN: fingertips, and the palm of a G20.

Source: linker-bot/linkerhand-python-sdk@b371361 (LinkerHand/core/can/linker_hand_l10_can.py, linker_hand_o6_can.py,
linker_hand_g20_can.py); palm: linker-bot/linkerhand-ros2-sdk@bba0b9d linker_hand_g20_can.py and the vendor's CAN table
beside it, B0, B1, B6.
A reading is every row of thumb to little, 0..255; of the palm, 14 rows of 16 and their sum.

Options: 6x12, 10x4 or palm; right or left.
Not settled by the description: the low nibble of the row byte (must be 0 here).
"""

import time

from host import expect, frame, open_can, run, send

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


def palm(bus, number, rows=14, columns=16):
    """Frames of row, column and at most five numbers, until the frame of the sum."""
    send(bus, number, bytes([0xB6, rows, columns, 1]))
    values = {}
    while True:
        message = frame(bus, lambda m: m.arbitration_id == number and len(m.data) > 2 and m.data[0] == 0xB6)
        if message.data[1] == 0xFF:
            expect(sorted(values) == list(range(rows * columns)), f"{len(values)} of {rows * columns} numbers")
            expect(len(message.data) == 4, f"{len(message.data)} bytes of sums, expected 4")
            return [values[k] for k in range(rows * columns)] + [message.data[2] | message.data[3] << 8]
        first = message.data[1] * columns + message.data[2]
        values |= {first + k: value for k, value in enumerate(message.data[3:])}


def read(channel, kind="6x12", side="right"):
    bus, number = open_can(channel), {"right": 0x27, "left": 0x28}[side]
    if kind == "palm":
        send(bus, number, b"\xb0")
        sensor = frame(bus, lambda m: m.arbitration_id == number and len(m.data) == 2 and m.data[0] == 0xB0).data[1]
        expect(sensor == 7, f"touch sensor {sensor}, expected 7")
    while True:
        if kind == "palm":
            yield palm(bus, number)
        else:
            yield [v for k in range(5) for v in finger(bus, number, 0xB1 + k, *KINDS[kind])]


if __name__ == "__main__":
    run(read, pause=0.01)
