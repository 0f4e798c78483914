"""FT 300-S: the published frames, the stop, what Modbus refuses, limits."""

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

STOP = b"\xff" * 50
WRENCH = [[1.5, -2.0, 10.0, 0.0, 0.0, 0.05]]
READ = "09 03 00 B4 00 06 84 A6"


def test_the_worked_example_by_stream_and_by_modbus():
    device = fp.create("robotiq_ft300")
    assert sample(device, wrench=WRENCH) == [bytes.fromhex("20 4E 96 00 38 FF E8 03 00 00 00 00 32 00 44 49")]
    assert send(device, READ) == [bytes.fromhex("09 03 0C 00 96 FF 38 03 E8 00 00 00 00 00 32 D7 00")]


def test_fifty_bytes_in_a_row_stop_the_stream():
    device = fp.create("robotiq_ft300")
    send(device, STOP[:49])
    send(device, b"\0")
    send(device, STOP[:49])
    assert len(sample(device)) == 1
    send(device, STOP[:1] + bytes.fromhex(READ))
    assert sample(device) == [] and device.counters["requests"] == 2, "and Modbus behind it is heard"


def test_one_at_a_time_stops_as_well_and_the_register_starts():
    device = fp.create("robotiq_ft300")
    for _ in STOP:
        send(device, STOP[:1])
    assert sample(device) == []
    assert send(device, "09 10 01 9A 00 01 02 02 00 CD CA", 10**9) == [bytes.fromhex("09 10 01 9A 00 01 21 52")]
    assert len(sample(device)) == 1
    device.power_cycle()
    assert len(sample(device)) == 1


def test_more_bytes_than_stop_it_are_no_broken_frame():
    device = fp.create("robotiq_ft300")
    for t_ns, n in enumerate((70, 30, 110, 7)):
        assert send(device, STOP[:1] * n, t_ns * 10**9) == []
    assert send(device, READ, 5 * 10**9) != [] and set(device.counters) == {"requests"}
    assert sample(device) == []


def test_identity_is_letters_and_binary_numbers():
    device = fp.create("robotiq_ft300", serial_number=0x00012345, firmware=(3, 2, 255))
    assert [device.registers.read(at, n) for at, n in ((1000, 6), (1020, 8))] == [
        b"FTS\3\2\xff", b"FTS\0\x23\x45\0\1"
    ]  # fmt: skip


def test_a_torque_follows_from_where_the_tool_is_touched():
    device = fp.create("robotiq_ft300", tool=(0.0, 0.0, 0.1), streams=False)
    assert sample(device, force=(2.0, -3.0, -5.0)) == []
    assert device.counts["wrench"].tolist() == [[200, -300, -500, 300, 200, 0]]


@pytest.mark.parametrize(("newtons", "counts"), [(1e9, -0x8000), (-1e9, 0x7FFF)])
def test_values_end_where_16_bits_do(newtons, counts):
    device = fp.create("robotiq_ft300")
    sample(device, newtons)
    assert device.counts["wrench"][0, 2] == counts


def test_what_it_does_not_know_is_refused():
    device = fp.create("robotiq_ft300")
    sample(device)
    assert send(device, "09 03 02 03 00 01 74 FA") == [bytes.fromhex("09 83 02 41 33")], "behind the last register"
    assert send(device, "09 06 00 B4 00 01 09 64") == [bytes.fromhex("09 86 01 02 62")], "function 6"
    assert send(device, "01 03 00 B4 00 06 85 EE") == []
