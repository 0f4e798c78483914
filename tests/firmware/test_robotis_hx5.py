"""ROBOTIS HX5-D20: tables that follow the fingers while they are enabled, indirect addresses, motors."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.dynamixel import packet
from tests.firmware.feeding import sample, send

SECOND = 1_000_000_000
PRESSURES = {"thumb": 1102, "index": 1300, "middle": 1498, "ring": 1696, "little": 1894}


@pytest.fixture
def hand():
    return fp.create("robotis_hx5")


def read(hand, address, n, t_ns=0, ident=110) -> bytes:
    (reply,) = send(hand, packet(ident, 2, address.to_bytes(2, "little") + n.to_bytes(2, "little")), t_ns)
    assert reply[8] == 0
    return reply[9:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def write(hand, address, data, t_ns=0, ident=110) -> int:
    (reply,) = send(hand, packet(ident, 3, address.to_bytes(2, "little") + bytes(data)), t_ns)
    return reply[8]


def test_pressures_lie_where_the_model_file_says(hand):
    write(hand, 70, [1])
    sample(hand, np.arange(45) * 0.1)
    for k, at in enumerate(PRESSURES.values()):
        assert list(read(hand, at, 9)) == [5 * (9 * k + cell) for cell in range(9)]
    assert [patch.name for patch in hand.layout.patches] == list(PRESSURES)


def test_tables_stand_still_while_they_are_not_enabled(hand):
    sample(hand, 1.0)
    assert read(hand, 1102, 9) == bytes(9), "never enabled"
    write(hand, 70, [1])
    write(hand, 70, [0])
    sample(hand, 2.0)
    assert read(hand, 1102, 9) == bytes([50] * 9), "what it was when it was switched off"
    write(hand, 70, [1])
    assert read(hand, 1102, 9) == bytes([100] * 9)


def test_motors_go_while_enabled(hand):
    goal = (3000).to_bytes(2, "little")
    write(hand, 1152, goal)
    assert hand.joints(SECOND)["thumb 1"] == 0.0
    write(hand, 70, [1], SECOND)
    assert hand.joints(3 * SECOND)["thumb 1"] == pytest.approx(952 * 0.001534)
    speed = int.from_bytes(read(hand, 1080, 2, SECOND + SECOND // 20), "little", signed=True)
    assert speed * 0.02397 == pytest.approx(6.0, abs=0.02)
    assert read(hand, 1082, 2, 3 * SECOND) == goal
    write(hand, 1152, (60000).to_bytes(2, "little"))
    assert len(hand.joints(0)) == 20


def test_the_second_motors_goals_follow_the_firsts(hand):
    write(hand, 70, [1])
    write(hand, 1154, [0, 0, *(3000).to_bytes(2, "little")])
    joints = hand.joints(2 * SECOND)
    assert joints["thumb 2"] == pytest.approx(952 * 0.001534) and joints["thumb 1"] == joints["thumb 3"] == 0.0


def test_every_node_answers_ping_and_reboot(hand):
    for ident in range(110, 136):
        (reply,) = send(hand, packet(ident, 1))
        model = int.from_bytes(reply[9:11], "little")
        assert model == (260 if ident == 110 else 0 if ident % 5 == 0 else 1700)
        assert send(hand, packet(ident, 8)) == [packet(ident, 0x55, b"\0")]
    assert len(send(hand, packet(0xFE, 1))) == 26
    assert not hand.counters["unknown_command"]


def test_a_reboot_forgets_what_is_not_kept(hand):
    write(hand, 60, [2, 0], ident=111)
    write(hand, 84, [244, 1], ident=111)
    write(hand, 70, [1])
    for ident in (110, 111):
        send(hand, packet(ident, 8))
    assert read(hand, 60, 2, ident=111) == bytes([2, 0]) and read(hand, 84, 2, ident=111) == bytes(2)
    assert read(hand, 70, 1) == bytes(1) and read(hand, 0, 2) == (260).to_bytes(2, "little")
    hand.power_cycle()
    assert read(hand, 60, 2, ident=111) == bytes([2, 0])


def test_tables_show_what_their_slots_say(hand):
    sample(hand, np.arange(45) * 0.1)
    write(hand, 1024, [120, 99])  # the index's sensor, and nobody
    write(hand, 1030, [*(72).to_bytes(2, "little")])
    write(hand, 1042, [9, 0])
    write(hand, 70, [1])
    assert list(read(hand, 1078, 9)) == [5 * (9 + cell) for cell in range(9)]
    assert read(hand, 1087, 6) == bytes(6)


def test_a_motor_without_torque_stays(hand):
    write(hand, 10, [4], ident=134)
    write(hand, 116, (3000).to_bytes(4, "little"), ident=134)
    assert hand.joints(SECOND)["little 4"] == 0.0
    write(hand, 64, [1], SECOND, ident=134)
    assert hand.joints(3 * SECOND)["little 4"] == pytest.approx(952 * 0.001534)


def test_a_left_hand_has_other_ids_and_what_is_kept_is_kept():
    hand = fp.create("robotis_hx5", id=140)
    assert read(hand, 0, 2, ident=140) == (261).to_bytes(2, "little")
    assert not send(hand, packet(110, 1)) and send(hand, packet(0xFE, 1))[0][4] == 140
    write(hand, 7, [99], ident=140)
    hand.power_cycle()
    assert read(hand, 7, 1, ident=99) == b"\x63"


def test_indirect_addresses_that_point_at_themselves_or_nowhere_show_nothing(hand):
    write(hand, 122, [*(634).to_bytes(2, "little"), *(60000).to_bytes(2, "little"), 7, 0])
    assert read(hand, 634, 3) == bytes([0, 0, 110])
    write(hand, 452, [*(799).to_bytes(2, "little"), *(0).to_bytes(2, "little"), 65, 0])
    assert write(hand, 799, [5, 6, 1]) == 0 and read(hand, 65, 1) == b"\x01"
    assert hand.counters["refused"] == 1, "the model cannot be written"


def test_the_tick_rolls_over(hand):
    hand.preset("tick", 65_000)
    assert int.from_bytes(read(hand, 100, 2, SECOND), "little") == 66_000 - 65_536
