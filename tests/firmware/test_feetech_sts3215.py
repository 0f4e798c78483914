"""Feetech STS3215: what survives power-off, offsets, limits, speeds, status bits, a led arm."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from firmware_protocols.protocols.feetech import packet
from tests.firmware.feeding import sample, send

SECOND = 1_000_000_000


@pytest.fixture
def arm():
    return fp.create("feetech_sts3215")


def read(arm, ident, address, n=2, t_ns=0) -> int:
    (reply,) = send(arm, packet(ident, 2, bytes([address, n])), t_ns)
    return int.from_bytes(reply[5:-1], "little")


def write(arm, ident, address, value, n=1, t_ns=0) -> bytes:
    (reply,) = send(arm, packet(ident, 3, bytes([address]) + value.to_bytes(n, "little")), t_ns)
    return reply


def test_what_is_unlocked_survives_and_what_is_locked_is_lost(arm):
    write(arm, 1, 9, 500, 2)
    write(arm, 1, 55, 0)
    write(arm, 1, 11, 3000, 2)
    write(arm, 2, 5, 20)
    arm.power_cycle()
    assert [read(arm, 1, address) for address in (9, 11)] == [0, 3000]
    assert read(arm, 1, 55, 1) == 1, "locked again"
    assert read(arm, 2, 5, 1) == 2, "the id of servo 2 was locked"
    write(arm, 2, 55, 0)
    assert write(arm, 2, 5, 20)[2] == 2, "answered by the old id"
    arm.power_cycle()
    assert read(arm, 20, 5, 1) == 20 and not send(arm, packet(2, 1))


def test_here_is_the_middle():
    arm = fp.create("feetech_sts3215", encoders=(100, 200, 300, 400, 500, 4000))
    assert read(arm, 6, 56) == 4000
    write(arm, 6, 55, 0)
    write(arm, 6, 40, 128)
    assert [read(arm, 6, 56), read(arm, 6, 31), read(arm, 6, 40, 1)] == [2048, 1952, 0]
    assert arm.joints(0)["gripper"] == 0.0
    arm.power_cycle()
    assert read(arm, 6, 56) == 2048


def test_a_position_is_within_a_turn_unless_the_phase_says_otherwise(arm):
    write(arm, 1, 31, 2047 | 1 << 11, 2)
    assert read(arm, 1, 56) == 4095
    write(arm, 1, 18, 12 | 16)
    write(arm, 1, 9, 0, 4)
    write(arm, 1, 40, 1)
    write(arm, 1, 42, 9000, 2)
    assert read(arm, 1, 56, t_ns=10 * SECOND) == 9000


@pytest.mark.parametrize(("limit", "expected"), [(0, 3300), (500, 500), (9000, 3300)])
def test_it_moves_at_the_limit(arm, limit, expected):
    write(arm, 3, 46, limit, 2)
    write(arm, 3, 40, 1)
    write(arm, 3, 42, 4000, 2)
    assert read(arm, 3, 58, t_ns=SECOND // 10) == expected
    assert read(arm, 3, 56, t_ns=SECOND // 10) == round(2048 + expected / 10)
    assert read(arm, 3, 66, 1, t_ns=SECOND // 10) == 1
    assert read(arm, 3, 56, t_ns=10 * SECOND) == 4000
    assert read(arm, 4, 56, t_ns=10 * SECOND) == 2048, "the others stay"


def test_without_torque_it_stays(arm):
    write(arm, 1, 42, 3000, 2)
    assert read(arm, 1, 56, t_ns=SECOND) == 2048
    write(arm, 1, 40, 1, t_ns=SECOND)
    write(arm, 1, 40, 0, t_ns=SECOND + SECOND // 10)
    assert read(arm, 1, 56, t_ns=9 * SECOND) == 2048 + 330


def test_a_load_holds_it_and_a_load_that_lasts_is_an_overload(arm):
    write(arm, 1, 40, 1)
    write(arm, 1, 48, 500, 2)
    write(arm, 1, 42, 3000, 2)
    load = np.zeros(6)
    load[0] = -2.6
    counts = arm.measure(reading_of(arm, load=load), 0)
    assert counts.tolist() == [884, 0, 0, 0, 0, 0], "it pushes back"
    assert read(arm, 1, 56, t_ns=SECOND) == 2048, "and stands"
    arm.measure(reading_of(arm, load=load), 1_990_000_000)
    assert read(arm, 1, 65, 1, t_ns=SECOND) == 0
    arm.measure(reading_of(arm, load=load), 2 * SECOND)
    assert read(arm, 1, 65, 1, t_ns=2 * SECOND) == 32
    sample(arm)
    assert send(arm, packet(1, 1))[0][4] == 0


def test_too_hot_is_in_every_answer(arm):
    # The frame of lerobot.md: position 2090 of servo 3, status 4.
    arm = fp.create("feetech_sts3215", encoders=2090)
    arm.measure(reading_of(arm, temperature=[25, 25, 71, 25, 25, 25]), 0)
    assert send(arm, "FF FF 03 04 02 38 02 BC") == [bytes.fromhex("FFFF0304042A08C2")]
    assert send(arm, "FF FF 04 04 02 38 02 BB")[0][4] == 0


def test_a_wrong_supply():
    arm = fp.create("feetech_sts3215", volts=15.0)
    assert send(arm, packet(1, 1))[0][4] == 1
    write(arm, 1, 14, 150)
    assert send(arm, packet(1, 1))[0][4] == 0 and read(arm, 1, 62, 1) == 150


def test_a_hand_swings_what_is_released_and_not_what_is_held():
    arm = fp.create("feetech_sts3215", swing=0.5)
    places = [read(arm, 2, 56, t_ns=k * SECOND // 10) for k in range(41)]
    assert places[0] == places[40] == 2048 and np.ptp(places) == pytest.approx(652, abs=5)
    write(arm, 2, 42, read(arm, 2, 56, t_ns=SECOND), 2, t_ns=SECOND)
    write(arm, 2, 40, 1, t_ns=SECOND)
    held = [read(arm, 2, 56, t_ns=SECOND + k * SECOND // 10) for k in range(20)]
    assert set(held) == {places[10]}
    write(arm, 2, 40, 0, t_ns=3 * SECOND)
    assert read(arm, 2, 56, t_ns=3 * SECOND) == places[10], "it goes on from there"
    assert read(arm, 2, 56, t_ns=7 * SECOND) == places[10] != read(arm, 2, 56, t_ns=4 * SECOND)


def test_answers_wait_for_the_return_delay_and_come_at_the_new_speed(arm):
    write(arm, 1, 7, 250)
    (out,) = arm.receive(packet(1, 1), 0, "")
    assert out.delay_ns == 500_000
    write(arm, 1, 55, 0)
    write(arm, 1, 6, 4)
    assert arm.ports[0].baud == 115_200
    arm.power_cycle()
    assert arm.ports[0].baud == 115_200
