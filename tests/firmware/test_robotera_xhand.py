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
    hand.feel(reading_of(hand, force=force, temperature=[20, 30, 40, 50, 60]), 0)
    state = move(hand)
    assert [state[24 * k] for k in range(12)] == list(range(12))
    index = state[288 + 384 : 288 + 2 * 384]
    assert struct.unpack_from("<3b", index) == struct.unpack_from("<3b", index, 3 + 3 * 5) == (7, -3, 12)
    assert set(index[363:383]) == {30} and index[383] == 0
    assert sum(map(bool, index[3:363])) == 3


def test_a_tip_saturates_like_a_point(hand):
    sample(hand, 50.0)
    state = move(hand)
    assert set(state[290:651:3]) == {127} and hand.counts[:, 2].max() == 127


def test_joints_with_a_gain_go_to_their_positions(hand):
    move(hand, [(0, 100, 0.5, 3), (1, 0, 0.5, 3), (2, 100, 0.5, 0), (3, 100, float("nan"), 3), (11, 100, 9.0, 3)])
    assert positions(move(hand, t_ns=SECOND // 20))[0] == pytest.approx(0.25)
    state = positions(move(hand, t_ns=SECOND))
    assert state == pytest.approx([0.5] + [0.0] * 10 + [3.0])
    assert hand.joints(SECOND)["joint 0"] == 0.5


def test_what_is_not_answered(hand):
    for frame in (message(2, bytes(287)), message(0x13, b"\0"), message(7), message(0x13, target=0x81)):
        assert send(hand, frame) == []
    assert send(hand, message(0x13)[:-1] + b"\0") == []
    assert hand.counters["bad_checksum"] == hand.counters["other_address"] == 1
    assert hand.counters["unknown_command"] == 3
    assert send(hand, message(0x13)) == [bytes.fromhex("55AA80FE130500") + b"1.2.3" + send(hand, message(0x13))[0][-2:]]
