"""Seed Robotics FTS-3.

Sources: seedrobotics/SensorTools@a4b7613 (SensorTool.py), ros2_sensor_pkg@a920d6c
(script/read_publish_sensor_node.py:48-52, 147-215).
A reading is x1, y1, z1, ... x5, y5, z5, in counts; an empty field is null.

Options: the end of a command, "none" as SensorTool sends it or "crlf" as the ROS node does.
Not settled by the description: which commands a host must send (here enabletime, then setperiod, 0.3 s apart); the
unit; whether the time may stand still between lines (here it may); what follows #OK.
"""

import time

from host import Broken, expect, open_serial, run


def text(line):
    got = line.readline()
    expect(got.endswith(b"\r\n"), f"a line without CR LF: {got!r}")
    return got[:-2].decode("ascii")


def command(line, words):
    line.write(words)
    time.sleep(0.3)
    for _ in range(100):
        answer = text(line)
        if not answer.startswith("@"):
            expect(answer.startswith("#OK"), f"{words!r} was answered {answer!r}")
            return
    raise Broken(f"no answer to {words!r}")


def read(port, ending="none"):
    line = open_serial(port, 1_000_000)
    line.readline()  # the first may have begun anywhere
    for words in (b"enabletime", b"setperiod,20"):
        command(line, words + {"none": b"", "crlf": b"\r\n"}[ending])
    before = -1
    while True:
        fields = text(line).split(",")
        expect(fields[0] == "@" and fields[-1] == "", f"not a line of sensors: {fields}")
        expect(len(fields) == 1 + 2 + 15 + 1, f"{len(fields)} fields, expected 19: {fields}")
        seconds, milliseconds = int(fields[1]), int(fields[2])
        expect(
            0 <= milliseconds < 1000 and seconds * 1000 + milliseconds >= before,
            f"time {fields[1:3]} after {before} ms",
        )
        before = seconds * 1000 + milliseconds
        yield [int(field) if field else None for field in fields[3:18]]


if __name__ == "__main__":
    run(read)
