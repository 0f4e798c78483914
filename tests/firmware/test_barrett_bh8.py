"""Barrett Hand: cells in both forms, tare of one puck, sleep, groups, properties, motors, what is no property."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME, WAKE, TARE = "barrett_bh8", "400#85000200", "EA0003000000"
AREA = 12e-6
"""Of a finger's cell [m2]."""
N_CM2 = AREA * 1e4
"""Newtons on it that are 1 N/cm2."""


def awake(**options) -> fp.Device:
    device = fp.create(NAME, **options)
    sample(device)
    assert send(device, WAKE) == []
    return device


def cells(device: fp.Device, puck: int, request: str = "EA000200") -> list[int]:
    """As a reader takes the frames apart."""
    frames = send(device, f"{puck:03X}#{request}")
    assert [f.arbitration_id for f in frames] == [0x409 | puck << 5] * 5
    values = []
    for k, frame in enumerate(frames):
        nibbles = frame.data.hex()
        assert nibbles[0] == str(k) and len(nibbles) == 16
        values += [int(nibbles[n : n + 3], 16) for n in range(1, 16, 3)]
    assert values[24:] == [0]
    return values[:24]


@pytest.mark.parametrize("request_", ["EA000200", "EA0002000000", "6A"])
def test_a_picture_of_every_puck(request_):
    device = awake()
    for puck in (11, 12, 13, 14):
        send(device, f"{puck:03X}#EA000200")
    sample(device, np.arange(96) * 0.01)
    got = [cells(device, puck, request_) for puck in (11, 12, 13, 14)]
    assert np.array_equal(got, device.counts.reshape(4, 24)) and np.ptp(device.counts) > 1000


def test_a_group_is_answered_by_every_puck():
    device = awake()
    assert [f.arbitration_id for f in send(device, "405#EA0002000000")] == [0x569] * 5 + [0x589] * 5 + [0x5A9] * 5 + [
        0x5C9
    ] * 5
    assert [str(f) for f in send(device, "405#08")] == ["566#88000000", "586#88000000", "5A6#88000000", "5C6#88000000"]
    send(device, "00B#9C000600")  # puck 11 leaves group 5
    assert len(send(device, "405#6A")) == 15
    assert send(device, "404#6A") == []


def test_values_saturate_at_12_bits():
    device = awake()
    sample(device, 1e9)
    assert cells(device, 14) == [4095] * 24
    sample(device, -1e9)
    assert cells(device, 14) == [0] * 24


def test_tare_is_of_one_puck_and_forgotten_at_power_off():
    device = awake()
    sample(device, 1.0 * N_CM2)
    assert send(device, f"00C#{TARE}") == []
    sample(device, 1.5 * N_CM2)
    assert cells(device, 12) == [128] * 24 and cells(device, 11) == [384] * 24
    device.power_cycle()
    send(device, WAKE)
    sample(device, 1.5 * N_CM2)
    assert cells(device, 12) == [384] * 24


def test_a_puck_that_sleeps_knows_who_it_is_and_no_more():
    device = fp.create(NAME, wake_s=0.5)
    sample(device)
    assert [str(f) for f in send(device, "00B#05")] == ["566#85000000"]
    assert [str(f) for f in send(device, "00B#03")] == ["566#83000B00"]
    assert send(device, "00B#EA000200") == [] and device.counters["asleep"] == 1
    send(device, WAKE)
    assert send(device, "00B#05", t_ns=499_000_000) == []
    assert [str(f) for f in send(device, "00B#05", t_ns=500_000_000)] == ["566#85000200"]


def test_properties_are_set_saved_and_reset():
    device = awake()
    hold = "566#CD000{}00".format
    for request, value in (("CD000100", 1), ("9E004D00", 1), ("CD000000", 0), ("9F004D00", 1), ("A0004D00", 1)):
        send(device, f"00B#{request}")
        assert [str(f) for f in send(device, "00B#4D")] == [hold(value)]
    send(device, "00B#9F004D00")
    assert [str(f) for f in send(device, "00B#4D")] == [hold(0)]
    assert [str(f) for f in send(device, "00B#38")] == ["566#B800B8F90200"]  # CT, 195000, has 32 bits


def test_a_finger_moves_and_says_when_it_has_arrived():
    device = awake()
    send(device, "00B#B40050C30000")  # E = 50000
    send(device, "00B#88000500")  # trapezoidal
    mode = [str(send(device, "00B#08", t_ns=t)[0]) for t in (100_000_000, 300_000_000)]
    assert mode == ["566#88000500", "566#88000000"]
    (place,) = send(device, "00B#30", t_ns=300_000_000)
    assert str(place) == "563#80C350804E20"  # 50000, and two fifths of it
    assert device.joints(300_000_000)["finger_1"] == pytest.approx(50000 * 2 * np.pi / 4096 / 125)


@pytest.mark.parametrize(("request_", "counter"), [
    ("00B#", "bad_length"), ("00B#EA00", "bad_length"), ("00B#6A00", "bad_length"), ("00B#7F", "unknown_command"),
    ("00B#EA000400", "refused"),
])  # fmt: skip
def test_what_is_not_known_gets_silence(request_, counter):
    device = awake()
    assert send(device, request_) == [] and device.counters[counter] == 1


@pytest.mark.parametrize("request_", ["00A#EA0002000000", "00F#EA0002000000", "0000000B#EA0002000000", "00B#R"])
def test_what_is_for_others_is_ignored(request_):
    device = awake()
    assert send(device, request_) == [] and device.counters["ignored"] == 1
