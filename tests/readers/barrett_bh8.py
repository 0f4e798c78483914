"""Barrett BH8-282: tactile pads of three fingers and the palm, CAN.

Sources: libbarrett@109faf6 (tactile_puck.cpp, puck.h), Robotnik pyHand@4993a1f.
A reading is one pad, as its frames come: puck, then 24 values of 12 bits / 256.

The pucks of group 0 are woken by property STAT, 5, set to 2; then TACT, 106, is set to 2, full, for each reading:
80 | property, 0, value low byte first. A value is 1/256 N/cm2.
"""

from host import expect, frame, open_can, run, send

PUCKS = (11, 12, 13, 14)
STAT, READY, TACT, FULL = 5, 2, 106, 2
ALL = 0x400


def read(channel):
    bus = open_can(channel)
    send(bus, ALL, bytes([0x80 | STAT, 0, READY, 0]))
    while True:
        for puck in PUCKS:
            ident = 0x409 | puck << 5  # to group 9, from the puck
            send(bus, puck, bytes([0x80 | TACT, 0, FULL, 0, 0, 0]))
            values = []
            for sequence in range(5):
                message = frame(bus, lambda m, ident=ident: m.arbitration_id == ident)
                expect(message.data[0] >> 4 == sequence, f"frame {message.data[0] >> 4} of a pad, expected {sequence}")
                expect(len(message.data) == 8, f"{len(message.data)} bytes in frame {sequence}")
                bits = int.from_bytes(message.data, "big")
                values += [bits >> 48 - 12 * k & 0xFFF for k in range(5 if sequence < 4 else 4)]
            yield [puck, *(value / 256 for value in values)]


if __name__ == "__main__":
    run(read, pause=0.005)
