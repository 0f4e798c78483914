"""SCHUNK FTS: stream, zero, mean, refusals, connections."""

import struct

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

WRENCH = [[1.0, 2.0, -3.0, 0.25, -0.5, 0.125]]


def ask(device, command: int, data: bytes = b"") -> bytes:
    (answer, *_) = send(
        device, struct.pack("<2xHHB", 0, 1 + len(data), command).replace(b"\0\0", b"\xff\xff", 1) + data
    )
    return answer[7:]


def wrench(device, values=WRENCH) -> list[float]:
    (frame,) = sample(device, wrench=values)
    return list(struct.unpack("<6f", frame[11:]))


def test_it_streams_between_start_and_stop_and_while_connected():
    device = fp.create("schunk_fts")
    assert sample(device) == [] and ask(device, 0x40) == b"\0"
    assert wrench(device) == WRENCH[0]
    device.lines(True, True, 0, "stream")
    assert wrench(device) == WRENCH[0]
    assert ask(device, 0x41) == b"\0" and sample(device) == []
    ask(device, 0x40)
    device.lines(False, False, 0, "tcp")
    assert sample(device) == []


def test_tare_and_its_undoing():
    device = fp.create("schunk_fts")
    ask(device, 0x40)
    sample(device, wrench=WRENCH)
    assert ask(device, 0x12) == b"\0" and wrench(device) == [0.0] * 6
    assert ask(device, 0x13) == b"\0" and wrench(device) == WRENCH[0]


def test_the_filter_is_a_mean():
    device = fp.create("schunk_fts")
    ask(device, 0x40)
    assert ask(device, 0x31, b"\1") == b"\0"
    sample(device, wrench=[[0.0] * 6])
    assert wrench(device) == [value / 2 for value in WRENCH[0]]
    assert wrench(device) == WRENCH[0]


def test_refusals_have_their_error():
    device = fp.create("schunk_fts")
    assert [ask(device, *each)[:1] for each in ((0x42,), (0x40, b"\0"), (0x30, b"\4"), (0xF1, b"\0\0\0\1"))] == [
        b"\1", b"\2", b"\3", b"\x13",
    ]  # fmt: skip


def test_the_counter_goes_on_after_65535():
    device = fp.create("schunk_fts")
    ask(device, 0x40)
    device.preset("counter", 0xFFFF)
    assert sample(device)[0][2:4] == b"\0\0"
