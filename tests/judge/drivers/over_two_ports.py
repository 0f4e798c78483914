"""``over_two_ports.py VARIANT PORT PORT``: a driver of two optoforce at once."""

import struct
import sys

import serial
from planted_defects import hand_out, say

HEAD = bytes.fromhex("aa07080a")


def main(_variant, *ports):
    """Read one packet of each port in turn, and print them as one row."""
    lines = [serial.Serial(port, 1_000_000, timeout=1) for port in ports]
    while True:
        row = {}
        for name, line in zip("lr", lines):
            row[name] = None
            while row[name] is None:
                line.read_until(HEAD)
                packet = HEAD + line.read(12)
                if len(packet) == 16 and sum(packet[:14]) & 0xFFFF == int.from_bytes(packet[14:], "big"):
                    row[name] = struct.unpack(">3h", packet[8:14])
                else:
                    say("bad sum")
        hand_out(**row)


if __name__ == "__main__":
    main(*sys.argv[1:])
