"""Synria's module: its own functions, units, the mask, zeros, what survives."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


def ask(module, pdu: bytes, unit=1) -> bytes:
    (reply,) = send(module, rtu(unit, pdu))
    assert reply == rtu(unit, reply[1:-2])
    return reply[1:-2]


def write(module, register, value, unit=1) -> bytes:
    return ask(module, b"\x06" + register.to_bytes(2, "big") + value.to_bytes(2, "big"), unit)


def values(module, unit=1) -> np.ndarray:
    reply = ask(module, b"\x42", unit)
    assert reply[:3] == b"\x42\x78\x00"
    return np.frombuffer(reply[3:], "<u2")


@pytest.fixture
def module():
    return fp.create("synria_60", counts_per_newton=100.0)


def test_zero_and_back(module):
    sample(module, 2.0)
    write(module, 0x12, 1)
    assert not values(module).any()
    sample(module, 5.0)
    assert set(values(module)) == {300}
    write(module, 0x12, 2)
    assert set(values(module)) == {500}


def test_zero_at_power_up_is_kept(module):
    write(module, 0x11, 1)
    module.power_cycle()
    sample(module, 2.0)
    sample(module, 3.0)
    assert set(values(module)) == {100}
    write(module, 0x12, 1)
    assert not values(module).any()
    write(module, 0x12, 2)
    assert set(values(module)) == {100}, "the zero of power-up is back"
    assert ask(module, b"\x03\x00\x12\x00\x01") == b"\x83\x02", "it can only be written"


def test_a_broadcast_is_obeyed_and_not_answered(module):
    assert send(module, rtu(0, b"\x06\x00\x01\x00\x09")) == []
    assert send(module, rtu(1, b"\x42")) == []
    module.power_cycle()
    assert len(values(module, unit=9)) == 60


def test_a_new_unit_answers_a_request_in_the_same_chunk(module):
    (reply,) = send(module, rtu(0, b"\x06\x00\x01\x00\x07") + rtu(7, b"\x03\x00\x01\x00\x01"))
    assert reply == rtu(7, b"\x03\x02\x00\x07")


@pytest.mark.parametrize(
    ("pdu", "error"),
    [("41 00", 3), ("41 05", 3), ("43", 1), ("04 00 0F 00 01", 1), ("03 00 02 00 01", 2), ("06 00 0F 00 01", 2),
     ("06 00 0C 00 31", 3), ("03 00 11 00 01", 2)],
)  # fmt: skip
def test_errors(module, pdu, error):
    pdu = bytes.fromhex(pdu)
    assert ask(module, pdu) == bytes([pdu[0] | 0x80, error])


def test_two_requests_in_one_chunk(module):
    frames = rtu(1, b"\x42") + rtu(1, b"\x41\x01") + rtu(1, b"\x42")[:3]
    assert [reply[1] for reply in send(module, frames)] == [0x42, 0x41]
    assert len(send(module, rtu(1, b"\x42")[3:])) == 1
