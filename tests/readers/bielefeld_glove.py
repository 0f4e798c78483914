"""Bielefeld tactile glove.

Source: ubi-agni/TactileGlove@59a0ef6 (libio/SerialInput.cpp:115-157).
A reading is 4095 - v of the 64 channels, by index.

Not settled by the description: which ADC channel belongs to an index (here: always the same one); what a host does
that starts within a packet (here: bytes are passed over until a packet of index 0 begins).
"""

import os
import select
import termios
import tty

from host import expect, run

CHANNELS = 64


def wait(line):
    """The driver throws after 100 ms; here a busy machine is forgiven."""
    expect(select.select([line], [], [], 0.5)[0], "silence of 0.5 s")


def packet(line):
    """Five bytes in one piece: the driver throws otherwise."""
    wait(line)
    data = os.read(line, 5)
    expect(len(data) == 5, f"a packet in pieces: {data.hex(' ')}")
    return data


def first(line):
    """The rest of a packet of index 0, found by its first two bytes and its last."""
    data = packet(line)
    while not (data[:2] == b"\x3c\x01" and data[4] == 0):
        wait(line)
        data = data[1:] + os.read(line, 1)
    return data


def read(port):
    line = os.open(port, os.O_RDONLY | os.O_NOCTTY)
    tty.setraw(line)
    settings = termios.tcgetattr(line)
    settings[4] = settings[5] = termios.B115200
    settings[6][termios.VMIN], settings[6][termios.VTIME] = 0, 0
    termios.tcsetattr(line, termios.TCSAFLUSH, settings)
    data, converters = first(line), {}
    while True:
        reading = []
        for index in range(CHANNELS):
            expect(data[0] == 0x3C + index, f"packet {data[0]:02X} where {0x3C + index:02X} was expected")
            expect(data[1] == 0x01 and data[4] == 0x00, f"packet {data.hex(' ')}")
            expect(converters.setdefault(index, data[2] >> 4) == data[2] >> 4, f"index {index} changed its converter")
            reading.append(4095 - ((data[2] & 0x0F) << 8 | data[3]))
            data = packet(line) if index < CHANNELS - 1 else b""
        yield reading
        data = packet(line)


if __name__ == "__main__":
    run(read)
