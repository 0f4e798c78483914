"""BrainCo Revo2 Touch on CAN FD.

Sources: bc-stark-sdk 2.0.8 (main_mod.pyi and what it sends), BrainCoTech/stark-serialport-example@b27b922
(python/common_socketcan.py, python/revo2_canfd).
A reading is normal, tangential and direction of thumb to little, then five proximities, then five states.

Options: left or right; master.
Not settled by the description: which function and values enable the sensors (function 16, five ones, as over RS-485);
the byte order inside a 32-bit proximity beyond "high word first"; the value of the touch vendor on other hands (1 is
asked for); what the padding holds (not looked at).
"""

import struct

from host import expect, frame, open_can, run, send
from modbus import crc16

FD_SIZES = (8, 12, 16, 20, 24, 32, 48, 64)


def ask(bus, slave, master, body, size):
    """Data behind unit and function; an answer's id tells its true length, and the rest of the frame is padding."""
    adu = bytes([slave]) + body
    adu += crc16(adu)
    padded = adu.ljust(next(n for n in FD_SIZES if n >= len(adu)), b"\0")
    send(bus, slave << 16 | master << 8 | len(adu), padded, extended=True, fd=True)
    message = frame(bus, lambda m: m.is_extended_id and m.arbitration_id >> 8 == slave << 8 | master)
    length = message.arbitration_id & 0xFF
    expect(message.is_fd and length == size + 4 and len(message.data) >= length, f"an answer of {length} bytes")
    answer = bytes(message.data[:length])
    expect(crc16(answer[:-2]) == answer[-2:], f"CRC of {answer.hex(' ')} is wrong")
    expect(answer[:2] == adu[:2], f"an answer begins {answer[:2].hex(' ')}, asked {adu.hex(' ')}")
    return answer[2:-2]


def registers(bus, ids, function, address, count):
    data = ask(bus, *ids, struct.pack(">BHH", function, address, count), 1 + 2 * count)
    expect(data[0] == 2 * count, f"{data[0]} bytes announced, expected {2 * count}")
    return list(struct.unpack(f">{count}H", data[1:]))


def read(channel, side="left", master="1"):
    bus, ids = open_can(channel), ({"left": 0x7E, "right": 0x7F}[side], int(master))
    expect(registers(bus, ids, 3, 0x0385, 1)[0] in (1, 2, 3, 4), "an unknown kind of hand")
    registers(bus, ids, 4, 0x0BB8, 10)
    serial = struct.pack(">10H", *registers(bus, ids, 4, 0x0BC2, 10)).rstrip(b"\0")
    expect(serial.startswith(b"BCXT"), f"serial number {serial!r} is not a touch hand's")
    expect(registers(bus, ids, 3, 0x03CA, 1) == [1], "the hand's sensors are not capacitive")
    enable = struct.pack(">BHHB5H", 16, 0x0FA0, 5, 10, *[1] * 5)
    expect(ask(bus, *ids, enable, 4) == enable[1:5], "the answer to function 16 names other registers")
    while True:
        words = registers(bus, ids, 4, 0x1068, 29) + registers(bus, ids, 4, 0x1068 + 29, 1)
        proximities = [high << 16 | low for high, low in zip(words[15:25:2], words[16:25:2], strict=True)]
        expect(not any(word & 0xFF for word in words[25:]), f"states {words[25:]}")
        yield words[:15] + proximities + [word & 0xFF for word in words[25:]]


if __name__ == "__main__":
    run(read, pause=0.01)
