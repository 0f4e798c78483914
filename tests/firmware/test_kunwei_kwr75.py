"""Kunwei KWR75: kilograms, the first request behind power-up, the overload of a model."""

import struct

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

ONCE = "49 AA 0D 0A"


def test_values_are_in_kilograms():
    device = fp.create("kunwei_kwr75")
    sample(device, wrench=[[9.80665, 0, -19.6133, 0.980665, 0, 4.903325]])
    assert send(device, ONCE) == []
    (frame,) = send(device, ONCE)
    assert struct.unpack("<6f", frame[2:26]) == pytest.approx((1, 0, -2, 0.1, 0, 0.5))
    device.power_cycle()
    sample(device)
    assert send(device, ONCE) == []


def test_a_stream_starts_the_converter_and_goes_on_during_requests():
    device = fp.create("kunwei_kwr75")
    assert sample(device) == [] and send(device, "48 AA 0D 0A") == []
    assert [frame[0] for frame in sample(device) + send(device, ONCE) + sample(device)] == [0x48, 0x49, 0x48]
    assert send(device, "43 AA 0D 0A") == [] and sample(device) == [] and len(send(device, ONCE)) == 1


def test_values_end_at_the_overload_of_the_model():
    device = fp.create("kunwei_kwr75", model="C")
    send(device, "48 AA 0D 0A")
    (frame,) = sample(device, wrench=[[1e6, -1e6, 1e6, -1e6, 1e6, 0]])
    kilograms = [load * 3 / 9.80665 for load in (350, -350, 500, -12, 12, 0)]
    assert struct.unpack("<6f", frame[2:26]) == pytest.approx(kilograms)


def test_other_commands_are_counted():
    device = fp.create("kunwei_kwr75")
    assert send(device, "47 AA 0D 0A") == [] and device.counters["unknown_command"] == 1
