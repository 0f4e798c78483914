"""Inspire RH56DFTP: byte addresses, matrices, actuators, orders."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.devices.inspire_rh56dftp import InspireRh56dftp
from tests.firmware.feeding import push
from tests.firmware.golden import golden_vectors, replay

TABLE = {
    # from the drivers' map: first address of each matrix, rows, columns
    "little tip": (3000, 3, 3), "little top": (3018, 12, 8), "little pad": (3210, 10, 8),
    "ring tip": (3370, 3, 3), "ring top": (3388, 12, 8), "ring pad": (3580, 10, 8),
    "middle tip": (3740, 3, 3), "middle top": (3758, 12, 8), "middle pad": (3950, 10, 8),
    "index tip": (4110, 3, 3), "index top": (4128, 12, 8), "index pad": (4320, 10, 8),
    "thumb tip": (4480, 3, 3), "thumb top": (4498, 12, 8), "thumb middle": (4690, 3, 3), "thumb pad": (4708, 12, 8),
    "palm": (4900, 14, 8),
}  # fmt: skip


@pytest.fixture
def device():
    device = fp.create("inspire_rh56dftp")
    device.plug("tcp")
    device.power_on(0)
    return device


def ask(device, pdu: bytes, t_ns=0) -> bytes:
    (reply,) = device.receive(struct.pack(">HHHB", 77, 0, len(pdu) + 1, 1) + pdu, t_ns)
    assert struct.unpack_from(">HHHB", reply) == (77, 0, len(reply) - 6, 1)
    return reply[7:]


def read(device, address, count, t_ns=0) -> list[int]:
    reply = ask(device, struct.pack(">BHH", 3, address, count), t_ns)
    assert reply[:2] == bytes([3, 2 * count])
    return list(struct.unpack(f">{count}h", reply[2:]))


def write(device, address, *values, t_ns=0) -> bytes:
    pdu = struct.pack(f">BHHB{len(values)}h", 16, address, len(values), 2 * len(values), *values)
    return ask(device, pdu, t_ns)


@pytest.mark.parametrize("vector", golden_vectors("inspire_rh56dftp"), ids=lambda v: v["name"])
def test_golden(vector):
    replay(vector, "inspire_rh56dftp")


def test_matrices_lie_where_the_drivers_look(device):
    assert {p.name: (a, p.rows, p.cols) for p, a, _ in device.matrices()} == TABLE
    device.sample(push(device, np.linspace(0.0, 4.0, 1062)), 0)
    for patch, address, size in device.matrices():
        assert read(device, address, size // 2) == device.counts[patch.taxels].tolist()
    assert device.counts[-1] == 4000 and device.digitize(push(device, 9.0)).max() == 4096


def test_addresses_count_bytes(device):
    device.sample(push(device, np.linspace(0.0, 4.0, 1062)), 0)
    memory = device.counts.astype("<i2").tobytes()
    assert read(device, 3001, 4) == list(struct.unpack_from("<4h", memory, 1))
    assert read(device, 3018 + 125, 67) == list(struct.unpack_from("<67h", memory, 18 + 125))


def test_angles_follow_at_their_speed(device):
    assert read(device, 1546, 6) == [1000] * 6
    write(device, 1486, 0, -1, 500, -1, -1, 1000)
    assert read(device, 1546, 6, t_ns=400_000_000) == [500, 1000, 500, 1000, 1000, 1000]
    assert read(device, 1594, 3, t_ns=400_000_000) == [200, 0, 0]
    assert read(device, 1612, 3, t_ns=400_000_000) == [0x0201, 0x0202, 0x0202]
    write(device, 1522, 500, 500, 500, 500, 500, 500, t_ns=400_000_000)
    assert read(device, 1546, 1, t_ns=800_000_000) == [250]
    assert read(device, 1546, 1, t_ns=10**10) == [0] and read(device, 1534, 1, t_ns=10**10) == [2000]
    write(device, 1474, 0, t_ns=10**10)
    assert read(device, 1546, 1, t_ns=2 * 10**10) == [1000]


def test_forces_in_grams_and_their_zero(device):
    device.sample(push(device, np.where(np.arange(1062) == 370, 1.962, 0.0)), 0)
    assert read(device, 1582, 6) == [0, 0, 200, 0, 0, 0]
    ask(device, struct.pack(">BHH", 6, 1009, 1))
    assert read(device, 1582, 6) == [0] * 6 and read(device, 1009, 1) == [0]


def test_unit_changes_when_saved_and_powered_again(device):
    ask(device, struct.pack(">BHH", 6, 1000, 9))
    assert read(device, 1000, 1) == [9]
    device.power_on(0)
    assert read(device, 1000, 1) == [1]
    ask(device, struct.pack(">BHH", 6, 1000, 9))
    ask(device, struct.pack(">BHH", 6, 1005, 1))
    device.power_on(0)
    (reply,) = device.receive(bytes.fromhex("004d00000006 09 03 03e80001".replace(" ", "")), 0)
    assert reply[-2:] == b"\x00\x09"
    assert device.receive(bytes.fromhex("004d00000006010303e80001"), 0) == []


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        ("04 03e8 0001", 1),
        ("2b 0e 01 00", 1),
        ("03 176f 0001", 2),
        ("06 0bb8 0001", 2),
        ("06 0618 0000", 2),
        ("10 05fc 0002 04 0000 0000", 2),
        ("03 0bb8 0000", 3),
        ("06 05ce 07d1", 3),
        ("10 05ce 0002 02 0000", 3),
        ("06 03e8 0000", 3),
    ],
)
def test_exceptions_change_nothing(device, pdu, code):
    before = bytes(device.registers.snapshot(0))
    function = int(pdu[:2], 16)
    assert ask(device, bytes.fromhex(pdu.replace(" ", ""))) == bytes([function | 0x80, code])
    assert bytes(device.registers.snapshot(0)) == before


def test_rtu_gap_ends_a_broken_frame():
    device = InspireRh56dftp()
    good = bytes.fromhex("01030000000ac5cd")
    assert device.receive(good[:5], 0) == []
    assert len(device.receive(good, 2_000_000)) == 1
    assert device.counters["broken_frames"] == 1
    assert device.receive(good[:5], 10_000_000) == []
    assert len(device.receive(good[5:], 11_000_000)) == 1, "a pause of less than 1.75 ms is none"
    assert device.receive(good[:-1] + b"\x00", 20_000_000) == [] and device.counters["bad_checksum"] == 1


def test_rtu_unknown_function_is_refused_where_its_crc_fits():
    device = InspireRh56dftp()
    request = device._server.request(bytes.fromhex("4101020304"))
    assert device.receive(request, 0) == [device._server.request(b"\xc1\x01")]


def test_tcp_impossible_header_is_forgotten(device):
    assert device.receive(bytes.fromhex("004d000100060103"), 0) == []
    assert device.counters["broken_frames"] == 1
    assert read(device, 1000, 1) == [1]


def test_no_other_connector(device):
    with pytest.raises(ValueError, match="serial, tcp"):
        device.plug("can")
