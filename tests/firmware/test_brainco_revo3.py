"""BrainCo Revo3 Touch: arrays and matrices, modes, zeros."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


def ask(device, pdu: bytes) -> bytes:
    (reply,) = send(device, rtu(0x7E, pdu))
    return reply[1:-2]


def read(device, address, count, function=3) -> list[int]:
    return list(struct.unpack(f">{count}H", ask(device, struct.pack(">BHH", function, address, count))[2:]))


def write(device, address, value) -> bytes:
    return ask(device, struct.pack(">BHH", 6, address, value))


def test_modes_change_the_scale():
    array, matrix = fp.create("brainco_revo3"), fp.create("brainco_revo3", touch="matrix")
    write(array, 4024, 2)
    write(matrix, 5204, 1)
    for device in (array, matrix):
        sample(device, 0.5)
    assert read(array, 4200, 2, 4) == [500, 500]
    assert read(matrix, 5240, 1) == [0x1919] and read(matrix, 5340, 1) == [0x3232]
    write(matrix, 5202, 1)
    sample(matrix, 0.5)
    assert read(matrix, 5240, 1) == [0x3232]


def test_zero_of_one_module_and_of_all():
    device = fp.create("brainco_revo3", touch="matrix")
    sample(device, 1.0)
    write(device, 5216, 1)
    sample(device, 1.5)
    assert read(device, 5340, 1) == [0x1919] and read(device, 5240, 1) == [0x4B4B]
    assert read(device, 5226, 4) == [0, 0, 1, 0]
    write(device, 5214, 1)
    assert read(device, 5226, 12) == [1] * 12
    write(device, 5179, 1)
    sample(device, 1.5)
    assert read(device, 5340, 1) == [0x4B4B] and read(device, 5226, 12) == [0] * 12


def test_regions_are_sums_and_modules_that_are_off_read_zero():
    device = fp.create("brainco_revo3")
    write(device, 4001, 0)
    sample(device, 0.1)
    assert read(device, 4100, 5, 4) == [3600, 0, 0, 0, 1000] and read(device, 4250, 2, 4) == [0, 0]
    write(device, 4001, 1)
    write(device, 4011, 1)
    sample(device, np.where(np.arange(len(device.layout)) == 36, 1.1, 0.1))
    assert read(device, 4100, 3, 4) == [0, 1000, 0] and read(device, 4011, 1) == [0]


@pytest.mark.parametrize(
    ("pdu", "code"), [("060fb80003", 3), ("0610680001", 2), ("0316300010", 0), ("0323280001", 2), ("010fa00001", 1)]
)
def test_exceptions(pdu, code):
    request = bytes.fromhex(pdu)
    reply = ask(fp.create("brainco_revo3"), request)
    assert (reply == bytes([request[0] | 0x80, code])) == bool(code)


def test_on_canfd_29_registers_fit_a_frame():
    device = fp.create("brainco_revo3_canfd")
    sample(device, 1.0)
    (answer,) = send(device, "007E0108##17E041068001DBED0")
    assert answer.arbitration_id == 0x7E013F and answer.data[3:61] == (200).to_bytes(2, "big") * 29
    (refused,) = send(device, "007E0108##17E04106800247EC2")
    assert str(refused) == "007E0105##17E840332D9"
    for text in ("007F0108##17E041068001DBED0", "007E0108#7E041068001DBED0"):
        assert send(device, text) == []
    assert device.counters["ignored"] == 2
