"""Episodes: motions on each environment's own clock, resets that begin them anew, bodies taken from their motions."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.geometry import rotation
from tactemu.geometry.motion import Motion, PlainMotion, Pose

GRID = [(x * 2e-3, y * 2e-3, 0.0) for x in (-1, 0, 1) for y in (-1, 0, 1)]
PRESS = tt.Press(approach=1e-3, depth=1e-3, speed=0.05, dwell=0.02, repeat=None)
SEQUENCE = tt.InTurn(
    (
        tt.Press(depth=1e-3, speed=0.05, dwell=0.01, release=False),
        tt.Together((tt.Roll(distance=5e-3, radius=0.01, speed=0.1), tt.Spin(rate=3.0, axis=(1, 2, 3)))),
    )
)


def built(n_envs=None, motion: Any = PRESS, **options):
    """``(sim, ball, skin)``: a ball over a pad of nine taxels; it touches where it has come 1 mm down."""
    scene, ball, skin = pad_and_ball(motion)
    return scene.build(n_envs, **options), ball, skin


def pad_and_ball(motion):
    """The same before it is built."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.004)), position=(0, 0, -0.002), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.011), motion=motion, name="ball")
    return scene, ball, scene.add_sensor(tt.ContactDepthProbe(positions=GRID), link=pad, name="skin")


def recorded(sim, skin, steps):
    """The readings and the ball's poses of some steps, of all environments."""
    found = []
    for _ in range(steps):
        sim.step()
        found.append(np.concatenate([skin.read().reshape(sim.n_envs, -1), sim.pose_array.numpy()[:, 1]], axis=1))
    return np.array(found)


@pytest.mark.parametrize("motion", [PRESS, SEQUENCE], ids=["press", "sequence"])
def test_a_reset_begins_the_motion_of_that_environment_anew(motion):
    sim, _ball, skin = built(3, motion)
    first = recorded(sim, skin, 70)
    assert first[:, 0, :9].max() > 5e-4
    sim.reset([1])
    again = recorded(sim, skin, 50)
    assert np.array_equal(again[:, 1], first[:50, 0]), "as from the start"
    assert not np.array_equal(again[:, 1], again[:, 0])
    whole, _ball, skin = built(1, motion)
    assert np.array_equal(recorded(whole, skin, 120)[:, 0], np.concatenate([first, again])[:, 2]), "the others go on"


def test_a_mask_resets_as_indices_do():
    (by_mask, _, skin), (by_index, _, other) = built(4), built(4)
    for sim in (by_mask, by_index):
        sim.step(30)
    by_mask.reset(wp.array([False, True, False, True], dtype=wp.bool, device="cpu"))
    by_index.reset([1, 3])
    assert np.array_equal(recorded(by_mask, skin, 30), recorded(by_index, other, 30))


def test_a_reset_shows_the_start_of_the_motion():
    path = tt.Keyframes(times=(0, 1), positions=((0, 0, 1e-3), (0, 0, 5e-3)))
    sim, ball, _ = built(2, path)
    start = sim.pose(ball)
    assert start.position == pytest.approx((0, 0, 0.012)) and start.linear_velocity == pytest.approx((0, 0, 4e-3))
    sim.step(10)
    sim.reset([1])
    here, other = sim.pose("ball", 1), sim.pose(ball)
    assert all(map(np.array_equal, here, start)) and other.position[2] > 0.012
    sim.reset()
    assert all(map(np.array_equal, sim.pose(ball), start)), "and all of them"


def test_a_posed_body_is_taken_from_its_motion_until_it_is_released_or_reset():
    sim, ball, skin = built()
    still, _ball, reading = built(motion=None)
    for one in (sim, still):
        one.set_pose("ball", position=(0, 0, 0.0095))
        one.step(40)
    assert skin.read().max() > 0 and np.array_equal(skin.read(), reading.read())
    assert not sim.pose(ball).linear_velocity.any()
    sim.release(ball)
    sim.step()
    assert all(map(np.array_equal, sim.pose(ball), ball.pose(0.041))), "where it would be without"
    sim.set_pose(ball, position=(0, 0, 0.5))
    sim.reset()
    sim.step(5)
    assert all(map(np.array_equal, sim.pose(ball), ball.pose(0.005)))


@pytest.mark.parametrize(
    "motion", [PRESS, tt.FromFunction(function=lambda t: (0, 0, -0.1 * t))], ids=["plain", "python"]
)
def test_it_is_taken_in_the_environments_in_which_it_is_posed(motion):
    sim, ball, _ = built(3, motion)
    sim.step(10)
    sim.set_pose(ball, position=(1, 2, 3), envs=[1])
    sim.step(5)
    positions = sim.pose_array.numpy()[:, 1, :3]
    assert np.array_equal(positions[1], (1, 2, 3)) and positions[[0, 2]] == pytest.approx(
        np.tile(ball.pose(0.015).position, (2, 1)), abs=1e-12
    )
    sim.reset([1, 2])
    sim.set_pose(ball, position=(3, 2, 1), envs=[0, 2])
    sim.release(ball, envs=[2])
    sim.step(3)
    positions = sim.pose_array.numpy()[:, 1, :3]
    assert np.array_equal(positions[0], (3, 2, 1))
    assert positions[1:] == pytest.approx(np.tile(ball.pose(0.003).position, (2, 1)), abs=1e-12)


def test_bound_poses_take_a_body_from_its_motion_until_it_is_released():
    sim, ball, _ = built(2)
    places = np.array([[[0, 0, 0.02]], [[0, 0, 0.03]]])
    sim.bind_poses(position=places, index={"ball": 0})
    for action in (sim.step, sim.reset, lambda: sim.reset([1])):
        action()
        sim.step()
        assert np.array_equal(sim.pose_array.numpy()[:, 1, 2], (0.02, 0.03))
        assert not sim.pose(ball).linear_velocity.any()
    with pytest.raises(tt.SceneError, match="leave envs out"):
        sim.release(ball, envs=[1])
    sim.release(ball)
    sim.reset()
    sim.step(4)
    assert all(map(np.array_equal, sim.pose(ball), ball.pose(0.004)))


class Falling:
    """A motion of the user's own: world poses."""

    def pose(self, t_s):
        """Return the pose at times ``(n_envs,)``, or at a time."""
        z = np.asarray(0.02 - 0.1 * t_s)
        return Pose(np.stack([0 * z, 0 * z, z], axis=-1))


class Swinging(Motion):
    """A motion of the user's own: displacements, with a row for each environment."""

    def pose(self, t_s):
        """Return the pose at times ``(n_envs,)``, or at a time."""
        z = np.asarray(5e-3 * np.sin(9.0 * t_s))
        turn = np.stack([np.cos(z), np.sin(z), 0 * z, 0 * z], axis=-1)
        return Pose(np.stack([0 * z, 0 * z, z], axis=-1), turn)


@pytest.mark.parametrize(
    "motion",
    [
        Falling(),
        Swinging(),
        tt.FromFunction(function=lambda t: (0, 0, -0.1 * t)),
        tt.FromFunction(function=lambda t: (np.zeros(3), (np.cos(t), np.sin(t), 0, 0))),
        tt.Together((PRESS, Swinging())),
        tt.InTurn((tt.Slide(distance=1e-3, speed=0.1), Swinging())),
    ],
    ids=["world", "own", "function", "turning function", "together", "sequence"],
)
def test_motions_in_python_get_the_times_of_all_environments(motion):
    sim, ball, _ = built(3, motion)
    sim.step(20)
    sim.reset([2])
    sim.step(7)
    assert np.allclose(sim.env_time, [0.027, 0.027, 0.007])
    for env, t_s in enumerate(sim.env_time.tolist()):
        for got, expected in zip(sim.pose(ball, env), ball.pose(t_s)):
            np.testing.assert_allclose(got, expected, atol=1e-7)


def test_what_python_gets_and_what_it_returns_is_checked_in_words():
    sim, _, _ = built(2, tt.FromFunction(function=lambda t: (0, 0, 0)))
    sim.step()
    with pytest.raises(tt.SceneError, match=r"in a batch it gets the times of all environments, an array \(2,\)"):
        built(2, tt.FromFunction(function=lambda t: (0, 0, math.sin(t))))
    with pytest.raises(tt.SceneError, match="or with a row for each expected a position"):
        built(2, tt.FromFunction(function=lambda t: np.zeros((5, 3))))

    class Wrong(Falling):
        def pose(self, t_s):
            return Pose(np.zeros((7, 3)))

    with pytest.raises(tt.SceneError, match=r"or with 2 rows, got \(7, 3\)"):
        built(2, Wrong())


def test_functions_that_pose_bodies_get_the_times_of_all_environments():
    for n_envs in (None, 2):
        seen = []
        scene, _, _ = pad_and_ball(None)
        scene.posers.append(lambda _sim, times, seen=seen: seen.append(np.array(times)))
        sim = scene.build(n_envs)
        sim.step(3)
        sim.reset([0])
        sim.step()
        assert np.allclose(seen[-1], [1e-3, 4e-3] if n_envs else 1e-3)
        assert seen[-1].shape == ((2,) if n_envs else ())


def test_threads_devices_and_clones_move_bodies_alike():
    found = []
    for options in ({"threads": 1}, {"threads": 2}):
        sim, ball, skin = built(64, SEQUENCE, **options)
        sim.step(20)
        sim.reset([5, 40])
        sim.set_pose(ball, position=(0, 0, 0.0095), envs=[7])
        found.append(recorded(sim, skin, 10))
        sim.close()
    assert np.array_equal(*found)
    scene, ball, skin = pad_and_ball(SEQUENCE)
    with scene.build_split(64, ["cpu"] * 3) as sims:
        sims.step(20)
        sims.reset([5, 40])
        sims.set_pose(ball, position=(0, 0, 0.0095), envs=[7])
        sims.step(10)
        assert np.array_equal(sims.read(skin).reshape(64, -1), found[0][-1, :, :9])
        sims.release(ball, envs=[7])
        sims.step()
        assert np.array_equal(sims.pose(ball, 7).position, sims.pose(ball, 63).position)
    clone = sim.clone()
    clone.step(10)
    assert np.array_equal(clone.pose_array.numpy()[:, 1, :3], np.tile(ball.pose(0.01).position, (64, 1)))


def test_a_state_holds_the_starts_and_what_was_taken():
    sim, ball, skin = built(4)
    sim.step(20)
    sim.reset([1])
    sim.set_pose(ball, position=(0, 0, 0.0095), envs=[3])
    sim.step(3)
    state = sim.state()
    expected = recorded(sim, skin, 30)
    other, _, its = built(4)
    other.prepare_restore(state)()
    assert np.array_equal(recorded(other, its, 30), expected)
    sim.reset()
    sim.prepare_restore(state)()
    assert np.array_equal(recorded(sim, skin, 30), expected)


def test_a_pose_that_was_set_is_the_one_that_is_read():
    sim, ball, _ = built(2, None)
    sim.set_pose("ball", position=(1, 2, 3), quaternion=(0, 0, 0.6, 0.8), order="xyzw", angular_velocity=(0, 1, 0))
    for which in ("ball", ball, 1):
        assert np.array_equal(sim.pose(which, 1).position, (1, 2, 3))
        assert sim.pose(which).quaternion == pytest.approx((0.8, 0, 0, 0.6))
    on_device = wp.array([[0, 0, 0.6, 0.8], [1, 0, 0, 0]], dtype=wp.float64, device="cpu")
    sim.set_pose(ball, quaternion=on_device, order="xyzw")
    assert sim.pose(ball, 0).quaternion == pytest.approx((0.8, 0, 0, 0.6))
    assert sim.pose(ball, 1).quaternion == pytest.approx((0, 1, 0, 0))
    turned = tt.Scene().add_body(quaternion=(0, 0, 0, 2), order="xyzw")
    assert turned.quaternion == (1, 0, 0, 0)
    wrong: Any
    for wrong in ("zyxw", "xyz", None):
        with pytest.raises(tt.SceneError, match="order must be one of wxyz, xyzw"):
            sim.set_pose(ball, quaternion=(1, 0, 0, 0), order=wrong)
    with pytest.raises(tt.SceneError, match=r"did you mean 'ball'\? \(bodies: pad, ball\)"):
        sim.pose("bal")
    with pytest.raises(tt.SceneError, match=r"indices in 0\.\.1"):
        sim.pose(ball, 2)


def random_motion(random, depth):
    """A plain motion of any kind; at depth 0 one that combines no others."""
    vectors = [(0.0, 0.0, -1.0), tuple(random.uniform(-1, 1, 3))]
    axis = vectors[random.integers(2)]
    delay, repeat = float(random.choice([0, 0.07])), random.choice([1, 2, 0])
    leaves = [
        tt.Press(
            depth=2e-3, approach=1e-3, speed=0.05, dwell=0.03, pause=0.01, delay=delay, repeat=repeat, direction=axis
        ),
        tt.Press(depth=2e-3, speed=0.03, release=False, direction=axis),
        tt.Slide(distance=0.01, speed=0.07, repeat=repeat, delay=delay, direction=axis),
        tt.Roll(distance=0.01, radius=4e-3, speed=0.1, repeat=repeat, delay=delay),
        tt.Spin(rate=-7.0, axis=axis, delay=delay, angle=2.0),
        tt.Spin(rate=40.0, axis=axis),
        tt.Hold(seconds=0.05),
        tt.Keyframes(
            times=(-0.1, 0.1, 0.25), positions=tuple(map(tuple, random.uniform(-1, 1, (3, 3)))),
            quaternions=tuple(map(tuple, random.normal(size=(3, 4)))), repeat=bool(repeat),
        ),
    ]  # fmt: skip
    if not depth:
        return leaves[random.integers(len(leaves))]
    parts = [random_motion(random, depth - 1) for _ in range(random.integers(1, 4))]
    if random.random() < 0.4:
        return tt.Together(tuple(parts))
    parts = [part for part in parts[:-1] if math.isfinite(part.duration)] + parts[-1:]
    once = tt.InTurn(tuple(parts))
    return tt.InTurn(tuple(parts), repeat=True) if 0 < once.duration_once < math.inf else once


@pytest.mark.parametrize("depth", [0, 1, 3])
def test_the_kernel_moves_bodies_as_their_motions_say(depth):
    """To the bit for a motion alone; combined ones are added up in another order."""
    random, scene = np.random.default_rng(depth), tt.Scene(dt=1e-3)
    for _ in range(40):
        turn = rotation.normalised(random.normal(size=4)).tolist()
        scene.add_body(
            tt.Sphere(radius=1e-3),
            position=random.uniform(-1, 1, 3).tolist(),
            quaternion=turn,
            motion=random_motion(random, depth),
        )
    assert all(isinstance(body.motion, PlainMotion) for body in scene.bodies) == (depth == 0)
    sim = scene.build(3)
    for dt in random.uniform(0, 0.03, 60):
        sim.step(dt=float(dt))
        sim.reset([int(random.integers(3))])
        sim.step(dt=2e-3)
        got = sim.pose_array.numpy()
        for e, t_s in enumerate(sim.env_time.tolist()):
            expected = np.array([np.concatenate(body.pose(t_s)) for body in scene.bodies])
            np.testing.assert_allclose(got[e], expected, rtol=0, atol=1e-11 if depth else 0)
