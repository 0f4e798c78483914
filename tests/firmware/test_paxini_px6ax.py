"""PaXini GEN3 board: captured frames, memory, zero, refusals."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Reading
from firmware_protocols.devices.paxini_modules import TAXELS
from firmware_protocols.devices.paxini_px6ax import PaxiniPx6ax
from tests.firmware.feeding import check_commands, push, survive
from tests.firmware.golden import golden_vectors, replay


def ask(device, device_id, function, address, count, data=b"", t_ns=0):
    body = struct.pack("<BBHBBBIH", 0x55, 0xAA, 9 + len(data), device_id, 0, function, address, count) + data
    (reply,) = device.receive(body + bytes([-sum(body) & 0xFF]), t_ns)
    assert reply[:2] == b"\xaa\x55" and sum(reply) & 0xFF == 0
    assert len(reply) == 5 + struct.unpack_from("<H", reply, 2)[0]
    assert struct.unpack_from("<BBBIH", reply, 4) == (device_id, 0, function, address, count)
    return reply[13], reply[14:-1]


@pytest.mark.parametrize("vector", golden_vectors("paxini_px6ax"), ids=lambda v: v["name"])
def test_golden(vector):
    replay(vector, "paxini_px6ax")


def test_commands():
    check_commands(PaxiniPx6ax, trailing=b"\x55\x00")


def test_survives_noise():
    survive(PaxiniPx6ax(), gap_ns=100_000_000)


@pytest.mark.parametrize("model", TAXELS)
def test_every_model(model):
    device = fp.create("paxini_px6ax", models=model)
    n = TAXELS[model]
    force = np.zeros((n, 3))
    force[n - 1] = (1.2, -0.7, -3.0)
    device.sample(Reading(t_ns=0, values=force), 0)
    status, data = ask(device, 1, 0xFB, 0x3F0, 30 + 3 * n)
    taxels = np.frombuffer(data[30:], np.uint8).reshape(n, 3)
    assert status == 0 and not taxels[:-1].any()
    expected = (12, 256 - 7, 30)
    assert tuple(taxels[-1]) == expected and tuple(data[:3]) == expected and not any(data[3:30])
    assert ask(device, 1, 0xFB, 0x40E, 3 * n) == (0, data[30:])
    assert ask(device, 1, 0xFB, 0x3F0, 3) == (0, data[:3])


def test_saturation():
    device = fp.create("paxini_px6ax")
    device.sample(Reading(t_ns=0, values=np.full((31, 3), [99.0, -99.0, -99.0])), 0)
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (0, bytes([127, 0x80, 255]))
    device.sample(Reading(t_ns=0, values=np.full((31, 3), [0.0, 0.0, 9.0])), 0)
    assert ask(device, 3, 0xFB, 0x40E, 3) == (0, bytes(3))


def test_zero_holds_until_power_off():
    device = fp.create("paxini_px6ax")
    device.sample(push(device, 1.0), 0)
    assert ask(device, 3, 0x79, 3, 1, b"\x01") == (0, b"")
    assert ask(device, 3, 0xFB, 0x3F0, 6) == (0, bytes(6))
    device.sample(push(device, 1.5), 0)
    assert ask(device, 3, 0xFB, 0x40E, 3) == (0, bytes([0, 0, 5]))
    device.power_on(0)
    device.sample(push(device, 1.5), 0)
    assert ask(device, 3, 0xFB, 0x40E, 3) == (0, bytes([0, 0, 15]))


def test_modules_by_device_id():
    device = fp.create("paxini_px6ax", models=["S1813E", "M2020"], places=[3, 7])
    force = np.zeros((40, 3))
    force[31:, 2] = -1.0
    device.sample(Reading(t_ns=0, values=force), 0)
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (0, bytes(3))
    assert ask(device, 7, 0xFB, 0x40E, 27) == (0, bytes([0, 0, 10] * 9))
    body = bytes.fromhex("55aa09000500fbf00300000300")
    assert device.receive(body + bytes([-sum(body) & 0xFF]), 0) == []


@pytest.mark.parametrize(
    ("function", "address", "count", "status"),
    [(0xFB, 0x3EF, 3, 4), (0xFB, 0x40E, 94, 4), (0xFB, 99999, 3, 4), (0x79, 4, 0, 4), (0x7A, 3, 3, 3)],
)
def test_refusals(function, address, count, status):
    device = fp.create("paxini_px6ax")
    assert ask(device, 3, function, address, count) == (status, b"")
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (0, bytes(3))


def test_bad_checksum_and_length_are_counted_and_answered():
    device = fp.create("paxini_px6ax")
    good = bytes.fromhex("55aa09000300fbf00300007b008c")
    (reply,) = device.receive(good[:-1] + b"\x00", 0)
    assert reply[13] == 1 and device.counters["bad_checksum"] == 1
    (reply,) = device.receive(bytes.fromhex("55aaffff0300fbf00300007b00"), 10**9)
    assert reply[13] == 2 and device.counters["bad_length"] == 1
    assert len(device.receive(good, 2 * 10**9)[0]) == 15 + 123


def test_half_a_request_is_forgotten():
    device = fp.create("paxini_px6ax")
    good = bytes.fromhex("55aa09000300fbf00300007b008c")
    assert device.receive(good[:9], 0) == []
    assert len(device.receive(good, 60_000_000)) == 1


def test_unknown_model():
    with pytest.raises(ValueError, match="S1813E"):
        fp.create("paxini_px6ax", models="S9999")
