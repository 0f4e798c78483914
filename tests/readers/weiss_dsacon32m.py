"""Weiss DSACON32m, the controller of a Schunk SDH.

Source: ipab-slmc/SDHLibrary-CPP@0217d4e (dsa.cpp, dsa.h, crc.h, crc.cpp).
A reading is the 12-bit value of every texel, matrix by matrix.

Options: rle (what a run-length frame holds is asked for) or plain; a rate.
Not settled by the description: whether bit 0 of a frame's flags tells that the frame is run-length coded (here: it must
equal what was asked for); which byte the 18-byte controller info lacks (only error and length are looked at); a run of
length 0 (an error here).
"""

import struct

from host import Broken, exactly, expect, open_serial, run


def _table():
    """The table of polynomial 1021 as for bytes that enter at the high end."""
    for entry in range(256):
        crc = entry << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
        yield crc


TABLE = list(_table())


def crc16(data):
    crc = 0xFFFF
    for byte in data:  # but the bytes enter at the low end
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return struct.pack("<H", crc)


def write(line, kind, payload=b""):
    body = struct.pack("<BH", kind, len(payload)) + payload
    line.write(b"\xaa\xaa\xaa" + body + (crc16(body) if payload else b""))


def message(line):
    expect(exactly(line, 3) == b"\xaa\xaa\xaa", "a message does not begin with AA AA AA")
    head = exactly(line, 3)
    kind, size = struct.unpack("<BH", head)
    payload = exactly(line, size)
    if size:
        expect(exactly(line, 2) == crc16(head + payload), f"CRC of a message {kind:02X} is wrong")
    return kind, payload


def ask(line, kind, size, payload=b""):
    """The answer, whose error word is 0; up to 5 pushed frames before it are passed over."""
    write(line, kind, payload)
    for _ in range(6):
        given, answer = message(line)
        if given == kind:
            expect(len(answer) == size, f"answer to {kind:02X}: {len(answer)} bytes, expected {size}")
            expect(answer[:2] == b"\0\0", f"answer to {kind:02X}: error {answer[:2].hex(' ')}")
            return answer
        expect(given == 0, f"a message {given:02X} while {kind:02X} is waited for")
    raise Broken(f"no answer to {kind:02X}")


def texels(data, count, coded):
    units = struct.unpack(f"<{len(data) // 2}H", data)
    if coded:
        expect(all(unit >> 12 for unit in units), "a run of length 0")
        units = [unit & 0xFFF for unit in units for _ in range(unit >> 12)]
    expect(len(data) % 2 == 0 and len(units) == count, f"{len(units)} texels, expected {count}")
    expect(max(units) < 4096, "a texel above 4095")
    return list(units)


def read(port, coding="rle", rate="30"):
    line = open_serial(port, 115200, seconds=3.0)
    ask(line, 0x03, 2, struct.pack("<BH", 0, 0))  # stop, whatever it did before
    line.reset_input_buffer()
    ask(line, 0x01, 18)
    matrices = struct.unpack_from("<H", ask(line, 0x02, 12), 2)[0]
    cells = [struct.unpack_from("<HH", ask(line, 0x0B, 52, bytes([k])), 10) for k in range(matrices)]
    count = sum(x * y for x, y in cells)
    coded = coding == "rle"
    ask(line, 0x03, 2, struct.pack("<BH", 0x80 | coded, int(rate)))
    before = -1
    while True:
        kind, payload = message(line)
        expect(kind == 0, f"a message {kind:02X} among frames")
        time_ms, flags = struct.unpack_from("<IB", payload)
        expect(time_ms >= before, f"time {time_ms} ms after {before} ms")
        expect(flags & 1 == coded, f"flags {flags:02X}, asked for {coding}")
        before = time_ms
        yield texels(payload[5:], count, coded)


if __name__ == "__main__":
    run(read)
