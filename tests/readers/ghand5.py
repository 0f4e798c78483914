"""GLI GHand 5 over Modbus RTU.

Source: gli-sdk/GHand-Python-SDK@3ebbadf (its codec files).
A reading is Fx Fy Fz of each finger, then Fx Fy Fz of each taxel, thumb to little: int8, int8, uint8, 0.1 N.

Options: right or left.
Not settled by the description: which byte of a taxel stands in the
high half of a register (the first here); the low bytes of the first sixteen registers (not looked at); in how many
requests the taxels are read (one a finger here); the order of the fingers.
"""

import struct

from host import expect, open_serial, run
from modbus import Client

TAXELS = (38, 31, 31, 31, 31)


def triples(data):
    return [value for at in range(0, len(data), 3) for value in struct.unpack_from("bbB", data, at)]


def read(port, side="left"):
    hand = Client(open_serial(port, 1_000_000), {"left": 0x31, "right": 0x32}[side])
    expect(any(hand.registers(4, 0x1000, 8)), "the hand has no name")
    while True:
        state, *forces = hand.registers(4, 0x1080, 16)
        expect(state & 0xFF == 0, f"error {state & 0xFF:02X}")
        expect(state >> 8 == 0x1F, f"fingers {state >> 8:05b} are valid, expected all")
        reading, at = triples(bytes(force >> 8 for force in forces)), 0x1090
        for count in TAXELS:
            registers = hand.registers(4, at, -(-3 * count // 2))
            reading += triples(struct.pack(f">{len(registers)}H", *registers)[: 3 * count])
            at += len(registers)
        yield reading


if __name__ == "__main__":
    run(read, pause=0.01)
