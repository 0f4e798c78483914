"""WTS: frames that are pushed and asked for, zero, what is not answered. Requests as in the datasheet's commands."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def request(device, name: str) -> list:
    return send(device, next(command.request for command in device.commands if command.name == name))


def texels(message: bytes, order: str = "<") -> list[int]:
    kind, size = struct.unpack_from("<BH", message, 3)
    assert message[:3] == b"\xaa" * 3 and len(message) == size + 8
    return list(struct.unpack_from(f"{order}84H", message, 11 if kind == 0 else 13))


def test_pushed_until_stopped():
    device = fp.create("weiss_wts")
    assert sample(device) == []
    request(device, "frames every 20 ms")
    pushes = np.arange(84) / 20
    (frame,) = sample(device, pushes, 30_000_000)
    assert device.period_ns == 20_000_000 and frame[6:10] == bytes([30, 0, 0, 0])
    assert texels(frame) == [min(4095, 50 * k) for k in range(84)]
    request(device, "no more frames")
    assert sample(device) == []


@pytest.mark.parametrize(("values", "order", "times"), [("low_first", "<", 1), ("sixteenths", ">", 16)])
def test_one_frame_is_that_of_the_next_scan(values, order, times):
    device = fp.create("weiss_wts", values=values)
    sample(device, 1.0)
    assert request(device, "one frame, after the next scan") == []
    (frame,) = sample(device, 2.0)
    assert frame[3] == 0x20 and frame[6:8] == b"\0\0" and texels(frame, order) == [2000 * times] * 84
    assert sample(device) == []


def test_what_is_felt_is_zero_after_a_tare():
    device = fp.create("weiss_wts")
    request(device, "frames every 20 ms")
    sample(device, 1.0)
    request(device, "tare")
    assert texels(sample(device, 1.5)[0]) == [500] * 84 and texels(sample(device, 0.5)[0]) == [0] * 84
    device.power_cycle()
    request(device, "frames every 20 ms")
    assert texels(sample(device, 0.5)[0]) == [500] * 84


def test_what_is_not_answered():
    device = fp.create("weiss_wts")
    sample(device)
    assert send(device, "AA AA AA 30 00 00 00 00") == [] and device.counters["bad_checksum"] == 1
    for name in ("matrix", "temperature", "tare", "no more frames"):
        (answer,) = request(device, name)
        assert answer[6:8] == b"\0\0"


def test_a_threshold_makes_less_than_itself_0():
    device = fp.create("weiss_wts")
    request(device, "threshold 100")
    request(device, "frames of each scan")
    pushes = np.arange(84) / 100
    assert device.period_ns == 10_000_000
    assert texels(sample(device, pushes)[0]) == [10 * k if k >= 10 else 0 for k in range(84)]


def test_two_frames_asked_for_are_two():
    device = fp.create("weiss_wts")
    request(device, "one frame, after the next scan")
    request(device, "one frame, after the next scan")
    assert len(sample(device, 1.0)) == 2


def test_a_tag_survives_power_off():
    device = fp.create("weiss_wts")
    sample(device)
    request(device, "new tag")
    device.power_cycle()
    sample(device)
    assert request(device, "tag")[0][8:-2] == b"left"


def test_what_is_unknown_is_answered_with_a_status():
    device = fp.create("weiss_wts")
    sample(device)
    assert [request(device, name)[0][6] for name in ("unknown id", "a payload too many", "a payload too short")] == [
        14, 12, 13
    ]  # fmt: skip
    assert device.counters["unknown_command"] == 1 and device.counters["bad_length"] == 2
