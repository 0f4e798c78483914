import copy

import numpy as np
import pytest

from firmware_protocols import Motors
from tests.kit.saving import restored, saved

S = 1_000_000_000


def fingers(**options):
    return Motors([0.0, 0.0, 50.0], low=0.0, high=100.0, **options)


def integrate(position, goal, tau, limit, seconds, steps=20_000):
    """The rule of the module, step by step."""
    dt = seconds / steps
    for _ in range(steps):
        away = goal - position
        position += np.sign(away) * min(abs(away) / tau, limit) * dt
    return position


@pytest.mark.parametrize("limit", [np.inf, 300.0, 20.0])
@pytest.mark.parametrize("seconds", [0.01, 0.3, 2.0, 9.0])
def test_the_closed_form_is_the_rule_integrated(limit, seconds):
    motors = fingers(time_constant_s=0.1, speed_limit=limit)
    motors.go([80.0, 10.0, 20.0], 0)
    expected = [integrate(start, goal, 0.1, limit, seconds) for start, goal in ((0, 80.0), (0, 10.0), (50, 20.0))]
    assert motors.positions(int(seconds * S)) == pytest.approx(expected, abs=0.02)


def test_velocities_are_the_slope_of_the_positions():
    motors = fingers(speed_limit=200.0)
    motors.go([80.0, 10.0, 20.0], 0)
    for t in range(0, S, S // 20):
        slope = (motors.positions(t + 1000) - motors.positions(t)) / 1e-6
        assert motors.velocities(t) == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_without_a_time_constant_they_move_at_constant_speed_and_stop():
    motors = fingers(time_constant_s=0.0, speed_limit=[125.0, 50.0, 0.0])
    motors.go(100.0, 0)
    assert motors.positions(S // 2).tolist() == [62.5, 25.0, 50.0]
    assert motors.velocities(S // 2).tolist() == [125.0, 50.0, 0.0]
    assert motors.positions(3 * S).tolist() == [100.0, 100.0, 50.0]
    assert motors.velocities(3 * S).tolist() == [0.0, 0.0, 0.0]


def test_how_often_somebody_asks_does_not_matter():
    asked, left_alone = fingers(speed_limit=100.0), fingers(speed_limit=100.0)
    for motors in (asked, left_alone):
        motors.go([80.0, 10.0, 20.0], 0)
    for t in range(0, S, S // 100):
        asked.positions(t)
    assert asked.positions(S).tolist() == left_alone.positions(S).tolist()


def test_goals_end_at_the_stops_and_nan_leaves_a_joint_alone():
    motors = fingers()
    motors.go([500.0, np.nan, -500.0], 0)
    assert motors.goals.tolist() == [100.0, 0.0, 0.0]
    assert motors.positions(10 * S) == pytest.approx([100.0, 0.0, 0.0])
    assert not motors.moving(10 * S).any()
    assert motors.moving(S // 100).tolist() == [True, False, True]


def test_driven_joints_take_on_their_speed_and_stop_at_the_stops():
    motors = fingers(time_constant_s=0.1)
    motors.drive([20.0, np.nan, -400.0], 0)
    assert motors.velocities(S).tolist() == pytest.approx([20.0, 0.0, 0.0], abs=1e-2)
    assert motors.positions(S) == pytest.approx([20 * (1 - 0.1), 0.0, 0.0], abs=1e-2)
    assert motors.positions(100 * S)[0] == 100.0
    assert motors.velocities(100 * S)[0] == 0.0


def test_a_new_order_begins_where_the_joint_is():
    motors = fingers(time_constant_s=0.1)
    motors.drive([20.0, 20.0, 20.0], 0)
    before = motors.positions(S)
    motors.hold(S)
    assert motors.positions(S).tolist() == before.tolist()
    assert motors.positions(2 * S) == pytest.approx(before)
    motors.limit_speed(1.0, 2 * S)
    motors.go(0.0, 2 * S)
    assert motors.positions(3 * S) == pytest.approx(before - 1.0)


def test_a_load_that_is_too_strong_stalls_the_joint_that_pushes_against_it():
    motors = fingers(time_constant_s=0.0, speed_limit=10.0)
    motors.go([100.0, 100.0, 0.0], 0)
    motors.apply_loads([-5.0, 5.0, -5.0], 3.0, S)
    assert motors.stalled.tolist() == [True, False, False]
    assert motors.positions(2 * S).tolist() == [10.0, 20.0, 30.0]
    assert motors.moving(2 * S).tolist() == [False, True, True]
    motors.apply_loads([-2.0, 0.0, 0.0], 3.0, 2 * S)
    assert motors.positions(3 * S).tolist() == [20.0, 30.0, 20.0]


def test_a_stalled_joint_that_is_sent_back_goes():
    motors = fingers(time_constant_s=0.0, speed_limit=10.0)
    motors.go(100.0, 0)
    motors.apply_loads(-5.0, 3.0, S)
    assert motors.stalled.all()
    motors.go([0.0, np.nan, 40.0], 2 * S)
    assert motors.positions(3 * S).tolist() == [0.0, 10.0, 50.0]


def test_a_copy_and_a_file_go_on_where_the_motors_were():
    motors = fingers(speed_limit=100.0)
    motors.go([80.0, 10.0, 20.0], 0)
    motors.drive([np.nan, 5.0, np.nan], S // 4)
    for other in (copy.deepcopy(motors), restored(saved(motors))):
        assert other.positions(S).tolist() == motors.positions(S).tolist()
        other.hold(S)
    assert motors.moving(S)[1]


def gripper(**options):
    """Two joints in counts, 0 open and 100 closed after 1 rad, the second turned the other way."""
    return Motors(
        [0.0, 0.0], low=0.0, high=100.0, time_constant_s=0.0, speed_limit=100.0, names=("a", "b"),
        unit=[0.01, -0.01], strength=2.0, deflection=0.1, **options,
    )  # fmt: skip


def test_in_an_engine_they_are_where_it_has_them_and_want_what_they_would_do():
    motors = gripper()
    motors.follow_engine([0.2, -0.3], [0.0, 0.0], [0.0, 0.0], 0)
    assert motors.positions(0) == pytest.approx([20, 30])
    assert motors.joints(0) == pytest.approx({"a": 0.2, "b": -0.3})
    assert motors.setpoints(S).positions == pytest.approx([0.2, -0.3]), "it holds still where it begins"
    motors.go(100.0, S)
    setpoints = motors.setpoints(S + S // 2)
    assert setpoints.positions == pytest.approx([0.7, -0.8]) and setpoints.speeds == pytest.approx([1.0, -1.0])
    assert setpoints.stiffness == pytest.approx([20.0, 20.0]) and setpoints.max_forces == pytest.approx([2.0, 2.0])
    assert motors.positions(S + S // 2) == pytest.approx([20, 30]), "until the engine has moved them"
    motors.leave_engine()
    assert motors.positions(S + S // 2) == pytest.approx([70, 80])


def test_a_joint_that_is_held_stalls_and_a_new_order_is_not_wound_up():
    motors = gripper()
    motors.follow_engine([0.2, -0.2], [0.0, 0.0], [0.0, 0.0], 0)
    motors.limit_force([0.5, 1.0])
    motors.go([100.0, np.nan], 0)
    for t in range(0, 2 * S, S // 50):
        motors.follow_engine([0.25, -0.2], [0.0, 0.0], [1.0, 0.0], t)
    assert motors.stalled.tolist() == [True, False]
    assert motors.loads().tolist() == [-1.0, 0.0]
    motors.go([0.0, np.nan], 2 * S)
    assert motors.setpoints(2 * S).positions[0] == pytest.approx(0.25 + 1.0 / 20), (
        "as far ahead as half its force takes"
    )
    motors.follow_engine([0.2, -0.2], [-1.0, 0.0], [-1.0, 0.0], 2 * S + 1)
    assert not motors.stalled.any(), "it moves"


def test_force_drives_a_joint_until_it_gets_a_place_and_outside_an_engine_loads_hold_it():
    motors = gripper()
    motors.apply_loads([5.0, 0.0], [1.0, 1.0], 0)
    motors.follow_engine([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 0)
    motors.drive_by_force([1.5, np.nan], 0)
    assert motors.setpoints(S).forces == pytest.approx([1.5, np.nan], nan_ok=True)
    motors.apply_loads([-5.0, 0.0], [1.0, 1.0], S)
    assert not motors.stalled.any(), "the engine has the loads"
    motors.go(10.0, S)
    assert np.isnan(motors.setpoints(S).forces).all()


def test_in_an_engine_the_state_can_be_saved():
    motors = gripper()
    motors.follow_engine([0.2, -0.2], [0.1, 0.0], [1.0, 0.0], S)
    motors.drive_by_force([1.0, np.nan], S)
    again = restored(saved(motors))
    assert again.is_in_engine and again.positions(S).tolist() == motors.positions(S).tolist()
    assert again.setpoints(2 * S).forces.tolist()[0] == 1.0
