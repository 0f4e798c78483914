"""RobotEra XHand 1 over RS-485.

Source: wanweiwei07/wrs@552ce47 (wrs/robot_con/xhand/xhand_x.py, data_type.py), and the records of
yoimika/xhand_control_python@b61a82d (include/data_type.hpp), where z is unsigned.
A reading is, for each of five fingers, Fx Fy Fz of the tip and x y z of its 120 points, as int8 and uint8 counts.

Not settled by the description: the sensor byte and the spare words of a joint (not looked at); whether a host may ask
without moving (here: gains 0).
"""

import struct

from host import exactly, expect, open_serial, run

PC, HAND = 0xFE, 0x80


def crc16(data):
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return struct.pack("<H", crc)


def ask(line, command, data=b""):
    frame = struct.pack("<BBBBBH", 0x55, 0xAA, PC, HAND, command, len(data)) + data
    line.write(frame + crc16(frame))
    head = exactly(line, 7)
    expect(head[:5] == bytes([0x55, 0xAA, HAND, PC, command]), f"an answer to {command:02X} begins {head.hex(' ')}")
    body = exactly(line, struct.unpack("<H", head[5:])[0])
    expect(exactly(line, 2) == crc16(head + body), f"CRC of an answer to {command:02X} is wrong")
    return body


def joint(number):
    return struct.pack("<HhhhfHH8x", number, 0, 0, 0, 0.0, 300, 3)


def read(port):
    line = open_serial(port, 3_000_000)
    ask(line, 0x13)
    move = b"".join(joint(k) for k in range(12))
    while True:
        body = ask(line, 0x02, move)
        expect(len(body) == 12 * 24 + 5 * 384, f"{len(body)} bytes, expected 2208")
        for k in range(12):
            expect(body[24 * k] == k, f"joint {body[24 * k]} in the place of {k}")
        yield [v for finger in range(5) for v in struct.unpack_from("<" + "bbB" * 121, body, 288 + 384 * finger)]


if __name__ == "__main__":
    run(read, pause=0.01)
