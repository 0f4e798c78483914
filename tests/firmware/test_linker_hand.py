"""LinkerHand: identity, matrices of one sample, the older touch sensor, what is not for this hand."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import push
from tests.firmware.golden import frame_from

L6, O6 = "linker_hand_l6", "linker_hand_o6"


def ask(device: fp.Device, request: str) -> list[str]:
    return [str(answer) for answer in device.receive(frame_from(request), 0)]


@pytest.mark.parametrize(("name", "rows", "columns", "selector"), [(L6, 12, 6, "C6"), (O6, 10, 4, "A4")])
def test_each_finger_sends_its_own_matrix(name, rows, columns, selector):
    device = fp.create(name)
    device.sample(push(device, np.arange(len(device.layout)) / 1000), 0)
    for finger in range(5):
        answers = [bytes.fromhex(a.partition("#")[2]) for a in ask(device, f"028#B{finger + 1}{selector}")]
        assert [a[1] for a in answers] == [row << 4 for row in range(rows)]
        sent = np.array([list(a[2:]) for a in answers])
        assert np.array_equal(sent, device.counts.reshape(5, rows, columns)[finger])


def test_counts_saturate_and_never_pull():
    device = fp.create(L6)
    assert set(device.digitize(push(device, 100.0)).tolist()) == {255}
    assert set(device.digitize(push(device, -100.0)).tolist()) == {0}
    assert set(device.digitize(push(device, 0.2)).tolist()) == {100}


def test_sides_do_not_hear_each_other():
    left, right = fp.create(L6), fp.create(L6, side="right")
    assert ask(left, "027#C2") == [] and left.counters["ignored"] == 1
    assert ask(right, "027#C2") == ["027#C2010203"]


@pytest.mark.parametrize("request_", ["028#B1A4", "028#B6C6", "028#", "028#C1", "028#20", "028#B1C600", "028#FF"])
def test_what_is_no_request_gets_silence(request_):
    device = fp.create(L6)
    assert ask(device, request_) == []
    assert device.counters["unknown_command"] + device.counters["ignored"] == 1


def test_older_touch_sensor_answers_four_quantities():
    device = fp.create(L6, touch="quantities")
    force = np.zeros((360, 3))
    force[72:144] = (0.0, 0.002, -0.004)
    device.sample(fp.Reading(t_ns=0, values=force), 0)
    assert ask(device, "028#20") == ["028#200090000000"]  # 72 * 0.004 N * 500 counts/N = 144
    assert ask(device, "028#21") == ["028#210048000000"]
    assert ask(device, "028#22") == ["028#220040000000"]  # along y: a quarter turn
    assert ask(device, "028#B1") == [] == ask(device, "028#B1C6")


def test_joints_remember():
    device = fp.create(L6)
    assert ask(device, "028#01010203040506") == []
    assert ask(device, "028#01") == ["028#01010203040506"]
    device.power_on(0)
    assert ask(device, "028#01") == ["028#01808080808080"]


def test_bad_options_are_refused():
    with pytest.raises(ValueError, match="side"):
        fp.create(L6, side="up")
    with pytest.raises(ValueError, match="touch"):
        fp.create(L6, touch="capacitive")
