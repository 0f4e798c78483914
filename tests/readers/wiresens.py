"""WiReSens.

Source: WiReSens-Toolkit/WiReSensPy@2e9297c (GenericReceiver.py:33-57).
A reading is one scan: the values of its packets by start index, the first of which is 0.

Options: values in a packet, as the host's configuration has it.
Not settled by the description: whether packet numbers count the packets of all sensors or of one (of one here); which
sensor ids there are (one is read).
"""

import struct

from host import expect, follow, open_serial, run

END = b"wr"


def read(port, values="120"):
    count = int(values)
    size = 1 + 2 + 2 * count + 4
    line = open_serial(port, 250_000)
    line.read_until(END)  # the first may have begun anywhere, and its end may be two bytes of its values
    line.read_until(END)
    before = sensor = None
    scan = []
    while True:
        piece = line.read_until(END)
        expect(len(piece) == size + 2 and piece.endswith(END), f"{len(piece)} bytes, expected {size + 2}")
        who, start, *numbers, packet = struct.unpack(f"<bH{count}HI", piece[:-2])
        expect(sensor in (None, who), f"sensor {who}, before {sensor}")
        if before is not None:
            follow(packet, before, 2**32)
            if (packet - before) % 2**32 != 1:
                scan = []  # a part of it is lost
        before, sensor = packet, who
        if start == 0 and scan:
            yield scan
            scan = []
        if start == 0 or scan:  # the first scan may have begun before
            expect(start == len(scan), f"start index {start} after {len(scan)} values")
            scan += numbers


if __name__ == "__main__":
    run(read)
