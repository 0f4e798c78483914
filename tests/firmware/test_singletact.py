"""SingleTact: readings, settings, tare, what another address gets."""

import struct

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

TAIL = "ff fefefefe"


def ask(device, request: str, t_ns: int = 0, address: int = 4) -> bytes | None:
    """The data of the answer to what stands between timeout and tail; a host's 16th byte behind it."""
    answers = send(device, f"ffffffff{address:02x}64 {request} {TAIL} 00", t_ns)
    if not answers:
        return None
    (answer,) = answers
    assert answer[4] == address and answer[-4:] == b"\xfe" * 4
    assert answer[6] == int(request[:2], 16) and len(answer) == 16 + answer[11]
    return answer[12:-4]


def value(device) -> int:
    return struct.unpack(">HHH", ask(device, "01018006"))[2]


@pytest.mark.parametrize(("board", "first"), [("usb", 0xAA), ("arduino", 0xFF)])
def test_a_reading(board, first):
    device = fp.create("singletact", board=board)
    sample(device, 2.0)
    sample(device, 3.0, t_ns=6_500_000)
    (answer,) = send(device, f"ffffffff0464 2a018006 {TAIL}", 7_000_000)
    assert answer[:4] == bytes([first] * 4) and answer[7:11] == b"\0\0\0\x46"
    assert struct.unpack(">HHH", answer[12:18]) == (2, 65, 255 + round(3 * 51.2))


def test_span():
    device = fp.create("singletact")
    for newtons, counts in ((0, 255), (-1e9, 0), (1e9, 1023)):
        sample(device, newtons)
        assert value(device) == counts


def test_settings_are_in_flash_50_ms_later_and_tare():
    device = fp.create("singletact")
    sample(device, 5.0)
    request = bytes.fromhex(f"ffffffff0464 02027e02ffff {TAIL}")
    (answer,) = device.receive(request, 0, "")
    assert answer.delay_ns == 50_000_000 and ask(device, "03017d03") == b"\0\xff\xff", "also what looks like a head"
    sample(device, 5.0)
    assert value(device) == 255
    device.power_cycle()
    sample(device, 5.0)
    assert ask(device, "04017e02") == b"\xff\xff" and value(device) == 255 + 256


def test_values_follow_the_scaling():
    device = fp.create("singletact")
    sample(device)
    ask(device, "01020a02 00c8")
    sample(device, 1.0)
    assert value(device) == 255 + 102


def test_settings_end_with_a_sum_from_firmware_2_on():
    device = fp.create("singletact", firmware=2)
    sample(device)
    assert ask(device, "01025003 010204") == b"" and device.counters["bad_checksum"] == 1
    assert ask(device, "02015003") == b"\0\0\0"
    assert ask(device, "03025003 050a0f") == b"" and ask(device, "04015003") == b"\5\x0a\0"


def test_what_is_not_answered():
    device = fp.create("singletact")
    sample(device)
    for request in ("0101c000", "0101b80a", "01028001 00", "0102001d" + "00" * 29, "0101803e"):
        assert ask(device, request) is None
    assert device.counters["refused"] == 5 and ask(device, "01018006") is not None


def test_another_address_gets_the_old_buffer():
    device = fp.create("singletact", address=9)
    sample(device, 1.0)
    felt = ask(device, "01018006", address=9)
    assert felt == ask(device, "02018006"), "all pads answer to 4"
    (answer,) = device.receive(bytes.fromhex(f"ffffffff0564 03018006 {TAIL}"), 0, "")
    assert answer.delay_ns == 100_000_000 and answer.frame[12:18] == felt and device.counters["other_device"] == 1
    assert ask(device, "04020002 0000", address=5) == b"" and ask(device, "05010001") == b"\x09"


def test_an_answer_without_data_has_the_time_of_the_last_read():
    device = fp.create("singletact")
    sample(device)
    ask(device, "01018006", 300_000)
    (answer,) = send(device, f"ffffffff0464 02030810 {'07' * 16} {TAIL}", 900_000)
    assert answer[7:12] == b"\0\0\0\3\0"


def test_counter_and_clock_roll_over():
    device = fp.create("singletact")
    device.preset("iteration", 0xFFFF)
    sample(device)
    assert ask(device, "01018002", (1 << 32) * 100_000) == b"\0\0"


def on_bus(device, frame: str) -> bytes:
    return b"".join(device.receive(bytes.fromhex(frame), 0, ""))


def test_on_i2c_a_read_begins_where_the_request_says_else_at_the_data():
    device = fp.create("singletact", board="none", address=9, serial=0x1234)
    assert device.ports == (fp.I2c(addresses=(9, 4)),)
    sample(device, 2.0)
    assert struct.unpack(">HHH", on_bus(device, "13 0000 0006"))[2] == 255 + 102
    assert on_bus(device, "12 01 00 05") == b"" and on_bus(device, "13 0000 0003") == b"\x09\0\0"
    assert on_bus(device, "13 0003 0002") == b"\x12\x34", "the controller reads on in the same transaction"
    assert struct.unpack(">HHH", on_bus(device, "13 0000 0006"))[0] == 1, "the request is spent"
    assert on_bus(device, "13 0040 0004") == bytes(4), "behind the memory"


def test_on_i2c_a_write_tares_and_what_is_not_understood_is_counted():
    device = fp.create("singletact", board="none")
    sample(device, 2.0)
    assert on_bus(device, "08 02 29 02 00 00 FF") == b""
    sample(device, 2.0)
    assert struct.unpack(">HHH", on_bus(device, "09 0000 0006"))[2] == 255
    for frame in ("08", "08 00", "08 03 00 01 00", "08 02 7f 02 00 00", "08 02 00 03 00", "08 01 bc 05"):
        on_bus(device, frame)
    assert device.counters["refused"] == 6
