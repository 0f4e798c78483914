"""RobotEra XHand: the state that answers a move, what moves, what is dropped."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tests.firmware.feeding import sample, send

SECOND = 1_000_000_000


def crc(data: bytes) -> bytes:
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return value.to_bytes(2, "little")


def message(command, data=b"", target=0x80) -> bytes:
    frame = struct.pack("<HBBBH", 0xAA55, 0xFE, target, command, len(data)) + data
    return frame + crc(frame)


def move(hand, orders=(), t_ns=0) -> bytes:
    """Orders are (joint, gain p, position, mode); the state."""
    told = {joint: (gain, position, mode) for joint, gain, position, mode in orders}
    rows = [(k, *told.get(k, (0, 0.0, 3))) for k in range(12)]
    data = b"".join(struct.pack("<HhhhfHH8x", k, gain, 0, 0, position, 300, mode) for k, gain, position, mode in rows)
    (reply,) = send(hand, message(2, data), t_ns)
    assert reply[:7] == bytes.fromhex("55AA80FE02A008") and reply[-2:] == crc(reply[:-2]) and len(reply) == 2217
    return reply[7:-2]


@pytest.fixture
def hand():
    return fp.create("robotera_xhand")


def positions(state) -> list[float]:
    return [struct.unpack_from("<f", state, 24 * k + 2)[0] for k in range(12)]


def test_a_state_holds_joints_and_tips(hand):
    force = np.zeros((600, 3))
    force[125] = 0.7, -0.3, -1.2
    hand.measure(reading_of(hand, force=force, temperature=[20, 30, 40, 50, 60]), 0)
    state = move(hand)
    assert [state[24 * k] for k in range(12)] == list(range(12))
    index = state[288 + 384 : 288 + 2 * 384]
    assert struct.unpack_from("<3b", index) == struct.unpack_from("<3b", index, 3 + 3 * 5) == (7, -3, 12)
    assert set(index[363:384]) == {30}
    assert sum(map(bool, index[3:363])) == 3


def test_a_tip_saturates_like_a_point(hand):
    sample(hand, 50.0)
    state = move(hand)
    assert set(state[290:651:3]) == {255} and hand.counts[:, 2].max() == 255


def test_joints_with_a_gain_go_to_their_positions(hand):
    move(hand, [(0, 100, 0.5, 3), (1, 0, 0.5, 3), (2, 100, 0.5, 0), (3, 100, float("nan"), 3), (11, 100, 9.0, 3)])
    assert positions(move(hand, t_ns=SECOND // 20))[0] == pytest.approx(0.25)
    state = positions(move(hand, t_ns=SECOND))
    assert state == pytest.approx([0.5] + [0.0] * 10 + [np.deg2rad(110)])
    assert hand.joints(SECOND)["joint 0"] == 0.5


def test_what_is_not_answered(hand):
    frames = (message(2, bytes(287)), message(0x13, b"\0"), message(7), message(0x13, target=0x81), message(0x12))
    for frame in frames:
        assert send(hand, frame) == []
    assert send(hand, message(0x15, struct.pack("<HH", 500, 13))) == []
    assert send(hand, message(0x13)[:-1] + b"\0") == []
    assert hand.counters["bad_checksum"] == hand.counters["other_address"] == hand.counters["refused"] == 1
    assert (hand.counters["unknown_command"], hand.counters["bad_length"]) == (1, 2)


def data(hand, *message_of, own=0x80) -> bytes:
    (reply,) = send(hand, message(*message_of))
    assert reply[:4] == bytes([0x55, 0xAA, own, 0xFE]) and reply[-2:] == crc(reply[:-2])
    return reply[7:-2]


def test_a_search_finds_what_the_vendors_library_shows():
    hand = fp.create("robotera_xhand", side="left", serial="XH1L42", version="2.10.300")
    found = data(hand, 0x15, struct.pack("<HH", 20, 186), 0xFF)
    assert found[:2] == b"\x14\0" and len(found) == 188
    assert found[2:35] == b"LXH1L42" + bytes(26) and found[35] == 0
    assert found[-24:] == struct.pack("<24b", 0, -60, -10, -10, *[0] * 8, 105, 90, 105, 10, *[110] * 8)
    assert struct.unpack("<HBB", data(hand, 0x13)) == (300, 10, 2)
    assert struct.unpack("<HBB", data(hand, 0x13, b"", 0x0B)) == (7, 0, 1)


def test_a_new_id_is_in_force_at_once_and_kept_by_saving(hand):
    assert data(hand, 0x16, b"\x35\0\x01") == b"\x10\0"
    assert send(hand, message(0x13)) == []
    assert data(hand, 0x05, b"", 0x81, own=0x81) == b"\x10\0"
    assert data(hand, 0x16, b"\x35\0\x02", 0x81, own=0x81) == b"\x10\0"
    hand.power_cycle()
    assert data(hand, 0x15, b"\x35\0\x01\0", 0x81, own=0x81) == b"\x35\0\x01"


def test_a_tip_is_zeroed_by_its_own_number(hand):
    force = np.zeros((600, 3))
    force[::120, 2] = -3.0
    hand.measure(reading_of(hand, force=force, temperature=25.0), 0)
    assert send(hand, message(0x12, b"", 0x12)) == []
    hand.measure(reading_of(hand, force=force, temperature=25.0), 0)
    state = move(hand)
    assert [state[288 + 384 * k + 5] for k in range(5)] == [30, 0, 30, 30, 30]


def test_a_restart_forgets_what_was_not_saved(hand):
    data(hand, 0x16, b"\x36\0name")
    assert list(hand.receive(message(0x14), 0, "")) == [fp.Restart(500_000_000)]
    hand.power_cycle()
    assert not any(data(hand, 0x15, b"\x36\0\x20\0")[2:])
