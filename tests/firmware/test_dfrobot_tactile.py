"""DFRobot's tactile matrix: rows from the bottom, settings with their bytes turned."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


@pytest.fixture
def device():
    return fp.create("dfrobot_tactile")


def ask(device, pdu: str, t_ns=0, unit=1) -> bytes:
    (reply,) = send(device, rtu(unit, bytes.fromhex(pdu)), t_ns)
    return reply[1:-2]


def values(device, count=36) -> np.ndarray:
    return np.array(struct.unpack(f">{count}H", ask(device, f"040007{count:04x}")[2:]))


def test_the_last_row_comes_first(device):
    sample(device, {"matrix": np.arange(32).reshape(4, 8) / 10})
    assert values(device).reshape(-1, 4).ravel()[:9].tolist() == [40 * n for n in (24, 25, 26, 27, 28, 29, 30, 31, 16)]
    assert ask(device, "04002b0001")[2:] == b"\0\0" and not values(device)[32:].any()
    six = fp.create("dfrobot_tactile", model="6x6")
    sample(six, 20.0)
    assert values(six).tolist() == [4095] * 36 and ask(six, "04002b0001")[2:] == b"\0\1"


def test_settings_are_kept_low_byte_first(device):
    ask(device, "0600062c01")
    ask(device, "0600080100")
    assert device.period_ns == 20_000_000 and ask(device, "0300060001") == bytes.fromhex("03022c01")
    sample(device, np.where(np.arange(32) < 16, 299 / 400, 300 / 400))
    assert values(device, 32).tolist() == [300] * 16 + [0] * 16
    device.power_cycle()
    assert ask(device, "0300060001", unit=1) == bytes.fromhex("03022c01") and device.period_ns == 20_000_000


def test_register_7_restores_all_but_the_unit(device):
    for pdu in ("0600062c01", "0600080100", "0600030900", "0600040302"):
        ask(device, pdu)
    assert send(device, rtu(1, bytes.fromhex("0600020700"))) == [rtu(7, bytes.fromhex("0600020700"))]
    assert send(device, rtu(1, bytes.fromhex("0300020001"))) == [] and device.counters["other_unit"] == 1
    assert ask(device, "0600070000", unit=7) == bytes.fromhex("0600070000")
    device.power_cycle()
    assert ask(device, "0300020007", unit=7)[2:] == bytes.fromhex("0700 0800 0100 0000 3200 0000 0000")
    assert device.period_ns == 50_000_000


def test_pushes_below_50_counts_read_0_as_delivered(device):
    sample(device, np.where(np.arange(32) < 16, 49 / 400, 50 / 400))
    assert values(device, 32).tolist() == [50] * 16 + [0] * 16


@pytest.mark.parametrize(("pdu", "code"), [("0600060010", 3), ("0600080200", 3), ("0600010001", 2), ("010000000a", 1)])
def test_exceptions(device, pdu, code):
    assert ask(device, pdu) == bytes([int(pdu[:2], 16) | 0x80, code])
