"""Weiss WTS.

Sources: ksatyaki/wts_driver@82c46ac (src/wts_driver.cpp), CNCR-NTU/wts-ft@bbb00b0 (crc16.py).
A reading is every cell.

Options: frames sent every 20 ms (periodic) or asked for one by one (single); values with the low byte first as
wts_driver takes them (low_first), or with the high byte first and divided by 16 as wts-ft does (sixteenths).
Not settled by the description: which of the two drivers is right; what stands before the values (as in the frame of the
DSACON32m: time and flags, here behind the status, too, where a frame is asked for); the CRC's polynomial (that of the
DSACON32m); flags of the start command (0 here); the baud rate.
"""

import struct

from host import exactly, expect, open_serial, run
from weiss_dsacon32m import crc16


def write(line, kind, payload=b""):
    packet = struct.pack("<3sBH", b"\xaa" * 3, kind, len(payload)) + payload
    line.write(packet + crc16(packet))


def message(line):
    head = exactly(line, 6)
    expect(head[:3] == b"\xaa" * 3, f"a message begins {head[:3].hex(' ')}")
    payload = exactly(line, struct.unpack("<H", head[4:])[0])
    expect(exactly(line, 2) == crc16(head + payload), f"CRC of a message {head[3]:02X} is wrong")
    return head[3], payload


def ask(line, kind, payload=b""):
    write(line, kind, payload)
    given, answer = message(line)
    expect(given == kind, f"a message {given:02X} while {kind:02X} is waited for")
    expect(answer[:2] == b"\0\0", f"answer to {kind:02X}: status {answer[:2].hex(' ')}")
    return answer[2:]


def read(port, how="periodic", taken="low_first"):
    line = open_serial(port, 115200)
    columns, rows, _, _, most = struct.unpack("<5H", ask(line, 0x30))
    if how == "periodic":
        ask(line, 0x21, struct.pack("<BH", 0, 20))
    before = -1
    while True:
        kind, frame = message(line) if how == "periodic" else (0, ask(line, 0x20, b"\0"))
        expect(kind == 0 and len(frame) == 5 + 2 * columns * rows, f"a message {kind:02X} of {len(frame)} bytes")
        time_ms = struct.unpack_from("<I", frame)[0]
        expect(time_ms >= before, f"time {time_ms} ms after {before} ms")
        before = time_ms
        if taken == "sixteenths":
            values = [value // 16 for value in struct.unpack_from(f">{columns * rows}H", frame, 5)]
        else:
            values = list(struct.unpack_from(f"<{columns * rows}H", frame, 5))
        expect(max(values) <= most, f"a value of {max(values)}, full scale is {most}")
        yield values


if __name__ == "__main__":
    run(read)
