"""DynPick: lines, their digit, zero, limits."""

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def read(device) -> tuple[int, list[int]]:
    (line,) = send(device, b"R")
    assert len(line) == 27 and line.endswith(b"\r\n")
    return int(line[:1]), [int(line[k : k + 4], 16) for k in range(1, 25, 4)]


def test_a_line_holds_six_counts_and_a_digit():
    device = fp.create("dynpick")
    sample(device, wrench=[[1.0, -2.0, 3.0, 0.1, -0.2, 0.4]])
    assert read(device) == (0, [8242, 8092, 8342, 8342, 7892, 8792])
    assert [read(device)[0] for _ in range(10)] == [1, 2, 3, 4, 5, 6, 7, 8, 9, 0]
    assert len(send(device, b"RRR")) == 3


def test_zero():
    device = fp.create("dynpick")
    sample(device, wrench=[[1.0, -2.0, 3.0, 0.1, -0.2, 0.4]])
    assert send(device, b"O") == []
    sample(device, wrench=[[2.0, -2.0, 3.0, 0.1, -0.2, 0.4]])
    assert read(device)[1] == [8242, *[8192] * 5]
    device.power_cycle()
    sample(device)
    assert read(device)[1] == [8192] * 6


def test_counts_end_where_14_bits_do():
    device = fp.create("dynpick")
    sample(device, wrench=[[1e6, -1e6, 0, 1e6, -1e6, 0]])
    assert read(device)[1] == [16383, 0, 8192, 16383, 0, 8192]


def test_other_letters_are_not_answered():
    device = fp.create("dynpick")
    sample(device)
    assert send(device, b"rX\r\n\xff") == [] and device.counters["unknown_command"] == 5
