"""iCub, iCub3 and ergoCub skin: one board of sixteen triangles.

Sources: icub-main@24c1a00 (src/libraries/icubmod/canBusSkin/CanBusSkin.cpp:615, 635, 640; skinLib/SkinDiagnostics.h),
icub-firmware-shared@62f2818 (can/canProtocolLib/iCubCanProto_classes.h, iCubCanProto_analogSensorMessages.h),
icub-firmware@b429921 (embot_prot_can_skin_periodic.cpp, embot_app_application_theSkin.cpp).
A reading is twelve values of each triangle, 0..255.

Options: board 1..14; the first and the last triangle that send.
Not settled by the description: the form of "enable" in command 50 (1 here) and its shift (2 here); in which order the
triangles of a board come (head before tail is checked, and every triangle once in a reading). Which taxels are out of
range is not looked at.
"""

import struct
import time

from host import expect, frame, open_can, run, send

NO_LOAD = 240


def read(channel, board="1", first="0", last="15"):
    bus, number = open_can(channel), int(board)
    wanted = range(int(first), int(last) + 1)
    send(bus, 0x200 | number, bytes([0x4D, 0, 40, NO_LOAD]))
    send(bus, 0x200 | number, struct.pack("<BBBBBH", 0x50, wanted[0], wanted[-1], 2, 1, 0x2200))
    time.sleep(0.5)
    send(bus, 0x200 | number, b"\x07\x00")
    try:
        found, heads = {}, {}
        while True:
            message = frame(bus, lambda m: not m.is_extended_id and m.arbitration_id & 0x7F0 == 0x400 | number << 4)
            triangle, data = message.arbitration_id & 0xF, bytes(message.data)
            expect(len(data) == 8, f"{len(data)} bytes")
            expect(triangle in wanted and triangle not in found, f"triangle {triangle} twice or unasked for")
            if data[0] == 0x40:
                expect(triangle not in heads, f"two heads of triangle {triangle}")
                heads[triangle] = data[1:8]
                continue
            expect(data[0] == 0xC0 and triangle in heads, f"byte 0 of triangle {triangle} is {data[0]:02X}")
            expect(not data[7] & 0xF, f"triangle {triangle} reports error {data[7] & 0xF}")
            found[triangle] = heads.pop(triangle) + data[1:6]
            if len(found) == len(wanted):
                yield [value for k in sorted(found) for value in found[k]]
                found = {}
    finally:
        send(bus, 0x200 | number, b"\x07\x01")


if __name__ == "__main__":
    run(read)
