"""eFlesh board with the binary dialect.

Source: Jnkdog-debug/eflesh-touch@8bbca5c (eflesh_calib/skin_stream.py, docs/2026-08-20-hardware-layout.md, the .ino).
A reading is x, y, z of the sensors 1..5 in microtesla, as float32.

Not settled by the description: nothing that a reader needs.
"""

import functools
import operator
import struct
import time

from host import exactly, expect, follow, open_serial, run, skip_to


def read(port):
    line = open_serial(port, 921600)
    time.sleep(2.5)  # opening the port restarts the board
    line.reset_input_buffer()
    skip_to(line, b"\xaa\x55", 128)
    body = exactly(line, 62)
    while functools.reduce(operator.xor, body):  # the mark may have stood within a frame
        skip_to(line, b"\xaa\x55", 128)
        body = exactly(line, 62)
    while True:
        yield list(struct.unpack("<15f", body[1:61]))
        before = body[0]
        expect(exactly(line, 2) == b"\xaa\x55", "a frame does not begin with AA 55")
        body = exactly(line, 62)
        expect(functools.reduce(operator.xor, body) == 0, f"check byte of frame {body[0]} is wrong")
        follow(body[0], before, 256)


if __name__ == "__main__":
    run(read)
