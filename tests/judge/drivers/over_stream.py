"""``over_stream.py VARIANT PORT [AXES]``: drivers of optoforce, a stream of packets with a counter and a checksum."""

import struct
import sys
import termios
import time

import serial
from planted_defects import Defect, hand_out, say

NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")
PER_UNIT = (26.416666666666668, 28.803333333333335, 3.0245, 1000.0, 1000.0, 1000.0)
IN_UNITS = ("ten", "thousand", "kilogram", "percent", "units")
GONE = (OSError, termios.error)
"""Exceptions that pyserial raises for a lost port."""


def open_again(port):
    """Return the port once it can be opened again."""
    while True:
        try:
            return serial.Serial(port, 1_000_000, timeout=0.4)
        except serial.SerialException:
            time.sleep(0.02)


def main(variant, port, axes="3"):
    axes = int(axes)
    head, size = b"\xaa\x07\x08" + bytes([4 + 2 * axes]), 10 + 2 * axes
    defect = Defect(variant, limit=60, exchange=(axes - 3, axes - 2))
    line = serial.Serial(port, 1_000_000, timeout=0.4)
    data, last, old, smooth, unplugged = b"", None, None, (0,) * axes, 0
    while True:
        try:
            more = line.read(max(1, min(512, line.in_waiting)))
        except GONE as error:
            unplugged += 1
            if variant == "second" and unplugged == 1:
                say("port lost, opening it again")
                data, line = b"", open_again(port)
                continue
            if variant == "second":
                sys.exit(0)
            if variant == "stale" and old:
                for _ in range(60):  # the defect: it hands out the last reading until the port is back
                    hand_out(**old)
                    time.sleep(0.01)
            say(f"port lost: {error}")
            sys.exit(1)
        if not more:
            if variant == "stale" and old:
                hand_out(**old)
            elif variant != "blocks":
                say("nothing comes")
            continue
        data += more
        while len(data) >= size:
            if data[:4] != head:
                if variant == "noresync":
                    data = data[size:]
                    continue
                at = data.find(head, 1)
                data = data[at:] if at > 0 else data[-3:]
                continue
            packet, data = data[:size], data[size:]
            if variant != "nosum" and sum(packet[:-2]) & 0xFFFF != int.from_bytes(packet[-2:], "big"):
                say("bad sum")
                data = packet[4:] + data  # a frame may have been cut: the next one's head may be in it
                continue
            number, status, *counts = struct.unpack(f">HH{axes}h", packet[4:-2])
            if variant == "dies" and last is not None and number != (last + 1) & 0xFFFF:
                raise RuntimeError("a packet is missing")
            if variant == "wrap" and last is not None and number < last:
                continue  # "an old packet"
            if number == last and variant != "doubled":
                say("a packet came twice")
                continue
            last = number
            values = defect.values(counts)
            if variant == "filter":
                smooth = values = [round(0.6 * was + 0.4 * now, 2) for was, now in zip(smooth, values)]
            if variant in IN_UNITS:
                values = [defect.in_unit(value, per) for value, per in zip(values, PER_UNIT)]
            old = {"n": number, "status": status, **dict(zip(NAMES, values))}
            defect.hand_out(**old)


if __name__ == "__main__":
    main(*sys.argv[1:])
