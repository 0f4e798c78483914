"""Contactile PapillArray v2 controller.

Sources: langxin11/contactile_pts_lab@2797753 (docs/manuals: PTSCOM_2.0_SPEC_SEP22; python_ws/pts_protocol.py),
m-rosette/contactile_gripper_ros2@146709d (the vendor's library).
A reading is, for every sensor and pillar, Fx Fy Fz (N) and Dx Dy Dz (mm), then for every sensor Fx Fy Fz (N) and
Tx Ty Tz (N mm), as float32.

Options: packets per second.
Not settled by the description: whether the table's end entry has an offset field (both are read); what ends a packet
whose data hold AA BB CC DD (here: the first end mark with a right sum before it); the contents of block 7 (passed
over).
"""

import struct
import time

from host import exactly, expect, follow, open_serial, run, skip_to

START, END = bytes.fromhex("55667788"), bytes.fromhex("AABBCCDD")


def packet(line):
    """The bytes between start mark and sum; 2048 is the size of the library's buffer."""
    expect(exactly(line, 4) == START, "a packet does not begin with 55 66 77 88")
    data = bytearray()
    while True:
        data += skip_to(line, END, 2048 - len(data))
        if sum(data[:-2]) & 0xFFFF == int.from_bytes(data[-2:], "little"):
            return bytes(data[:-2])
        data += END


def blocks(data):
    """Offset of each block by its type. Offsets count from the first byte behind the start mark."""
    size, at, found = data[0], 1, {}
    while kind := struct.unpack_from("<H", data, at)[0]:
        expect(kind in (1, 3, 4, 5, 6, 7) and kind not in found, f"block of type {kind}")
        found[kind] = int.from_bytes(data[at + 2 : at + 2 + size], "little")
        at += 2 + size
    return found


def listed(data, at):
    """Offsets of what is listed at ``at``: a count, then the offsets."""
    size = data[0]
    count = struct.unpack_from("<H", data, at)[0]
    return [int.from_bytes(data[at + 2 + size * k : at + 2 + size * (k + 1)], "little") for k in range(count)]


def record(data, at, form, kind):
    given, *values = struct.unpack_from("<H" + form, data, at)
    expect(given == kind, f"a record of type {given}, expected {kind}")
    return values


def pillars(data, at, form, kind):
    return [v for sensor in listed(data, at) for p in listed(data, sensor) for v in record(data, p, form, kind)]


def sensors(data, at, form, kind):
    return [v for sensor in listed(data, at) for v in record(data, sensor, form, kind)]


def read(port, rate="100"):
    line = open_serial(port, 115200)
    line.write(f"f{rate}\n".encode())  # as the library does, which sends no NUL behind this one
    time.sleep(0.1)
    line.reset_input_buffer()
    skip_to(line, END + START, 4096)
    skip_to(line, END, 4096)  # the first packet may have begun anywhere
    before = None
    while True:
        data = packet(line)
        at = blocks(data)
        count, time_us = struct.unpack_from("<IQ", data, at[1])
        if before:
            follow(count, before[0], 2**32)
            expect(time_us > before[1], f"time {time_us} us after {before[1]} us")
        before = count, time_us
        if 5 in at:
            pillars(data, at[5], "bf", 1)
        if 6 in at:
            sensors(data, at[6], "Bff", 1)
        yield pillars(data, at[3], "6f", 2) + sensors(data, at[4], "6f", 2)


if __name__ == "__main__":
    run(read)
