"""Mark-10: units, peaks."""

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def test_peaks_last_until_power_off():
    device = fp.create("mark10")
    for push in (3.0, -7.0, 5.0, 1.0):
        sample(device, push)
    assert send(device, b"?\r\n?PT\r?PC\n") == [b"1.00 N\r\n", b"-7.00 N\r\n", b"5.00 N\r\n"]
    device.power_cycle()
    sample(device)
    assert send(device, b"?PC\r\n?PT\r\n") == [b"0.00 N\r\n"] * 2


def test_newtons_last_until_power_off():
    device = fp.create("mark10", unit="kgF")
    sample(device, 9.80665)
    assert send(device, b"?\r\n") == [b"1.00 kgF\r\n"] and send(device, b"N\r\n") == []
    assert send(device, b"?\r\n") == [b"9.81 N\r\n"]
    device.power_cycle()
    sample(device)
    assert send(device, b"?\r\n") == [b"0.00 kgF\r\n"]


def test_other_requests_are_counted():
    device = fp.create("mark10", numeric=True)
    sample(device, 1000.0)
    assert send(device, b"?A\r\n?C\r\n") == [b"55.00\r\n"] and device.counters["unknown_command"] == 1
