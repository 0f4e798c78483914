"""Barrett BH8-282: tactile pads of three fingers and the palm, CAN.

Sources: libbarrett@109faf6 (tactile_puck.cpp, puck.h), Robotnik pyHand@4993a1f.
A reading is one pad, as its frames come: puck, then 24 values of 12 bits / 256.

Not settled by the description: the request (here the property TACT, 106, is set to 2, full, as Barrett's pucks take a
property: 80 | property, 0, value low byte first); whether it must be repeated for each answer (here it is); the
direction bits of a request's id (from the host, 0, to the puck); the unit.
"""

from host import expect, frame, open_can, run, send

PUCKS = (11, 12, 13, 14)
TACT, FULL = 106, 2


def read(channel):
    bus = open_can(channel)
    while True:
        for puck in PUCKS:
            ident = 0x409 | puck << 5  # to group 9, from the puck
            send(bus, puck, bytes([0x80 | TACT, 0, FULL, 0, 0, 0]))
            values = []
            for sequence in range(5):
                message = frame(bus, lambda m, ident=ident: m.arbitration_id == ident)
                expect(message.data[0] >> 4 == sequence, f"frame {message.data[0] >> 4} of a pad, expected {sequence}")
                count = 5 if sequence < 4 else 4
                bits = int.from_bytes(message.data, "big")
                top = 8 * len(message.data) - 4  # behind the sequence
                expect(top >= 12 * count, f"{len(message.data)} bytes in frame {sequence}")
                values += [bits >> top - 12 * (k + 1) & 0xFFF for k in range(count)]
            yield [puck, *(value / 256 for value in values)]


if __name__ == "__main__":
    run(read, pause=0.005)
