"""XELA uSkin on CAN, 16 taxels (older) or 4 x 6.

Sources: o2as/ur-o2as@97adced (xela_sensor.py:37), ARQ-CRISP/uskin_can_drivers@081807b (convertCanIDtoIndex).
A reading is X, Y, Z of every taxel, in raw counts: taxel 0..15, or row by row.

Options: 16 or 4x6.
Not settled by the description: the bytes 0 and 7 of a frame (not looked at); the order in which the 16 taxels come
(ascending here); ids of other boards.
"""

import struct

from host import expect, frame, open_can, run, send

IDS = {"16": [0x710 + k for k in range(16)], "4x6": [0x100 | r << 4 | c for c in range(6) for r in range(4)]}


def read(channel, kind="16"):
    ids, bus = IDS[kind], open_can(channel)
    send(bus, 0x201, b"\x07\x00")
    try:
        taxels = {}
        while True:
            message = frame(bus, lambda m: not m.is_extended_id and m.arbitration_id in ids)
            number = message.arbitration_id
            if not taxels and number != ids[0]:
                continue  # the first scan may have begun before
            expect(number == ids[len(taxels)], f"{number:03X} where {ids[len(taxels)]:03X} was expected")
            expect(len(message.data) == 8 and not message.is_fd, f"{len(message.data)} bytes")
            taxels[number] = struct.unpack(">xHHHx", message.data)
            if len(taxels) == len(ids):
                yield [v for number in sorted(taxels) for v in taxels[number]]
                taxels = {}
    finally:
        send(bus, 0x201, b"\x07\x01")


if __name__ == "__main__":
    run(read)
