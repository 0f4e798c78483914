"""PaXini PX-6AX GEN2 behind its control box.

Source: Gabriel-Ning/paxini_driver@113ab44 (paxini_driver.py:94-96, 165; the PDF of the control box's protocol V1.5).
A reading is Fx, Fy (int8) and Fz (uint8) of every taxel, in counts.

Options: mode (5: most GEN2), port of the connector, taxels to read.
Not settled by the description: the order of mode, port and version (here version, mode, port); the meaning of the
finger status (not looked at); the unit; whether more taxels than the driver reads may be asked for.
"""

import struct

from host import exactly, expect, open_serial, run

HEAD, TAIL = bytes.fromhex("55AA7B7B"), bytes.fromhex("55AA7D7D")


def ask(line, command, data=b""):
    """Data of the answer; ``command`` is the main command and two bytes of sub command."""
    body = b"\x0e\0" + command + struct.pack("<H", len(data)) + data
    line.write(HEAD + body + bytes([-sum(body) & 0xFF]) + TAIL)
    head = exactly(line, 4 + 8)
    answer = head[4:]
    expect(head[:4] == HEAD and answer[:3] == body[:3], f"an answer to {body.hex(' ')} begins {head.hex(' ')}")
    if command != b"\x70\xc0\x0c":  # the box answers "set mode" with a sub command of its own
        expect(answer[3:5] == body[3:5], f"answer to {body.hex(' ')}: sub command {answer[3:5].hex(' ')}")
    size = struct.unpack("<H", answer[6:8])[0]
    data = exactly(line, size)
    expect(sum(answer + data + exactly(line, 1)) & 0xFF == 0, f"LRC of an answer to {body.hex(' ')} is wrong")
    expect(exactly(line, 4) == TAIL, "an answer does not end in 55 AA 7D 7D")
    expect(answer[5] == 0, f"error {answer[5]:02X} to {body.hex(' ')}")
    return data


def read(port, mode="5", slot="0", taxels="120"):
    line = open_serial(port, 460800)
    count = 3 * int(taxels)
    expect(ask(line, b"\x60\xa0\x01"), "a version without a text")
    ask(line, b"\x70\xc0\x0c", bytes([int(mode)]))
    expect(ask(line, b"\x70\xc0\x0d") == bytes([int(mode)]), "another mode than the one set")
    ask(line, b"\x70\xb1\x0a", bytes([int(slot)]))
    where = struct.pack("<BHH", 0x7B, 1038, count)
    while True:
        data = ask(line, b"\x70\xc0\x06", where)
        expect(len(data) == 6 + count, f"{len(data)} bytes, expected {6 + count}")
        expect(data[1:6] == where, f"region, start or count {data[1:6].hex(' ')}, asked {where.hex(' ')}")
        yield [v for at in range(6, 6 + count, 3) for v in struct.unpack_from("bbB", data, at)]


if __name__ == "__main__":
    run(read, pause=0.01)
