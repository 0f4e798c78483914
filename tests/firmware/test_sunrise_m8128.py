"""M8128: the document's frame, settings, start and stop, both ports."""

import struct

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

DOCUMENT = bytes.fromhex("AA55 001B C4C7 016AF4C0 EF7D33C0 4962C9C0 A25CC6BD A6198FBD AFDA693E 6E")
"""The worked example of GOD, whose numbers the document gives, too."""
NUMBERS = (-7.637940, -2.804561, -6.293248, -0.096856, -0.069873, 0.228373)


def test_the_frame_of_the_document():
    device = fp.create("sunrise_m8128")
    device.preset("number", 0xC4C6)
    wrench = struct.unpack("<6f", DOCUMENT[6:30])
    assert [round(value, 6) for value in wrench] == list(NUMBERS)
    sample(device, wrench=[wrench])
    assert send(device, b"AT+GOD\r\n") == [DOCUMENT]


def test_settings_are_told_set_and_refused():
    device = fp.create("sunrise_m8128")
    assert send(device, b"AT+SMPF=250\r\nAT+SMPR=?\r\n") == [b"ACK+SMPF=250$OK\r\n", b"ACK+SMPR=250$OK\r\n"]
    assert device.period_ns == 4_000_000
    for line in (b"SMPF=0", b"SMPF=x", b"SMPF=2001", b"SGDM=(A01);C;1", b"NONE=?"):
        assert send(device, b"AT+%s\r\n" % line) == [b"ACK+%s$ERROR\r\n" % line]
    assert send(device, b"AT+ETPT=4009\r\nAT+ETPT=?\r\n")[1] == b"ACK+ETPT=4009$OK\r\n"
    device.power_cycle()
    assert device.period_ns == 4_000_000 and send(device, b"AT+ETPT=?\r\n") == [b"ACK+ETPT=4008$OK\r\n"]


def test_it_streams_to_the_port_that_asked_until_it_stops_or_goes():
    device = fp.create("sunrise_m8128")
    sample(device)
    send(device, b"AT+GSD\r\n", port="uart")
    (sent,) = device.stream(0, "")
    assert sent.port == "uart" and sent.frame[4:6] == b"\0\0"
    assert send(device, b"AT+GSD=STOP\r\n", port="uart") == [b"ACK+GSD=STOP$OK\r\n"] and sample(device) == []
    send(device, b"AT+GSD\r\nAT+G", port="tcp")
    device.lines(False, False, 0, "tcp")
    assert sample(device) == [] and send(device, b"AT+GSD=STOP\r\n") == [b"ACK+GSD=STOP$OK\r\n"]


def test_other_lines_get_no_answer():
    device = fp.create("sunrise_m8128")
    assert send(device, b"AT+X\r\nhello\r\n") == [] and device.counters["unknown_command"] == 2
