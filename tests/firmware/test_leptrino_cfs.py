"""Leptrino: the rated load, what waits for the next power-up, readings that are sent, refusals."""

from collections import Counter

import firmware_protocols as fp
from firmware_protocols.devices.leptrino_cfs import LeptrinoCfs
from tests.firmware.feeding import sample, send


def ask(device, command: int, *data: int) -> bytes:
    """Send a request, and return the content of its answer behind the command: result and data."""
    (answer,) = send(device, fp.dle(bytes([4 + len(data), 0xFF, command, 0, *data])))
    (content,) = fp.Dle(counters=Counter()).cut(answer)
    assert content[:3] == bytes([len(content), 0xFF, command])
    return content[3:]


def wrench(content: bytes) -> list[int]:
    return [int.from_bytes(content[k : k + 2], "little", signed=True) for k in range(1, 13, 2)]


def test_a_reading_is_in_ten_thousandths_of_the_rated_load():
    device = fp.create("leptrino_cfs", rated_force=50.0, rated_torque=0.5)
    sample(device, wrench=[[50.0, -25.0, 1e9, 0.1, -0.2, 0.0]])
    content = ask(device, 0x30)
    assert wrench(content) == [10000, -5000, 32000, 2000, -4000, 0] and content[15] == 4
    sample(device, wrench=[[-50.0, 0, 0, 0, 0, 0.5]], t_ns=10**9)
    content = ask(device, 0x30)
    assert wrench(content) == [-10000, 0, 0, 0, 0, 10000] and content[15] == 0


def test_the_low_pass_is_in_force_from_the_next_power_up():
    device = LeptrinoCfs()
    assert ask(device, 0xB6) == bytes([0, 2, 0, 0, 0]) and device.low_pass.cutoff_hz == 100
    assert ask(device, 0xA6, 0, 0, 0, 0) == b"\0" and device.low_pass.cutoff_hz == 100
    device.power_cycle()
    assert ask(device, 0xB6) == bytes(5) and device.low_pass.cutoff_hz is None
    assert ask(device, 0xA6, 4, 0, 0, 0) == b"\3" and ask(device, 0xA6, 1) == b"\1"


def test_readings_follow_each_conversion_between_start_and_stop():
    device = fp.create("leptrino_cfs")
    assert sample(device) == [] and ask(device, 0x32) == b"\0"
    assert len(sample(device)) == len(sample(device)) == 1 and ask(device, 0x33) == b"\0"
    assert sample(device) == []


def test_a_content_without_a_command_and_a_wrong_sum():
    device = fp.create("leptrino_cfs")
    assert send(device, fp.dle(b"")) == [fp.dle(bytes([4, 0xFF, 0, 1]))]
    assert send(device, "10 02 04 FF 30 00 10 03 C9") == [b"\x10\x15"]
