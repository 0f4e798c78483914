"""``over_letters.py VARIANT PORT``: drivers of dynpick, which answers the letter R with hexadecimal digits."""

import sys
import time

import serial
from planted_defects import Defect, hand_out, say

NAMES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
IN_UNITS = ("ten", "thousand", "kilogram", "percent", "units")


def main(variant, port):
    line = serial.Serial(port, 921600, timeout=0.15)
    defect = Defect(variant, limit=200, exchange=(3, 4))
    old = None
    while True:
        if variant != "noresync":
            line.reset_input_buffer()
        line.write(b"R")
        answer = line.read(27)
        whole = len(answer) == 27 and (answer[-2:] == b"\r\n" or variant == "noresync")
        try:
            counts = [int(answer[1 + 4 * k : 5 + 4 * k], 16) - 8192 for k in range(6)] if whole else None
        except ValueError:
            counts = None
        if counts is None:
            if variant == "timeout" and old:
                hand_out(**old)
            else:
                say("no good answer")
            while variant not in ("timeout", "noresync") and line.read(1):
                line.reset_input_buffer()
            continue
        values = defect.values(counts)
        if variant in IN_UNITS:
            values = [defect.in_unit(value, 50.0 if k < 3 else 1500.0) for k, value in enumerate(values)]
        old = dict(zip(NAMES, values))
        defect.hand_out(**old)
        time.sleep(0.006)


if __name__ == "__main__":
    main(*sys.argv[1:])
