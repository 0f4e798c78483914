"""Loadstar: units, the tare, values that are sent until an empty request."""

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


@pytest.mark.parametrize("unit, text", [("LB", b"2.248\r\n"), ("Kg", b"1.020\r\n"), ("N", b"10.000\r\n")])
def test_units(unit, text):
    device = fp.create("loadstar_di", unit=unit)
    sample(device, 10.0)
    assert send(device, b"w\r") == [text] and send(device, b"unit\r") == [unit.encode() + b"\r\n"]


def test_a_tare_is_forgotten_at_power_off():
    device = fp.create("loadstar_di", unit="N")
    sample(device, 10.0)
    assert send(device, b"tare\r") == [b"Tared\r\n"]
    sample(device, 4.0)
    assert send(device, b"w\r") == [b"-6.000\r\n"] and send(device, b"r\r") == [b"-6000\r\n"]
    device.power_cycle()
    sample(device, 4.0)
    assert send(device, b"w\r") == [b"4.000\r\n"]


def test_loads_follow_each_conversion_until_an_empty_request():
    device = fp.create("loadstar_di")
    assert sample(device) == [] and send(device, b"wc\r") == []
    assert sample(device) == sample(device) == [b"0.000\r\n"]
    assert send(device, b"\r") == [b"A\r\n"] and sample(device) == []


def test_requests_in_pieces_and_others():
    device = fp.create("loadstar_di", baud=9600, model="DI-1000U")
    assert send(device, b"mod") == [] and send(device, b"el\rid\r\r") == [b"DI-1000U\r\n", b"F230001\r\n", b"A\r\n"]
    assert send(device, b"W\r") == [b"E\r\n"] and device.counters["unknown_command"] == 1
