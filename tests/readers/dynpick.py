"""Wacoh DynPick force-torque sensor.

Source: tork-a/dynpick_driver@d5ea649.
A reading is Fx Fy Fz Mx My Mz in counts; 8192 is zero.

Not settled by the description: the order of the six numbers (taken as that); upper or lower case of the digits (both
are read); how the tick counts (one digit; not looked at). "p" is answered with 46 characters, six numbers and commas,
"0F" with the divider that "1F" sets.
"""

import string

from host import exactly, expect, open_serial, run


def read(port):
    line = open_serial(port, 921600)
    line.write(b"p")
    scales = exactly(line, 46)
    expect(len([float(each) for each in scales.split(b",")]) == 6, f"no six numbers: {scales!r}")
    line.write(b"1F0F")
    expect(exactly(line, 3)[:1] == b"1", "the divider is not 1")
    while True:
        line.write(b"R")
        answer = exactly(line, 27)
        expect(answer[25:] == b"\r\n", f"an answer does not end in CR LF: {answer!r}")
        text = answer[:25].decode("ascii", "replace")
        expect(text[0] in string.digits and set(text) <= set(string.hexdigits), f"no digits: {text!r}")
        yield [int(text[at : at + 4], 16) for at in range(1, 25, 4)]


if __name__ == "__main__":
    run(read, pause=0.01)
