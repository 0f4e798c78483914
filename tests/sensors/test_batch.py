"""Many environments in one launch, and poses from wherever they are."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tactemu.sensors.probes.blocks import Blocks
from tests.sensors.rig import scene_with

GRID = np.stack([*np.meshgrid(np.linspace(-8e-3, 8e-3, 6), np.linspace(-8e-3, 8e-3, 5)), np.zeros((5, 6))], -1)
KINEMATIC = {"positions": GRID, "radius": 2e-3}


def random_poses(n, seed=0):
    rng = np.random.default_rng(seed)
    position = np.c_[rng.uniform(-5e-3, 5e-3, (n, 2)), rng.uniform(8e-3, 11e-3, n)]
    return {
        "position": position,
        "quaternion": rng.normal(size=(n, 4)),
        "linear_velocity": rng.normal(size=(n, 3)),
        "angular_velocity": rng.normal(size=(n, 3)),
    }


def kinematic(n_envs):
    return scene_with(tt.Box(size=(0.02, 0.015, 0.018)), tt.KinematicTaxel(**KINEMATIC), n_envs=n_envs)


def test_an_environment_reads_the_same_alone_and_among_many():
    sim, body, skin = kinematic(300)
    poses = random_poses(300)
    sim.set_pose(body, **poses)
    sim.step()
    among = skin.read()
    assert among.force.shape == (300, 5, 6, 3) and np.abs(among.force).max() > 0
    for env in (0, 7, 299):
        alone, one, single = kinematic(None)
        alone.set_pose(one, **{name: value[env] for name, value in poses.items()})
        alone.step()
        reading = single.read()
        assert reading.force.shape == (5, 6, 3)
        assert np.array_equal(reading.force, among.force[env]) and np.array_equal(reading.torque, among.torque[env])


@pytest.mark.parametrize("which", [0, 40, 69])
def test_a_body_is_felt_among_many_that_are_far(which):
    """More bodies than bits in which a skin notes who is near; each environment has its own nearest."""
    model, place = tt.KinematicTaxel(**KINEMATIC), np.array([[0, 0, 6e-3], [3e-3, 0, 5.5e-3], [0.4, 0, 0]])
    readings = []
    for count in (70, 1):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(name="pad")
        bodies = [scene.add_body(tt.Sphere(radius=5e-3), name=f"{k}", position=(1 + k, 0, 0)) for k in range(count)]
        skin = scene.add_sensor(model, link=pad)
        sim = scene.build(len(place))
        sim.step()
        assert not skin.read().force.any()
        sim.set_pose(bodies[which if count > 1 else 0], position=place)
        sim.step()
        readings.append(skin.read())
    assert np.array_equal(readings[0].force, readings[1].force) and np.array_equal(*(r.torque for r in readings))
    assert readings[0].force[:2].any((1, 2, 3)).all() and not readings[0].force[2].any()


@pytest.mark.parametrize("n_envs", [1, 3, 4096])
@pytest.mark.parametrize("n_probes", [0, 1, 31, 72, 256, 300, 5000])
def test_blocks_of_a_gpu_cover_all_probes(n_envs, n_probes):
    """As the kernel counts: each probe of each environment is some thread's, once."""
    blocks = Blocks(n_envs, n_probes)
    assert blocks.block_dim % 32 == 0 and 32 <= blocks.block_dim <= 256
    assert blocks.n_threads % blocks.block_dim == 0
    of_first = [b for b in range(blocks.n_threads // blocks.block_dim) if b >> blocks.shift == 0]
    step = blocks.block_dim << blocks.shift
    seen = [
        i for b in of_first for t in range(blocks.block_dim) for i in range(b * blocks.block_dim + t, n_probes, step)
    ]
    assert sorted(seen) == list(range(n_probes))
    assert (blocks.n_threads // blocks.block_dim - 1) >> blocks.shift == n_envs - 1


class FromElsewhere:
    """An array of some other library: all it has is ``__dlpack__``."""

    def __init__(self, array):
        self._array = array

    def __dlpack__(self, **options):
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self._array.__dlpack_device__()


@pytest.mark.parametrize(
    "wrap",
    [
        lambda a: a.tolist(),
        lambda a: wp.array(a.astype(np.float64), dtype=wp.float64, device="cpu"),
        lambda a: wp.array(np.asfortranarray(a), dtype=wp.float64, device="cpu"),
        lambda a: wp.array(a, dtype=wp.types.vector(a.shape[1], wp.float64), device="cpu"),
        FromElsewhere,
    ],
    ids=["lists", "warp", "strided", "warp vectors", "dlpack"],
)
def test_poses_come_from_any_array(wrap):
    poses = random_poses(4)
    readings = []
    for convert in (lambda a: a, wrap):
        sim, body, skin = kinematic(4)
        sim.set_pose(body, **{name: convert(value) for name, value in poses.items()})
        sim.step()
        readings.append(skin.read())
    assert np.array_equal(readings[0].force, readings[1].force)


def test_what_is_not_given_stays_and_only_the_environments_named_change():
    sim, body, skin = kinematic(3)
    sim.set_pose(body, **random_poses(3))
    sim.step()
    before = skin.read()
    sim.set_pose(body, position=(0, 0, 1.0), envs=[1])
    sim.step()
    after = skin.read()
    assert np.array_equal(before.force[[0, 2]], after.force[[0, 2]])
    assert not after.force[1].any()
    sim.set_pose(body, position=random_poses(3)["position"][[1]], envs=np.array([False, True, False]))
    sim.step()
    assert np.array_equal(before.force, skin.read().force)


@pytest.mark.parametrize("wrong", [{"position": (1, 2)}, {"position": np.zeros((2, 3))}, {"quaternion": (1, 0, 0)}])
def test_a_wrong_shape_is_named(wrong):
    sim, body, _skin = kinematic(3)
    with pytest.raises(SceneError, match=r"shape \([34],\) or \(3, [34]\)"):
        sim.set_pose(body, **wrong)


def test_unknown_environments_and_bodies_are_named():
    sim, body, _skin = kinematic(3)
    for envs in ([3], [-1], [0.5]):
        with pytest.raises(SceneError, match=r"indices in 0\.\.2"):
            sim.set_pose(body, position=(0, 0, 0), envs=envs)
    with pytest.raises(SceneError, match=r"no body 'ball' \(bodies: link, body\)"):
        sim.set_pose("ball", position=(0, 0, 0))
    late = tt.Scene().add_body(tt.Plane(), name="late")
    with pytest.raises(SceneError, match="'late' was added after the scene was built"):
        sim.set_pose(late, position=(0, 0, 0))
    with pytest.raises(SceneError, match="'link' is fixed"):
        sim.set_pose("link", position=(0, 0, 0))


def test_a_pose_that_is_not_finite_harms_no_other_environment():
    readings = []
    for bad in (None, np.nan, np.inf, -np.inf, 1e300):
        sim, body, skin = kinematic(4)
        poses = random_poses(4)
        sim.set_pose(body, **poses)
        sim.step()
        if bad is None:
            sim.step()
        else:
            poses["position"][2, 1] = bad
            sim.set_pose(body, **poses)
            with pytest.raises(PoseError, match="body 'body', environment 2, step 2"):
                sim.step()
            assert np.isnan(skin.read().force[2]).all()
        readings.append(skin.read().force[[0, 1, 3]])
        if bad is not None:
            sim.set_pose(body, **random_poses(4))
            sim.reset([2])
            sim.set_pose(body, **random_poses(4))
            sim.step()
            assert np.isfinite(skin.read().force).all()
    assert all(np.array_equal(readings[0], other) for other in readings[1:])


@pytest.mark.parametrize("bad", [(0, 0, 0, 0), (1e-9, 0, 0, 0), (np.nan, 0, 0, 1)])
def test_a_quaternion_of_no_direction_is_an_error(bad):
    sim, body, _skin = kinematic(2)
    sim.set_pose(body, quaternion=bad, envs=[1])
    with pytest.raises(PoseError, match="environment 1"):
        sim.step()


def test_reset_puts_bodies_back_and_readings_to_zero():
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.009))
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3), link=link)
    sim = scene.build(2)
    sim.step()
    start = skin.read()
    sim.set_pose(ball, position=(0, 0, 0.007))
    sim.step()
    sim.reset([1])
    deep = skin.read()[:, 0]
    assert deep == pytest.approx([4e-3, 0.0], abs=1e-8)
    sim.step()
    assert skin.read()[:, 0] == pytest.approx([4e-3, 2e-3], abs=1e-8)
    sim.reset()
    assert sim.time_ns == 0 and sim.step_count == 0 and not skin.read().any()
    sim.step()
    assert np.array_equal(skin.read(), start)


def test_time_is_counted_in_whole_nanoseconds():
    sim, _body, _skin = kinematic(None)
    for _ in range(1000):
        sim.step()
    assert sim.time_ns == 1_000_000_000 and sim.step_count == 1000
    sim.step(dt=0.0)
    assert sim.time_ns == 1_000_000_000 and sim.step_count == 1001
    for wrong in (-1e-3, np.nan, np.inf):
        with pytest.raises(ValueError, match="dt"):
            sim.step(dt=wrong)
    assert int(sim.context.step.numpy()[0]) == 1001 and int(sim.context.time_ns.numpy()[0]) == sim.time_ns


def test_motions_move_bodies_from_where_they_were_put():
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(fixed=True)
    scene.add_body(
        tt.Sphere(radius=0.01), position=(0, 0, 0.012), motion=tt.FromFunction(function=lambda t: (0, 0, -2.0 * t))
    )
    model = tt.KinematicTaxel(positions=[[0, 0, 0]], radius=1e-3, normal_stiffness=0.0, normal_damping=1.0)
    skin = scene.add_sensor(model, link=link)
    sim = scene.build()
    for _ in range(3):
        sim.step()
    depth, speed = 1e-3 + 4e-3, 2.0
    assert skin.read().force[0, 2] == pytest.approx(-depth * speed, rel=1e-5)
