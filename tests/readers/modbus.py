"""A Modbus RTU client for the readers: functions 3, 4, 6 and 16, every byte of the answer checked."""

import struct

from host import Broken, exactly, expect


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


class Client:
    def __init__(self, line, unit):
        self.line, self.unit = line, unit

    def _ask(self, body, length):
        """The answer's data behind unit and function, ``length`` bytes."""
        self.line.write(request := (sent := bytes([self.unit]) + body) + crc16(sent))
        head = exactly(self.line, 2)
        if head == bytes([self.unit, body[0] | 0x80]):
            code = exactly(self.line, 3)
            expect(crc16(head + code[:1]) == code[1:], "CRC of an exception is wrong")
            raise Broken(f"exception {code[0]} to {request.hex(' ')}")
        expect(head == request[:2], f"answer begins {head.hex(' ')}, asked {request.hex(' ')}")
        data = exactly(self.line, length)
        expect(exactly(self.line, 2) == crc16(head + data), f"CRC of {(head + data).hex(' ')} is wrong")
        return data

    def registers(self, function, address, count):
        data = self._ask(struct.pack(">BHH", function, address, count), 1 + 2 * count)
        expect(data[0] == 2 * count, f"{2 * count} bytes asked, {data[0]} announced")
        return list(struct.unpack(f">{count}H", data[1:]))

    def write(self, address, value):
        body = struct.pack(">BHH", 6, address, value)
        expect(self._ask(body, 4) == body[1:], "the answer to function 6 is not its echo")

    def write_many(self, address, values):
        body = struct.pack(f">BHHB{len(values)}H", 16, address, len(values), 2 * len(values), *values)
        expect(self._ask(body, 4) == body[1:5], "the answer to function 16 names other registers")
