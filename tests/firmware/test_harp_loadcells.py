"""Harp LoadCells: registers, their errors, events of an acquisition."""

import struct

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

U8, S16 = 1, 0x82


def ask(device, kind: int, register: int, form: int, data: bytes = b"") -> tuple[int, bytes]:
    """Send a request, and return type and data of its answer."""
    request = bytes([kind, 4 + len(data), register, 0xFF, form]) + data
    (answer,) = send(device, request + bytes([sum(request) & 0xFF]), t_ns=1_500_000_000)
    assert answer[1] == len(answer) - 2 and answer[2:5] == bytes([register, 0xFF, form | 0x10])
    assert answer[5:11] == struct.pack("<IH", 1, 15625) and sum(answer[:-1]) & 0xFF == answer[-1]
    return answer[0], answer[11:-1]


def test_registers_keep_what_is_written_until_power_off():
    device = fp.create("harp_loadcells")
    assert ask(device, 2, 10, U8, b"\x41") == (2, b"\x41") and ask(device, 1, 10, U8) == (1, b"\x41")
    device.power_cycle()
    assert ask(device, 1, 10, U8) == (1, b"\0")


def test_errors_repeat_the_data_of_the_request():
    device = fp.create("harp_loadcells")
    assert ask(device, 1, 200, U8) == (9, b"") and ask(device, 1, 32, S16) == (9, b"")
    assert ask(device, 2, 33, S16, b"\1\0") == (10, b"\1\0") and ask(device, 2, 48, S16, b"\1") == (10, b"\1")
    assert device.counters["refused"] == 4
    assert send(device, "05 04 21 FF 82 AB") == [] and device.counters["unknown_command"] == 1


def test_offsets_are_subtracted_and_loads_are_limited():
    device = fp.create("harp_loadcells")
    ask(device, 2, 49, S16, struct.pack("<h", -500))
    sample(device, 1.0)
    assert struct.unpack("<8h", ask(device, 1, 33, S16)[1]) == (100, 600, *[100] * 6)
    sample(device, 1e6)
    assert struct.unpack("<8h", ask(device, 1, 33, S16)[1]) == (32767,) * 8


def test_events_need_an_acquisition_and_their_bit():
    device = fp.create("harp_loadcells")
    assert sample(device) == []
    ask(device, 2, 32, U8, b"\1")
    assert sample(device)[0][:5] == bytes([3, 26, 33, 0xFF, 0x92])
    ask(device, 2, 90, U8, b"\x0e")
    assert sample(device) == []
