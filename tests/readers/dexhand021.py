"""DexRobot DexHand021, CAN FD.

Source: DexRobot/pyzlg_dexhand@316575a (dexhand_protocol/__init__.py, messages.py, commands.py).
A reading is one frame of a finger, as the driver parses it: board, normal force (N), its delta, tangential force (N),
its delta, direction (degrees), proximity, temperature (deg C).

Options: left or right.
Not settled by the description: the bytes of a configuration request (none is sent, so the hand must send by itself);
the meaning of the deltas; which of the six boards have a tactile sensor; whether frames carry 46 or 48 bytes (both
are read).
"""

import math
import struct

from host import expect, frame, open_can, run


def read(channel, side="right"):
    first = {"left": 1, "right": 7}[side]
    bus = open_can(channel)
    while True:
        message = frame(bus, lambda m: not m.is_extended_id and 0x180 + first <= m.arbitration_id < 0x186 + first)
        expect(message.is_fd, "a classic frame")
        if len(message.data) < 42:
            continue  # a board without tactile sensor
        expect(len(message.data) in (42, 46, 48), f"{len(message.data)} bytes")
        normal, normal_delta, tangential, tangential_delta, direction, proximity, celsius = struct.unpack_from(
            "<fIfIHII", message.data, 16
        )
        expect(math.isfinite(normal) and math.isfinite(tangential), "a force that is no number")
        board = message.arbitration_id - 0x180
        yield [board, normal, normal_delta, tangential, tangential_delta, direction, proximity, celsius]


if __name__ == "__main__":
    run(read)
