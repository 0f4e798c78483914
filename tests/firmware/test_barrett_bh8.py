"""Barrett Hand: twelve-bit values in five frames, tare of one puck, what is no property."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME, FULL, TARE = "barrett_bh8", "EA0002000000", "EA0003000000"


def cells(device: fp.Device, puck: int) -> list[int]:
    """As a reader takes the frames apart."""
    frames = send(device, f"{puck:03X}#{FULL}")
    assert [f.arbitration_id for f in frames] == [0x409 | puck << 5] * 5
    values = []
    for k, frame in enumerate(frames):
        nibbles = frame.data.hex()
        assert nibbles[0] == str(k)
        values += [int(nibbles[n : n + 3], 16) for n in range(1, len(nibbles) - 2, 3)]
    return values


def test_a_picture_of_every_puck():
    device = fp.create(NAME)
    sample(device, np.arange(96) * 0.1)
    got = [cells(device, puck) for puck in (11, 12, 13, 14)]
    assert np.array_equal(got, device.counts.reshape(4, 24)) and np.ptp(device.counts) > 2000


def test_values_saturate_at_12_bits():
    device = fp.create(NAME)
    sample(device, 1e9)
    assert cells(device, 14) == [4095] * 24
    sample(device, -1e9)
    assert cells(device, 14) == [0] * 24


def test_tare_is_of_one_puck_and_forgotten_at_power_off():
    device = fp.create(NAME)
    sample(device, 1.0)
    assert send(device, f"00C#{TARE}") == []
    sample(device, 1.5)
    assert cells(device, 12) == [128] * 24 and cells(device, 11) == [384] * 24
    device.power_cycle()
    sample(device, 1.5)
    assert cells(device, 12) == [384] * 24


@pytest.mark.parametrize("request_", ["00B#", "00B#EA00", "00B#EA0001000000", "00B#6A", "00B#EB0002000000"])
def test_what_is_not_known_gets_silence(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters["unknown_command"] == 1


@pytest.mark.parametrize("request_", ["00A#EA0002000000", "00F#EA0002000000", "0000000B#EA0002000000", "00B#R"])
def test_what_is_for_others_is_ignored(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters["ignored"] == 1
