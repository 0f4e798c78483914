"""``over_resultant.py VARIANT PORT``: drivers of paxini_px6ax, which sends a resultant beside its 31 taxels."""

import struct
import sys
import time

import serial
from planted_defects import Defect, say

ASK = bytes.fromhex("55aa09000300fbf00300007b00")


def main(variant, port):
    line = serial.Serial(port, 921600, timeout=0.15)
    defect, first = Defect(variant), None
    ask = ASK + bytes([-sum(ASK) & 0xFF])
    while True:
        line.reset_input_buffer()
        line.write(ask)
        answer = line.read(14 + 123 + 1)
        if len(answer) != 138 or answer[:2] != b"\xaa\x55" or sum(answer) & 0xFF:
            say("no good answer")
            while line.read(1):
                line.reset_input_buffer()
            continue
        data = answer[14:-1]
        resultant = struct.unpack("2bB", data[:3])
        first = first or resultant
        taxels = defect.values([n for k in range(31) for n in struct.unpack("2bB", data[30 + 3 * k : 33 + 3 * k])])
        if variant == "frozenresultant":
            resultant = first
        defect.hand_out(resultant=resultant, taxels=taxels)
        time.sleep(0.012)


if __name__ == "__main__":
    main(*sys.argv[1:])
