"""Unitree Dex3-1: states, cells, orders."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.devices.unitree_dex3 import COMMAND, STATE
from tests.firmware.feeding import sample, send


def order(*motors, kp=1.5):
    """Mode and angle of each motor."""
    data = np.zeros((), COMMAND)
    data["n_motor_cmd"] = 7
    for k, (mode, angle) in enumerate(motors):
        data["motor_cmd"][k]["mode"], data["motor_cmd"][k]["q"], data["motor_cmd"][k]["kp"] = mode, angle, kp
    return data.tobytes()


def state(device, pushes=0.0, t_ns=0):
    return np.frombuffer(sample(device, pushes, t_ns)[0], STATE)[0]


def test_sizes_are_those_of_the_page():
    assert STATE["motor_state"].itemsize == 7 * 56 and STATE["press_sensor_state"].itemsize == 9 * 104
    assert STATE.itemsize == 1424 and COMMAND.itemsize == 4 + 7 * 28 + 16


def test_thirty_three_cells_and_the_rest_is_empty():
    device = fp.create("unitree_dex3")
    assert len(device.layout) == 33
    pressure = state(device, 1.5)["press_sensor_state"]["pressure"]
    assert (pressure == 30_000).sum() == 108 - 33 and (pressure == 115_000).sum() == 33
    assert np.flatnonzero(pressure[1] == 115_000).tolist() == [3, 6, 8]
    assert state(device, 1e6)["press_sensor_state"]["pressure"].max() == 400_000


@pytest.mark.parametrize(("cells", "odd", "taxels"), [((0,), (), 6), ((11, 0, 12), (5,), 15)])
def test_other_cells(cells, odd, taxels):
    device = fp.create("unitree_dex3", cells=cells, odd_cells=odd)
    assert len(device.layout) == taxels
    assert (state(device)["press_sensor_state"]["pressure"] == 100_000).sum() == taxels


def test_motors_that_are_on_go_and_others_stay():
    device = fp.create("unitree_dex3")
    send(device, order((0x10, 0.5), (0x01, 0.5), (0x22, 0.5), (0x13, -9.0), (0x14, np.nan), (0x15, -np.inf)))
    angles = state(device, t_ns=3_000_000_000)["motor_state"]["q"]
    np.testing.assert_allclose(angles, [0.5, 0, 0, -1.57, 0, -1.57, 0], atol=1e-6)
    send(device, order((0x90, 0.0), kp=0.0), t_ns=3_000_000_000)
    assert state(device, t_ns=9_000_000_000)["motor_state"]["q"][0] == pytest.approx(0.5), "it has no stiffness"
    assert state(device)["motor_state"]["mode"].tolist() == [0x90, 0, 0, 0, 0, 0, 0]
    assert list(device.joints(0)) == [f"motor {k}" for k in range(7)]


@pytest.mark.parametrize(("side", "sign"), [("left", -1), ("right", 1)])
def test_stops_are_those_of_the_side(side, sign):
    device = fp.create("unitree_dex3", side=side)
    for least_or_most in (-9.0, 9.0):
        send(device, order(*((0x10 | k, least_or_most) for k in range(7))))
        angles = state(device, t_ns=3_000_000_000)["motor_state"]["q"]
        outwards = least_or_most * sign > 0
        np.testing.assert_allclose(angles[3:], sign * np.array([1.57, 1.75] * 2) if outwards else 0, atol=1e-6)
        assert abs(angles[0]) == pytest.approx(1.05)


def test_a_motor_that_watches_for_orders_stops_a_second_after_the_last():
    device = fp.create("unitree_dex3")
    device.motors.time_constant_s = 5.0
    send(device, order((0x90, 1.0), (0x11, 1.0)))
    assert device.wake_ns == 1_000_000_000
    device.wake_ns = None
    device.wake(1_000_000_000)
    before = state(device, t_ns=1_000_000_000)["motor_state"]["q"][:2].copy()
    after = state(device, t_ns=2_000_000_000)["motor_state"]["q"][:2]
    assert 0.1 < before[0] == pytest.approx(after[0]) and after[1] > before[1] + 0.1
    send(device, order((0x10, 1.0)), 2_000_000_000)
    assert device.wake_ns is None


@pytest.mark.parametrize("data", [b"", b"\7\0\0\0", order()[:-1], order() + b"\0", b"\6" + order()[1:]])
def test_what_is_no_order_is_counted(data):
    device = fp.create("unitree_dex3")
    assert send(device, data) == [] and device.counters == {"bad_request": 1}


def test_every_25th_state_goes_to_the_slower_topic_too():
    device = fp.create("unitree_dex3", side="right")
    assert [port.writes.name for port in device.ports] == ["rt/dex3/right/state", "rt/lf/dex3/right/state"]
    assert [len(sample(device)) for _ in range(50)] == [*[1] * 24, 2] * 2
