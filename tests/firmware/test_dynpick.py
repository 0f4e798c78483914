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


def test_a_line_after_each_conversion_between_s_and_e():
    device = fp.create("dynpick")
    assert sample(device) == [] and send(device, b"S") == []
    assert [line[:1] for _ in range(2) for line in sample(device)] == [b"0", b"1"]
    assert send(device, b"E") == [] and sample(device) == [] and not device.counters["unknown_command"]


def test_the_divider_is_a_digit_before_f():
    device = fp.create("dynpick")
    sample(device)
    assert send(device, b"0F") == [b"1\r\n"] and device.period_ns == 2_000_000
    assert send(device, b"4") + send(device, b"F0") + send(device, b"F") == [b"4\r\n"]
    assert device.period_ns == 8_000_000
    assert send(device, b"3F") + send(device, b"F") == [] and device.counters["unknown_command"] == 2
    assert send(device, b"0F") == [b"4\r\n"]


def test_sensitivity_has_46_characters_whatever_it_is():
    for newton, metre in ((24.9, 1664.7), (65.47, 1638.5), (0.25, 2.5), (1000.0, 99999.0)):
        device = fp.create("dynpick", counts_per_newton=newton, counts_per_newton_metre=metre)
        sample(device)
        (line,) = send(device, b"p")
        assert len(line) == 46 and [float(each) for each in line.split(b",")] == [newton] * 3 + [metre] * 3


def test_temperature_and_version():
    device = fp.create("dynpick", version="WEF-6A200-4-RCX 1.2")
    sample(device, temperature=[31.5])
    assert send(device, b"T") == [b"01F8\r\n"] and send(device, b"V") == [b"WEF-6A200-4-RCX 1.2\r\n"]
