"""ATI Wireless F/T: start and stop, number of records, telnet, bias by transducer, rollover of the time."""

import struct

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

START, STOP, TWO = "000A0001000000007346", "000601024E79", "000A0001000000025304"
WRENCHES = [[1.0, 2.0, -3.0, 0.25, -0.5, 0.125], [4.0, -5.0, 6.0, 0.5, 0.25, -0.125]]


def records(device, t_ns: int = 0) -> list[bytes]:
    return sample(device, wrench=WRENCHES, t_ns=t_ns)


def wrenches(record: bytes) -> list[list[float]]:
    return (np.frombuffer(record[18:], ">i4").reshape(-1, 6) / 1e6).tolist()


def test_records_between_start_and_stop_or_so_many():
    device = fp.create("ati_wireless_ft", transducers=2)
    assert records(device) == [] and send(device, START) == []
    assert [wrenches(each) for each in records(device)] == [WRENCHES]
    send(device, STOP)
    assert records(device) == []
    send(device, TWO)
    assert [len(records(device)) for _ in range(3)] == [1, 1, 0]


def test_each_transducer_has_its_bias():
    device = fp.create("ati_wireless_ft", transducers=2)
    send(device, START)
    records(device)
    assert send(device, b"bias 2 ON\r\n", port="telnet") == [b"OK\r\n>"]
    assert wrenches(records(device)[0]) == [WRENCHES[0], [0.0] * 6]
    send(device, b"bias * ON\r\nbias 1 OFF\r\n", port="telnet")
    assert wrenches(records(device)[0]) == [WRENCHES[0], [0.0] * 6]
    send(device, b"bias * OFF\r\n", port="telnet")
    assert wrenches(records(device)[0]) == WRENCHES


def test_the_rate_and_what_is_refused():
    device = fp.create("ati_wireless_ft")
    assert send(device, b"rate 250 16\r\n", port="telnet") == [b"OK\r\n>"] and device.period_ns == 4_000_000
    for line in (b"rate 251 16", b"rate 4 1", b"rate 50 0", b"hello", b"bias 7 ON"):
        assert send(device, line + b"\r\n", port="telnet") == [b"?\r\n>"]
    assert device.period_ns == 4_000_000
    assert (device.counters["refused"], device.counters["unknown_command"]) == (3, 2)


def test_a_broken_datagram_spoils_no_other():
    device = fp.create("ati_wireless_ft", transducers=2)
    assert send(device, START[:-2]) == send(device, START[:-1] + "7") == []
    assert records(device) == []
    send(device, START)
    assert len(records(device)) == 1 and device.counters["bad_checksum"] == 1


def test_the_time_begins_again():
    device = fp.create("ati_wireless_ft", transducers=2)
    send(device, START)
    device.preset("time", 0xFFFF_FFFF)
    (record,) = records(device, t_ns=1_500_000_000)
    assert struct.unpack(">I", record[:4]) == (1 << 12 | (1 << 11) - 1,)
