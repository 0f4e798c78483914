"""CySkin CPM-finger, CAN.

Source: wngfra/can2wifi2ros@b429108 (the .ino).
A reading is sixteen values: that at place k of the four frames belongs to taxel ORDER[k].

Not settled by the description: which way round the order table goes (so taken here); whether anything must be sent
first (nothing is); that the frames come in the order of their ids.
"""

import struct

from host import expect, frame, open_can, run

IDS = (0x405, 0x407, 0x409, 0x40B)
ORDER = (11, 15, 14, 12, 9, 13, 8, 10, 6, 7, 4, 5, 2, 0, 3, 1)


def read(channel):
    bus, found = open_can(channel), []
    while True:
        message = frame(bus, lambda m: not m.is_extended_id and m.arbitration_id in IDS)
        if not found and message.arbitration_id != IDS[0]:
            continue  # the first sample may have begun before
        expect(message.arbitration_id == IDS[len(found)], f"{message.arbitration_id:03X} behind {len(found)} frames")
        expect(len(message.data) == 8, f"{len(message.data)} bytes")
        found.append(struct.unpack("<4H", message.data))
        if len(found) == len(IDS):
            values = dict(zip(ORDER, (value for part in found for value in part), strict=True))
            yield [values[taxel] for taxel in range(16)]
            found = []


if __name__ == "__main__":
    run(read)
