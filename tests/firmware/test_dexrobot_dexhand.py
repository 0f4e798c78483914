"""DexHand021: modes of feedback, forces and their direction, boards of either side."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "dexrobot_dexhand"


STAND = "440000000000"


def sample_counts(device) -> np.ndarray:
    sample(device)
    return device.counts


def ids(frames) -> list[int]:
    return [frame.arbitration_id for frame in frames]


def test_six_boards_speak_and_the_palm_has_no_fingertip():
    for side, first in (("left", 0x181), ("right", 0x187)):
        frames = sample(fp.create(NAME, side=side), 1.0)
        assert ids(frames) == list(range(first, first + 6))
        assert [len(frame.data) for frame in frames] == [48, 16, 48, 48, 48, 48]
        assert all(frame.is_fd and frame.bitrate_switch for frame in frames)


def test_fingers_sit_on_the_boards_of_the_vendors_driver():
    device = fp.create(NAME)
    frames = sample(device, force=[(0, 0, -force) for force in (1.0, 2.0, 3.0, 4.0, 5.0)])
    felt = {
        frame.arbitration_id - 0x180: struct.unpack_from("<f", frame.data, 16)[0] for frame in frames[:1] + frames[2:]
    }
    assert felt == {1: 1.0, 3: 2.0, 4: 3.0, 5: 4.0, 6: 5.0}


def test_a_hand_at_rest_feels_no_negative_zero():
    assert not np.signbit(sample_counts(fp.create(NAME))).any()


def test_modes_of_feedback_are_each_boards_own():
    device = fp.create(NAME)
    assert [str(each) for each in send(device, "003##10374020001")] == ["083##103740001"]
    assert [str(each) for each in send(device, "004##10374030001")] == ["084##103740001"]
    assert ids(sample(device, 1.0)) == [0x181, 0x182, 0x184, 0x185, 0x186], "the fourth has changed"
    assert ids(sample(device, 1.0)) == [0x181, 0x182, 0x185, 0x186]
    assert ids(send(device, f"103##1{STAND}")) == [0x183] and send(device, f"101##1{STAND}") == []
    assert ids(sample(device, 2.0)) == [0x181, 0x182, 0x184, 0x185, 0x186]
    send(device, "003##10374010001")
    assert 0x183 in ids(sample(device, 2.0))
    send(device, "003##10374010100")
    assert 0x183 not in ids(sample(device, 2.0)), "off"


def test_a_board_sends_at_its_period():
    device = fp.create(NAME)
    sample(device)
    send(device, "006##10374010301")
    sent = [0x186 in ids(sample(device, t_ns=t_ms * 1_000_000)) for t_ms in range(10, 80, 10)]
    assert sent == [False, False, True, False, False, True, False]


def test_motors_go_where_they_are_told_in_degrees_or_counts():
    device = fp.create(NAME)
    sample(device)
    send(device, "101##14402E803D007")  # the second motor of the thumb alone, to 20 degrees
    send(device, "102##15501F0000000")  # 240 counts of the first motor of the palm
    degrees = {name: np.rad2deg(angle) for name, angle in device.joints(3 * 10**9).items()}
    assert degrees["th_dip"] == 0 and degrees["ff_spr"] == 0
    assert degrees["th_mcp"] == pytest.approx(20, abs=0.01) and degrees["th_rot"] == pytest.approx(20, abs=0.01)
    frames = sample(device, t_ns=3 * 10**9)
    assert struct.unpack_from("<hhhhhhhh", frames[0].data) == (0, 0, 0, 0, 0, 280, 0, 2000)


def test_the_version_is_read_backwards():
    device = fp.create(NAME)
    sample(device)
    assert [str(each) for each in send(device, "001##10102000000000000")] == ["081##100000001"]


def test_forces_have_a_direction_clockwise_from_the_tip_and_saturate():
    device = fp.create(NAME)
    sample(device, force=[(0, 1, -2), (1, 0, -2), (0, -1, -2), (-1, 0, 1e9), (0, 0, -1e9)])
    assert device.counts.tolist() == [[2, 1, 0], [2, 1, 90], [2, 1, 180], [0, 1, 270], [50, 0, 0]]
    sample(device, temperature=[-10, 0, 25.4, 40, 1e9])
    assert device.warmth.tolist() == [0, 0, 25, 40, 85]
    assert not np.isnan(device.counts).any()


@pytest.mark.parametrize(
    "request_", ["001#0374020001", "007##10374020001", "000##10374020001", "081##10374020001", "00000001##10374020001"]
)
def test_what_is_for_others_is_ignored(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters.total() == 1 and not device.counters["requests"]


@pytest.mark.parametrize(
    "request_", ["001##1", "001##103", "001##1037401", "001##10374040001", "001##17402", "001##10101", "101##14403"]
)
def test_what_is_not_known_gets_silence(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == []
    assert device.counters["refused"] + device.counters["bad_length"] == 1
