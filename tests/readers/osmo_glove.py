"""OSMO glove.

Source: jessicayin/osmo_tactile_glove@e0465b6 (firmware bowie.proto; labs/glove2robot/utils/bowie.py).
A reading is one message of a magnetometer, as the driver hands it out: index, finger, link, sensor, x, y, z (float32).
Messages of an orientation are looked at and passed over. The order in which a board's messages come is not used.
"""

import struct

from host import Broken, expect, open_serial, run


def unstuffed(block):
    """COBS: each code byte says how many bytes stand before the next zero."""
    out, at = bytearray(), 0
    while at < len(block):
        code = block[at]
        expect(code and at + code <= len(block), f"a COBS code that points out of the block: {block.hex(' ')}")
        out += block[at + 1 : at + code]
        at += code
        if code < 0xFF and at < len(block):
            out.append(0)
    return bytes(out)


def varint(data, at):
    value = shift = 0
    while True:
        expect(at < len(data) and shift < 64, "a varint without end")
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return value, at


def fields(data):
    """Fields of a protobuf message by number; what is zero is not sent."""
    found, at = {}, 0
    while at < len(data):
        key, at = varint(data, at)
        if key & 7 == 0:
            value, at = varint(data, at)
        elif key & 7 == 2:
            length, at = varint(data, at)
            value, at = data[at : at + length], at + length
        elif key & 7 == 5:
            value, at = struct.unpack_from("<f", data, at)[0], at + 4
        else:
            raise Broken(f"wire type {key & 7} of field {key >> 3}")
        expect(at <= len(data), f"field {key >> 3} is cut off")
        found[key >> 3] = value
    return found


def read(port):
    line = open_serial(port, 9600)
    line.read_until(b"\0")  # the first may have begun anywhere
    before = {}
    while True:
        block = line.read_until(b"\0")
        expect(block.endswith(b"\0"), f"no end of a block within {line.timeout} s: {block.hex(' ')}")
        message = fields(unstuffed(block[:-1]))
        expect(set(message) <= {1, 2, 3, 4, 5, 6} and len({5, 6} & set(message)) == 1, f"fields {sorted(message)}")
        if 6 in message:
            quat = fields(message[6])
            length = sum(quat.get(k, 0.0) ** 2 for k in (3, 4, 5, 6)) ** 0.5
            expect(0.9 < length < 1.1, f"an orientation of length {length}")
            continue
        mag = fields(message[5])
        expect(set(mag) <= {1, 2, 3, 4, 5}, f"fields of Mag {sorted(mag)}")
        finger, link, sensor = (message.get(k, 0) for k in (2, 3, 4))
        expect(1 <= finger <= 5, f"finger {finger}")
        stamp = mag.get(1, 0) * 10**9 + mag.get(2, 0)
        expect(stamp > before.get((finger, link, sensor), -1), f"time {stamp} ns of sensor {sensor} does not grow")
        before[finger, link, sensor] = stamp
        yield [message.get(1, 0), finger, link, sensor, *(mag.get(k, 0.0) for k in (3, 4, 5))]


if __name__ == "__main__":
    run(read)
