"""SingleTact on its USB or Arduino interface.

Sources: philip-long/singletact-python-wrapper@659796f (singletact_library.py), SingleTact/NETInterface@30c0e82
(lines 402-405: a USB board's answer begins with AA).
A reading is the 16-bit value; without a force it is 255.

Not settled by the description: it calls the read command 16 bytes long but names 15 (a 00 fills it up here); the byte
behind the address (ignored); whether the driver subtracts the 255 (not done here). Time in the answer and in the data
are compared: the data's is that of the conversion.
"""

import contextlib
import itertools
import struct
import time

from host import exactly, expect, open_serial, run

ADDRESS, TIMEOUT, READ = 0x04, 0x64, 0x01


def ask(line, number, location, count):
    command = bytes([ADDRESS, TIMEOUT, number, READ, location, count, 0xFF])
    line.write(b"\xff" * 4 + command + b"\xfe" * 4 + b"\0")
    head = exactly(line, 12)
    expect(head[0] in (0xFF, 0xAA) and head[1:4] in (b"\xff" * 3, b"\xaa" * 3), f"an answer begins {head[:4].hex(' ')}")
    expect(head[4] == ADDRESS, f"address {head[4]}")
    expect(head[6] == number, f"answer to question {head[6]}, asked {number}")
    expect(head[11] == count, f"{head[11]} bytes announced, asked {count}")
    data = exactly(line, count)
    expect(exactly(line, 4) == b"\xfe" * 4, "an answer does not end in FE FE FE FE")
    return struct.unpack(">I", head[7:11])[0], data


def read(port):
    line = open_serial(port, 115200)
    with contextlib.suppress(OSError):  # a bare pty has no modem lines
        line.dtr = True
        time.sleep(1)
        line.dtr = False
        time.sleep(1)
        line.rts = True
    line.reset_input_buffer()
    numbers = (k % 256 for k in itertools.count())
    for location in (0, 32, 64, 96):
        ask(line, next(numbers), location, 32)
    before = 0
    while True:
        stamp, data = ask(line, next(numbers), 128, 6)
        expect(stamp >= before, f"time {stamp} after {before}")
        before = stamp
        felt = struct.unpack(">H", data[2:4])[0]
        expect((stamp - felt) & 0xFFFF < 10_000, f"felt at {felt}, told at {stamp & 0xFFFF}, in 0.1 ms")
        yield [struct.unpack(">H", data[4:])[0]]


if __name__ == "__main__":
    run(read, pause=0.01)
