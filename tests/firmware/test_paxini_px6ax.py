"""PaXini GEN3 board: captured frames, memory, zero, refusals."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.devices.paxini_modules import TAXELS_BY_MODEL
from tests.firmware.feeding import sample, send


def ask(device, device_id, function, address, count, data=b"", t_ns=0):
    body = struct.pack("<BBHBBBIH", 0x55, 0xAA, 9 + len(data), device_id, 0, function, address, count) + data
    (reply,) = send(device, body + bytes([-sum(body) & 0xFF]), t_ns)
    assert reply[:2] == b"\xaa\x55" and sum(reply) & 0xFF == 0
    assert len(reply) == 5 + struct.unpack_from("<H", reply, 2)[0]
    assert struct.unpack_from("<BBBIH", reply, 4) == (device_id, 0, function, address, count)
    return reply[13], reply[14:-1]


@pytest.mark.parametrize("model", TAXELS_BY_MODEL)
def test_every_model(model):
    device = fp.create("paxini_px6ax", models=model, places=[1])
    n = TAXELS_BY_MODEL[model]
    force = np.zeros((n, 3))
    force[n - 1] = (1.2, -0.7, -3.0)
    sample(device, force=force)
    status, data = ask(device, 1, 0xFB, 0x3F0, 30 + 3 * n)
    taxels = np.frombuffer(data[30:], np.uint8).reshape(n, 3)
    assert status == 1 and not taxels[:-1].any()
    expected = (12, 256 - 7, 30)
    assert tuple(taxels[-1]) == expected and tuple(data[:3]) == expected and not any(data[3:30])
    assert ask(device, 1, 0xFB, 0x40E, 3 * n) == (1, data[30:])
    assert ask(device, 1, 0xFB, 0x3F0, 3) == (1, data[:3])


def test_saturation():
    device = fp.create("paxini_px6ax")
    sample(device, force=np.full((31, 3), [99.0, -99.0, -99.0]))
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (1, bytes([127, 0x80, 255]))
    sample(device, force=np.full((31, 3), [0.0, 0.0, 9.0]))
    assert ask(device, 3, 0xFB, 0x40E, 3) == (1, bytes(3))


def test_zero_holds_until_power_off():
    device = fp.create("paxini_px6ax")
    sample(device, 1.0)
    assert ask(device, 3, 0x79, 3, 1, b"\x01") == (0, b"")
    assert ask(device, 3, 0xFB, 0x3F0, 6) == (1, bytes(6))
    sample(device, 1.5)
    assert ask(device, 3, 0xFB, 0x40E, 3) == (1, bytes([0, 0, 5]))
    device.power_cycle()
    sample(device, 1.5)
    assert ask(device, 3, 0xFB, 0x40E, 3) == (1, bytes([0, 0, 15]))


def test_zero_off_is_accepted_and_changes_nothing():
    device = fp.create("paxini_px6ax")
    sample(device, 1.0)
    assert ask(device, 3, 0x79, 3, 1, b"\x00") == (0, b"")
    assert ask(device, 3, 0xFB, 0x40E, 3) == (1, bytes([0, 0, 10]))


@pytest.mark.parametrize(("model", "code"), [("S1813E", b"PXSR-STDDP03F"), ("L5325", b"PXSR-STDCP03A")])
def test_hosts_find_the_model_in_the_version_text(model, code):
    status, text = ask(fp.create("paxini_px6ax", models=model, places=[3]), 3, 0xFB, 6100, 100)
    assert status == 1 and code in text and len(text) == 100


def test_it_converts_every_12_ms():
    assert fp.create("paxini_px6ax").period_ns == 12_000_000


def test_the_reserved_byte_is_not_looked_at():
    body = bytes.fromhex("55aa09000301fbf00300000300")
    (reply,) = send(fp.create("paxini_px6ax"), body + bytes([-sum(body) & 0xFF]))
    assert reply[4:7].hex() == "0300fb" and len(reply) == 18


def test_only_its_own_address_is_answered():
    device = fp.create("paxini_px6ax")
    for address in range(9):
        body = bytes([0x55, 0xAA, 9, 0, address, 0, 0xFB, 0xD4, 0x17, 0, 0, 100, 0])
        assert len(send(device, body + bytes([-sum(body) & 0xFF]))) == (address == 3)
        assert len(send(device, body + bytes([-sum(body) + 1 & 0xFF]))) == (address == 3), "nor is a bad sum"
    assert ask(fp.create("paxini_px6ax", models="L5325"), 1, 0xFB, 0x3F0, 3) == (1, bytes(3))


def test_a_single_module_answers_to_a_broadcast():
    assert ask(fp.create("paxini_px6ax"), 0xFF, 0xFB, 0x3F0, 3) == (1, bytes(3))
    body = bytes([0x55, 0xAA, 9, 0, 0xFF, 0, 0xFB, 0xF0, 0x03, 0, 0, 3, 0])
    assert send(fp.create("paxini_px6ax", models=["S1813E", "M2020"]), body + bytes([-sum(body) & 0xFF])) == []


def test_drivers_that_take_status_00_alone():
    device = fp.create("paxini_px6ax", read_status=0)
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (0, bytes(3))


def test_each_module_tells_its_own_model():
    device = fp.create("paxini_px6ax", models=["L5325", "S1813E"], places=[1, 3])
    assert b"CP03A" in ask(device, 1, 0xFB, 6100, 100)[1] and b"DP03F" in ask(device, 3, 0xFB, 6100, 100)[1]


def test_modules_by_device_id():
    device = fp.create("paxini_px6ax", models=["S1813E", "M2020"], places=[3, 7])
    force = np.zeros((40, 3))
    force[31:, 2] = -1.0
    sample(device, force=force)
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (1, bytes(3))
    assert ask(device, 7, 0xFB, 0x40E, 27) == (1, bytes([0, 0, 10] * 9))
    body = bytes.fromhex("55aa09000500fbf00300000300")
    assert send(device, body + bytes([-sum(body) & 0xFF])) == []


@pytest.mark.parametrize(
    ("function", "address", "count", "status"),
    [(0xFB, 0x3EF, 3, 6), (0xFB, 0x40E, 94, 6), (0xFB, 99999, 3, 6), (0x79, 4, 0, 6), (0x79, 3, 1, 1), (0x7A, 3, 3, 3)],
)
def test_refusals(function, address, count, status):
    device = fp.create("paxini_px6ax")
    assert ask(device, 3, function, address, count) == (status, b"")
    assert ask(device, 3, 0xFB, 0x3F0, 3) == (1, bytes(3))


def test_bad_checksum_and_length_are_counted_and_answered():
    device = fp.create("paxini_px6ax")
    good = bytes.fromhex("55aa09000300fbf00300007b008c")
    (reply,) = send(device, good[:-1] + b"\x00", 0)
    assert reply[13] == 2 and device.counters["bad_checksum"] == 1
    (reply,) = send(device, bytes.fromhex("55aaffff0300fbf00300007b00"), 10**9)
    assert reply[13] == 1 and device.counters["bad_length"] == 1
    assert len(send(device, good, 2 * 10**9)[0]) == 15 + 123


def test_half_a_request_is_forgotten():
    device = fp.create("paxini_px6ax")
    good = bytes.fromhex("55aa09000300fbf00300007b008c")
    assert send(device, good[:9], 0) == []
    assert len(send(device, good, 60_000_000)) == 1


def test_unknown_model():
    with pytest.raises(ValueError, match="S1813E"):
        fp.create("paxini_px6ax", models="S9999")
