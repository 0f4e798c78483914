"""AFT200: bias, id, period, commands to others."""

import firmware_protocols as fp
from firmware_protocols.frames import frame_of
from tests.firmware.feeding import sample, send

WRENCH = [[-12.99, 3.58, -16.04, -0.072, 0.476, -0.682]]
READING = [frame_of("001#701D76966EEC0000"), frame_of("002#6184629660530000")]
REST = [frame_of("001#7530753075300000"), frame_of("002#61A861A861A80000")]


def test_a_bias_is_silent_for_a_second_and_then_zero():
    device = fp.create("aidin_aft200")
    assert sample(device, wrench=WRENCH) == READING
    assert send(device, "102#0102010000000000", 5) == [] and device.wake_ns == 1_000_000_005
    assert sample(device, wrench=WRENCH) == []
    device.wake_ns = None
    assert [frame.arbitration_id for frame in device.wake(1_000_000_005)] == [1, 2, 3, 4, 5, 6]
    assert sample(device, wrench=WRENCH) == REST
    send(device, "102#0102020000000000")
    assert sample(device, wrench=WRENCH) == READING


def test_id_and_period_are_saved():
    device = fp.create("aidin_aft200", can_id=3)
    send(device, "102#0301070000000000")
    send(device, "102#07050FA000000000")
    assert device.period_ns == 4_000_000
    device.power_cycle()
    assert [frame.arbitration_id for frame in sample(device)] == [7, 8] and device.period_ns == 4_000_000
    send(device, "102#FFFF000000000000")
    assert [frame.arbitration_id for frame in sample(device)] == [1, 2]


def test_what_is_for_others_or_without_meaning_is_counted():
    device = fp.create("aidin_aft200")
    for data in ("0203010000000000", "0103020000000000", "0105000000000000", "0101", "0109010000000000"):
        assert send(device, f"102#{data}") == []
    assert (device.counters["other_address"], device.counters["refused"], device.counters["bad_length"]) == (1, 3, 1)
