"""SingleTact: readings, settings, what is not answered."""

import struct

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

TAIL = "ff fefefefe"


def ask(device, request: str, t_ns: int = 0) -> bytes | None:
    """The data of the answer to what stands between timeout and tail; a host's 16th byte behind it."""
    answers = send(device, f"ffffffff{device.address:02x}64 {request} {TAIL} 00", t_ns)
    if not answers:
        return None
    (answer,) = answers
    assert answer[1:4] == b"\xff" * 3 and answer[4] == device.address and answer[-4:] == b"\xfe" * 4
    assert answer[6] == int(request[:2], 16) and len(answer) == 16 + answer[11]
    return answer[12:-4]


@pytest.mark.parametrize(("board", "first"), [("usb", 0xAA), ("arduino", 0xFF)])
def test_a_reading(board, first):
    device = fp.create("singletact", board=board)
    sample(device, 2.0)
    sample(device, 3.0)
    (answer,) = send(device, f"ffffffff0464 2a018006 {TAIL}", 7_000_000)
    assert answer[0] == first and answer[7:11] == b"\0\0\0\7"
    assert struct.unpack(">HHH", answer[12:18]) == (2, 0, 255 + round(3 * 51.2))


def test_span():
    device = fp.create("singletact")
    for newtons, value in ((0, 255), (-1e9, 0), (1e9, 1023)):
        sample(device, newtons)
        assert ask(device, "01018402") == struct.pack(">H", value)


def test_settings_are_kept_until_power_up():
    device = fp.create("singletact")
    sample(device)
    assert ask(device, "01017e02 ") == b"\0\0"
    assert ask(device, "02027e02 ffff") == b"", "also what looks like a head"
    assert ask(device, "03017d03") == b"\0\xff\xff"
    device.power_cycle()
    sample(device)
    assert ask(device, "04017e02") == b"\0\0"


def test_what_is_not_answered():
    device = fp.create("singletact")
    sample(device)
    for request in ("01018007", "01028001 00", "01020080" + "00" * 128 + "ff"):
        assert ask(device, request) is None
    assert send(device, f"ffffffff0564 01018006 {TAIL}") == [] and device.counters["other_device"] == 1
    assert ask(device, "01018006") is not None


def test_counter_and_clock_roll_over():
    device = fp.create("singletact")
    device.preset("iteration", 0xFFFF)
    sample(device)
    assert ask(device, "01018002", (1 << 32) * 1_000_000) == b"\0\0"
