"""PapillArray: packets as a host walks them, by offsets; commands, ranges, zero."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def parse(packet: bytes) -> dict:
    """Pillars and totals, found by the offsets alone; ``None`` for blocks that are not there."""
    assert packet[:4].hex() == "55667788" and packet[-4:].hex() == "aabbccdd"
    data, total = packet[4:-6], int.from_bytes(packet[-6:-4], "little")
    assert total == sum(data) & 0xFFFF and data[0] == 2
    found, at = {}, 1
    while (kind := struct.unpack_from("<H", data, at)[0]) != 0:
        found[kind] = struct.unpack_from("<H", data, at + 2)[0]
        at += 4
    assert sorted(found) == [1, 3, 4, 5, 6] and found[1] - at in (2, 4)
    places = {kind: offsets(data, found[kind]) for kind in (3, 4, 5, 6)}
    pillars = [[struct.unpack_from("<H6f", data, pillar) for pillar in offsets(data, at)] for at in places[3]]
    slips = [[struct.unpack_from("<Hbf", data, pillar) for pillar in offsets(data, at)] for at in places[5]]
    assert {row[0] for rows in pillars for row in rows} == {2} and {row for rows in slips for row in rows} == {
        (1, 0, -1)
    }
    assert {struct.unpack_from("<HBff", data, at) for at in places[6]} == {(1, 0, -1, -1)}
    assert places[6][-1] + 11 == len(data), "the last record ends the data"
    counter, time_us = struct.unpack_from("<IQ", data, found[1])
    return {
        "counter": counter,
        "time_us": time_us,
        "pillars": np.array(pillars)[..., 1:],
        "totals": np.array([struct.unpack_from("<H6f", data, at) for at in places[4]])[:, 1:],
    }


def offsets(data: bytes, at: int) -> tuple[int, ...]:
    (count,) = struct.unpack_from("<H", data, at)
    return struct.unpack_from(f"<{count}H", data, at + 2)


@pytest.mark.parametrize(("sensors", "end_offset", "size"), [(2, False, 817), (2, True, 819), (4, False, 1581)])
def test_a_host_finds_everything_by_its_offset(sensors, end_offset, size):
    device = fp.create("contactile_papillarray", sensors=sensors, end_offset=end_offset)
    pushes = np.arange(1, 9 * sensors + 1) / 4
    (packet,) = sample(device, pushes, 5_000_000)
    got = parse(packet)
    assert len(packet) == size and got["time_us"] == 5000
    assert got["pillars"][..., 2].ravel().tolist() == np.minimum(pushes, 15.0).tolist()
    assert got["pillars"][..., 5].ravel().tolist() == pytest.approx(np.minimum(pushes / 6, 2.5))
    assert got["totals"][:, 2].tolist() == np.minimum(pushes, 15.0).reshape(sensors, 9).sum(axis=1).tolist()


def test_axes_torque_and_ranges():
    device = fp.create("contactile_papillarray", sensors=1)
    force = np.zeros((9, 3))
    force[2] = (1.0, -2.0, -4.0)  # upper right: 7 mm right, 7 mm up
    force[4] = (5.0, -6.0, -20.0)
    got = parse(sample(device, force=force)[0])
    assert got["pillars"][0, 2].tolist() == pytest.approx([1, -2, 4, 0.25, -0.5, 4 / 6])
    assert got["pillars"][0, 4].tolist() == [4, -4, 15, 1, -1, 2.5]
    assert got["totals"][0].tolist() == [5, -6, 19, 28, -28, -21]


def test_zero_takes_what_is_felt_and_a_restart_forgets_it():
    device = fp.create("contactile_papillarray")
    sample(device, 3.0)
    assert send(device, b"z\n\0") == []
    got = parse(sample(device, 2.0)[0])
    assert got["pillars"][..., 2].max() == -1.0 and got["pillars"][..., 5].max() == pytest.approx(-1 / 6)
    device.power_cycle()
    assert parse(sample(device, 2.0)[0])["pillars"][..., 2].min() == 2.0


def test_rates_and_what_is_no_command():
    device = fp.create("contactile_papillarray")
    assert device.period_ns == 1_000_000
    for hz in (100, 250, 500, 1000):
        send(device, f"f{hz}\n".encode())
        assert device.period_ns == 10**9 // hz
    send(device, b"f300\nS\n\0s\n")
    assert device.period_ns == 1_000_000
    assert device.counters == {"requests": 6, "unknown_command": 1}


def test_the_counter_rolls_over():
    device = fp.create("contactile_papillarray")
    device.preset("counter", 0xFFFFFFFF)
    assert [parse(sample(device)[0])["counter"] for _ in range(2)] == [0, 1]
