"""OYMotion ROHand AP001 over RS-485.

Sources: oymotion/roh_gen2_demos@026e86b (force_on_rohand/force_chart.py:120-175, 332-372; common/heat_map_dot.py:8-14;
common/roh_registers_v2.py), oymotion/roh_firmware@4697700 (protocol/OHandModBusRTUProtocol_EN.md).
A reading is, part by part (thumb to little, palm): all dots, 0..255, or normal, tangential, direction of each triple
(null where invalid) and then the palm's dots.

Not settled by the description: whether a host zeroes before it reads (not done here); which dots are dummies (all are
given); whether the values of a triple have a sign (read without).
"""

from host import expect, open_serial, run
from modbus import Client

DOTS, TRIPLES = (18, 30, 30, 30, 16, 28), (3, 6, 6, 6, 3, 28)


def dots(registers):
    return [byte for value in registers for byte in (value >> 8, value & 0xFF)]


def swapped(registers):
    return [None if value == 0xFFFF else value >> 8 | (value & 0xFF) << 8 for value in registers]


def read(port):
    hand = Client(open_serial(port, 115200), 2)
    kind = hand.registers(3, 1003, 1)[0]
    expect(kind == 0x2001, f"hardware type {kind:04X}, expected 2001")
    force = hand.registers(3, 1265, 1)[0] >> 8
    expect(force in (0, 1), f"force type {force}")
    counts = TRIPLES if force else DOTS
    while True:
        parts = [hand.registers(3, 2000 + 100 * part, count) for part, count in enumerate(counts)]
        yield [v for k, part in enumerate(parts) for v in (swapped(part) if force and k < 5 else dots(part))]


if __name__ == "__main__":
    run(read, pause=0.01)
