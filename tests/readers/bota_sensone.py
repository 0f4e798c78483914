"""Bota SensONE.

Source: tud-phi/bota_ft_sensors@4b98f94 (senseone.py).
A reading is Fx Fy Fz (N), Mx My Mz (N m) and the temperature (deg C), as float32.

Not settled by the description: ends of lines (commands are sent without, bytes between an answer and the next mark are
passed over); whether a sensor says App Init when the port is opened (what came before is lost, so that after 1 s it is
taken as said); the X of the answer r,0,X,0 (taken as the command's letter); the bits of the status word (must
be 0 here).
"""

import contextlib
import struct

from host import Broken, exactly, expect, open_serial, run, skip_to


def crc16(data):
    """CRC-16/X-25."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)


def read(port):
    line = open_serial(port, 460800, seconds=1.0)
    with contextlib.suppress(Broken):
        skip_to(line, b"App Init", 1 << 16)
    for command in (b"C", b"c,0,1,0,4", b"f,512,0,0,1", b"R"):
        line.write(command)
        skip_to(line, b"r,0,%c,0" % command[0], 1 << 16)
    skip_to(line, b"\xaa", 16)
    before = None
    while True:
        body = exactly(line, 34)
        expect(exactly(line, 2) == crc16(body), "CRC of a frame is wrong")
        status, *values, time_us, temperature = struct.unpack("<H6fIf", body)
        expect(status == 0, f"status {status:04X}")
        expect(before is None or 0 < (time_us - before) % 2**32 < 2**31, f"time {time_us} us after {before} us")
        before = time_us
        yield [*values, temperature]
        expect(exactly(line, 1) == b"\xaa", "a frame does not begin with AA")


if __name__ == "__main__":
    run(read)
