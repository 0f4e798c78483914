"""Motions: closed-form places, and velocities judged by finite differences of the poses."""

import math

import numpy as np
import pytest

from tactemu.base.errors import SceneError
from tactemu.geometry import rotation
from tactemu.geometry.motion import (
    FromFunction,
    Hold,
    InTurn,
    Keyframes,
    Pose,
    Press,
    Roll,
    Slide,
    Spin,
    Together,
)
from tactemu.scene.scene import Scene

HALF_TURN_Z = (0.0, 0.0, 0.0, 1.0)
MOTIONS = {
    "press": Press(depth=1e-3, approach=2e-3, speed=0.01, dwell=0.2, pause=0.1, repeat=3, delay=0.05),
    "press slanted": Press(depth=1e-3, speed=0.03, release_speed=0.1, direction=(1, 2, -3), repeat=None),
    "slide": Slide(distance=0.02, speed=0.05, direction=(1, 1, 0), repeat=2),
    "roll": Roll(distance=0.02, radius=0.004, speed=0.05, direction=(0, 1, 0)),
    "spin": Spin(rate=-7.0, axis=(1, 0, 1), angle=9.0),
    "keyframes": Keyframes(
        times=(0, 0.2, 0.5, 1.0),
        positions=((0, 0, 0), (0.01, 0, 0), (0.01, 0.02, 0), (0, 0, 0)),
        quaternions=((1, 0, 0, 0), (1, 1, 0, 0), HALF_TURN_Z, (1, 0, 0, 0)),
        repeat=True,
    ),
    "function": FromFunction(
        function=lambda t: ((0.01 * math.sin(t), 0, t * t), rotation.from_rotation_vector((0, 0.3 * t, 0.1)))
    ),
    "sequence": InTurn(
        (
            Press(depth=1e-3, speed=0.01, dwell=0.1, release=False),
            Roll(distance=0.01, radius=0.005, speed=0.05),
            Hold(seconds=0.1),
            Together((Slide(distance=0.01, direction=(0, 1, 0)), Spin(rate=2.0))),
        )
    ),
    "together": Together((Spin(rate=3.0, axis=(1, 0, 0)), Spin(rate=2.0), Slide(distance=0.1, speed=0.1))),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_velocities_are_the_derivatives_of_the_pose(name):
    motion = MOTIONS[name]
    step = 1e-6
    checked = 0
    for t in np.random.default_rng(1).uniform(0, 1.5, 200):
        before, here, after = (motion.pose(float(t + k * step)) for k in (-1, 0, 1))
        if not (
            np.allclose(before.linear_velocity, after.linear_velocity, atol=1e-3)
            and np.allclose(before.angular_velocity, after.angular_velocity, atol=1e-3)
        ):
            continue  # a kink lies between
        linear = (after.position - before.position) / (2 * step)
        turn = rotation.multiply(after.quaternion, rotation.conjugate(before.quaternion))
        angular = rotation.to_rotation_vector(turn) / (2 * step)
        np.testing.assert_allclose(here.linear_velocity, linear, atol=2e-8)
        np.testing.assert_allclose(here.angular_velocity, angular, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(here.quaternion), 1.0, atol=1e-12)
        checked += 1
    assert checked > 190


def test_press_goes_where_it_says():
    press = Press(approach=2e-3, depth=1e-3, speed=0.01, dwell=0.2, pause=0.1, repeat=2, delay=0.05)

    def height(t):
        return press.pose(t).position[2]

    assert height(0.0) == height(0.05) == 0.0
    assert height(0.05 + 0.2) == pytest.approx(-2e-3, abs=1e-15), "touches after the approach"
    assert height(0.05 + 0.3 + 0.1) == pytest.approx(-3e-3, abs=1e-15), "dwells at depth"
    assert height(0.05 + 0.8 + 0.05) == pytest.approx(0.0, abs=1e-15), "waits at the start"
    assert press.duration == pytest.approx(0.05 + 2 * 0.9)
    for after, rest in zip(press.pose(99.0), Pose(), strict=True):
        np.testing.assert_array_equal(after, rest)


def test_a_rolling_body_rests_where_it_touches():
    radius = 0.004
    pose = Roll(distance=0.05, radius=radius, speed=0.1, direction=(1, 2, 0)).pose(0.1)
    touching = pose.linear_velocity + np.cross(pose.angular_velocity, (0, 0, -radius))
    np.testing.assert_allclose(touching, 0.0, atol=1e-15)


def test_spin_stops_at_its_angle():
    pose = Spin(rate=2.0, angle=math.pi / 2).pose(50.0)
    np.testing.assert_allclose(rotation.rotate(pose.quaternion, (1, 0, 0)), (0, 1, 0), atol=1e-12)
    assert not pose.angular_velocity.any()


def test_slerp_halfway_is_half_the_turn():
    pose = Keyframes(times=(0, 2), quaternions=((1, 0, 0, 0), HALF_TURN_Z)).pose(1.0)
    np.testing.assert_allclose(rotation.rotate(pose.quaternion, (1, 0, 0)), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(pose.angular_velocity, (0, 0, math.pi / 2), atol=1e-12)


def test_a_sequence_is_continuous():
    motion = MOTIONS["sequence"]
    times = np.linspace(0, 1.2, 5000)
    places = np.array([motion.pose(float(t)).position for t in times])
    assert np.abs(np.diff(places, axis=0)).max() < 0.06 * (times[1] - times[0]) * 1.01, "never faster than its parts"


def test_a_motion_displaces_its_body_along_the_world_whatever_the_pose():
    press = Press(depth=1e-3, speed=0.01)
    pose = Scene().add_body(position=(1, 2, 3), quaternion=(0, 1, 0, 0), motion=press).pose(0.1)
    np.testing.assert_allclose(pose.position, (1, 2, 3 - 1e-3), atol=1e-15)
    np.testing.assert_allclose(pose.quaternion, (0, 1, 0, 0))
    np.testing.assert_allclose(pose.linear_velocity, 0.0)


def test_long_spins_lose_no_accuracy():
    spin = Spin(rate=2 * math.pi)
    np.testing.assert_allclose(np.abs(spin.pose(1e6).quaternion[0]), 1.0, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Press(depth=math.nan), "press: depth must be >= -10 and <= 0.5 m"),
        (lambda: Press(depth=1e-3, speed=0), "press: speed must be >= 1e-09"),
        (lambda: Press(depth=1e-3, direction=(0, 0, 0)), "press.direction"),
        (lambda: Slide(distance=-1), "slide: distance must be >= 0 and <= 10 m"),
        (lambda: Keyframes(times=(0, 0)), "keyframes: times must be"),
        (lambda: Keyframes(times=(0, 1), quaternions=((0, 0, 0, 0), (1, 0, 0, 0))), "keyframes.quaternions"),
        (lambda: InTurn((Spin(rate=1), Hold())), "only the last motion may be endless; 'spin' never ends"),
        (lambda: InTurn((Hold(),), repeat=True), "it must last a finite time > 0 s, got inf s"),
        (lambda: InTurn((Hold(seconds=0.0),), repeat=True), "it must last a finite time > 0 s, got 0.0 s"),
        (lambda: InTurn(()), "sequence: expected one or more motions"),
        (lambda: Together((None,)), "together: expected one or more motions"),
        (lambda: Press(depth=1), r"press: depth must be .* <= 0.5 m \(6 mm is 0.006\), got 1"),
        (lambda: Press(depth=1e-3, dwell=1e300), "press: dwell must be >= 0 and <= 1e\\+06 s"),
        (lambda: Press(depth=1e-3, repeat=10**400), "press: repeat must be a whole number"),
        (lambda: FromFunction(function=lambda t: None).pose(0.0), "a function: at 0 s expected a position"),
        (lambda: FromFunction(function=lambda t: (1, 2)).pose(0.0), "a function: at 0 s expected a position"),
    ],
)
def test_bad_motions_are_refused(make, says):
    with pytest.raises(SceneError, match=says):
        make()
