"""DexHand021: modes of feedback, forces and their direction, boards of either side."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "dexrobot_dexhand"


def ids(frames) -> list[int]:
    return [frame.arbitration_id for frame in frames]


def test_six_boards_speak_and_the_last_has_no_fingertip():
    for side, first in (("left", 0x181), ("right", 0x187)):
        frames = sample(fp.create(NAME, side=side), 1.0)
        assert ids(frames) == list(range(first, first + 6))
        assert [len(frame.data) for frame in frames] == [48] * 5 + [16]
        assert all(frame.is_fd and frame.bitrate_switch for frame in frames)


def test_modes_of_feedback_are_each_boards_own():
    device = fp.create(NAME)
    assert [str(each) for each in send(device, "003##17402")] == ["083##103740001"]
    assert [str(each) for each in send(device, "004##1037403")] == ["084##103740001"]
    assert ids(sample(device, 1.0)) == [0x181, 0x182, 0x184, 0x185, 0x186], "the fourth has changed"
    assert ids(sample(device, 1.0)) == [0x181, 0x182, 0x185, 0x186]
    assert ids(send(device, "103##100")) == [0x183] and send(device, "101##100") == []
    assert ids(sample(device, 2.0)) == [0x181, 0x182, 0x184, 0x185, 0x186]
    send(device, "003##17401")
    assert 0x183 in ids(sample(device, 2.0))


def test_forces_have_a_direction_clockwise_from_the_tip_and_saturate():
    device = fp.create(NAME)
    sample(device, force=[(0, 1, -2), (1, 0, -2), (0, -1, -2), (-1, 0, 1e9), (0, 0, -1e9)])
    assert device.counts.tolist() == [[2, 1, 0], [2, 1, 90], [2, 1, 180], [0, 1, 270], [50, 0, 0]]
    sample(device, temperature=[-10, 0, 25.4, 40, 1e9])
    assert device.warmth.tolist() == [0, 0, 25, 40, 85]
    assert not np.isnan(device.counts).any()


@pytest.mark.parametrize("request_", ["001#7402", "007##17402", "000##17402", "081##17402", "00000001##17402"])
def test_what_is_for_others_is_ignored(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters["ignored"] == 1


@pytest.mark.parametrize("request_", ["001##1", "001##174", "001##17404", "001##103", "001##155"])
def test_what_is_not_known_gets_silence(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters["unknown_command"] == 1
