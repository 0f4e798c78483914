"""Poses from arrays that stay where they are: conventions declared, judged by finite differences."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tests.sensors.test_batch import FromElsewhere

N_ENVS = 5
GRID = np.stack([*np.meshgrid(np.linspace(-8e-3, 8e-3, 7), np.linspace(-6e-3, 6e-3, 5)), np.full((5, 7), 0.01)], -1)
COM = np.array([2e-3, -1e-3, 3e-3])
"""Of the tool, in its frame."""
PIVOT = np.array([0.3, -0.2, 0.5])
"""A point in the world that velocities may be taken at."""


def scene(**options):
    """``(sim, names of the bodies, skin)``: a hand with a skin and a tool, both free."""
    built = tt.Scene(dt=1e-3)
    hand = built.add_body(tt.Box(size=(0.03, 0.02, 0.02)), name="hand")
    built.add_body(tt.Plane(), name="floor", fixed=True, position=(0, 0, -1.0))
    built.add_body(tt.Sphere(radius=0.01), name="tool", position=(0, 0, 0.018))
    skin = built.add_sensor(tt.KinematicTaxel(positions=GRID, radius=2e-3), link=hand, name="skin")
    return built.build(N_ENVS, **options), skin


def turned(quaternion: np.ndarray, v: np.ndarray) -> np.ndarray:
    """``v`` turned by (w, x, y, z)."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    return v + 2 * np.cross(u, np.cross(u, v) + w * v)


def course(t: float) -> dict[str, np.ndarray]:
    """Position and quaternion of hand and tool at a time, ``(n_envs, 2, ...)``: both turn and go."""
    rng = np.random.default_rng(3)
    axis = rng.normal(size=(N_ENVS, 2, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    rate, speed = rng.uniform(1, 4, (N_ENVS, 2, 1)), rng.normal(size=(N_ENVS, 2, 3)) * 0.05
    half = 0.5 * rate * t
    quaternion = np.concatenate([np.cos(half), np.sin(half) * axis], -1)
    start = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.318]])
    return {"position": start + speed * t, "quaternion": quaternion, "spin": rate * axis}


def velocity_of(point, t: float, h: float = 1e-5) -> np.ndarray:
    """Of a point fixed to the bodies, by finite differences; ``point`` in their frames ``(n_envs, 2, 3)``."""
    ends = []
    for at in (t - h, t + h):
        pose = course(at)
        ends.append(pose["position"] + turned(pose["quaternion"], point))
    return (ends[1] - ends[0]) / (2 * h)


def truth(t: float) -> np.ndarray:
    """What the skin reads when the host sets the poses, velocities of the origins by finite differences."""
    sim, skin = scene()
    pose = course(t)
    velocity = velocity_of(np.zeros((N_ENVS, 2, 3)), t)
    for k, body in enumerate(("hand", "tool")):
        sim.set_pose(
            body,
            position=pose["position"][:, k],
            quaternion=pose["quaternion"][:, k],
            linear_velocity=velocity[:, k],
            angular_velocity=pose["spin"][:, k],
        )
    sim.step()
    return np.concatenate(skin.read(), -1)


def newton(t: float) -> dict:
    """All in one row, environment after environment: transforms (x, y, z, w), twists at the centre of mass."""
    pose, com = course(t), np.broadcast_to(COM, (N_ENVS, 2, 3))
    order = [1, 2, 3, 0]
    q = np.concatenate([pose["position"], pose["quaternion"][..., order]], -1).reshape(-1, 7).astype(np.float32)
    twist = np.concatenate([velocity_of(com, t), pose["spin"]], -1).reshape(-1, 6).astype(np.float32)
    body_q = wp.array(q, dtype=wp.transformf, device="cpu")
    body_qd = wp.array(twist, dtype=wp.spatial_vectorf, device="cpu")
    return {
        "position": (body_q, 0), "quaternion": (body_q, 3), "linear_velocity": (body_qd, 0),
        "angular_velocity": (body_qd, 3), "order": "xyzw", "velocity_at": "com", "com": np.tile(COM, (2, 1)),
        "index": {"hand": 0, "tool": 1},
    }  # fmt: skip


def mujoco_warp(t: float) -> dict:
    """Its world is body 0, spins come first, and velocities are those at a point of the world."""
    pose = course(t)
    local = turned(pose["quaternion"] * [1, -1, -1, -1], PIVOT - pose["position"])
    at_pivot = velocity_of(local, t)
    cvel = np.concatenate([pose["spin"], at_pivot], -1)
    parts = {"xpos": pose["position"], "xquat": pose["quaternion"], "cvel": cvel}
    parts = {name: np.concatenate([np.zeros_like(a[:, :1]), a[:, ::-1]], 1) for name, a in parts.items()}
    at = np.broadcast_to(PIVOT, (N_ENVS, 3, 3)).copy()
    return {
        "position": FromElsewhere(parts["xpos"]), "quaternion": parts["xquat"],
        "linear_velocity": parts["cvel"][..., 3:], "angular_velocity": parts["cvel"][..., :3], "velocity_at": at,
        "index": {"tool": 1, "hand": 2},
    }  # fmt: skip


def one_array(t: float) -> dict:
    pose = course(t)
    rows = np.full((N_ENVS, 3, 13), np.nan)  # of the floor, which is fixed, nothing is read
    velocity = velocity_of(np.zeros((N_ENVS, 2, 3)), t)
    rows[:, ::2] = np.concatenate([pose["position"], pose["quaternion"], velocity, pose["spin"]], -1)
    return {"poses": rows}


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("convention", [one_array, newton, mujoco_warp])
def test_poses_of_another_simulator(convention, threads):
    t = 0.02
    expected = truth(t)
    assert np.abs(expected).max() > 0.5 and np.isfinite(expected).all()
    sim, skin = scene(threads=threads)
    sim.step()
    sim.bind_poses(**convention(t))
    assert str(sim.plan).splitlines()[2 if threads > 1 else 1].startswith("bound poses")
    for _ in range(2):
        sim.step()
        tolerance = 3e-4 if convention is newton else 1e-6  # float32 positions, 0.3 m from the origin
        assert np.abs(np.concatenate(skin.read(), -1) - expected).max() <= tolerance * np.abs(expected).max()
    sim.close()


def test_what_is_bound_is_read_at_each_step_and_cannot_be_set():
    sim, skin = scene()
    rows = one_array(0.0)["poses"]
    sim.bind_poses(rows)
    sim.step()
    before = skin.read().force.copy()
    rows[2, 2, 2] += 1.0
    sim.step()
    after = skin.read().force
    assert not after[2].any() and np.array_equal(np.delete(after, 2, 0), np.delete(before, 2, 0))
    with pytest.raises(SceneError, match=r"'tool'.*bind_poses"):
        sim.set_pose("tool", position=(0, 0, 0))
    sim.reset([1])
    sim.step()
    assert np.array_equal(skin.read().force, after)  # bound bodies are where they are bound


def test_the_poses_of_a_step_are_one_array_to_write():
    t = 0.02
    sim, skin = scene()
    poses = sim.pose_array.numpy()  # any library may write there; NumPy's from_dlpack only reads
    assert np.shares_memory(poses, np.from_dlpack(sim.pose_array))
    assert poses.shape == (N_ENVS, 3, 13) and poses[:, 2, 2].tolist() == [0.018] * N_ENVS
    given = one_array(t)["poses"]
    poses[:, ::2] = given[:, ::2]
    sim.step()
    assert np.abs(np.concatenate(skin.read(), -1) - truth(t)).max() < 1e-6
    assert sim.pose(sim.bodies[2]).position == pytest.approx(given[0, 2, :3])


def test_float32_is_said_in_the_plan():
    sim, _skin = scene()
    sim.bind_poses(one_array(0.0)["poses"].astype(np.float32))
    assert "float32 places a body to 0.06 µm at 1 m" in str(sim.plan)


def freed() -> wp.array:
    array = wp.zeros((N_ENVS, 3, 3), dtype=wp.float32, device="cpu")
    array.ptr = None
    return array


P, Q = np.zeros((N_ENVS, 3, 3)), np.zeros((N_ENVS, 3, 4))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({}, "give poses"),
        ({"position": np.zeros((N_ENVS, 3, 4))}, r"position: expected shape \(5, n, 3\).*got \(5, 3, 4\)"),
        ({"position": np.zeros((4, 3, 3))}, r"expected shape \(5, n, 3\)"),
        ({"position": np.zeros((13, 3))}, r"or \(5 n, 3\)"),
        ({"position": P, "quaternion": Q[:, :2]}, "same number of bodies, got position 3, quaternion 2"),
        ({"position": P.astype(np.int32)}, "must be float32 or float64, got int32"),
        ({"position": P.astype(np.float16)}, "must be float32 or float64, got float16"),
        ({"position": freed()}, "no memory"),
        ({"position": [1, 2, 3]}, "expected a Warp or NumPy array"),
        ({"poses": np.zeros((N_ENVS, 3, 12))}, r"expected shape \(5, n, 13\)"),
        ({"poses": np.zeros((N_ENVS, 3, 13)), "order": "xyzw"}, "one array of poses has"),
        ({"quaternion": Q, "order": "zyxw"}, "order must be one of wxyz, xyzw"),
        ({"position": P, "velocity_at": "middle"}, "velocity_at must be"),
        ({"linear_velocity": P, "angular_velocity": P, "velocity_at": "com"}, "needs com="),
        ({"linear_velocity": P, "velocity_at": "com", "com": np.zeros((3, 3))}, "needs angular_velocity="),
        ({"position": P[:, :2]}, r"arrays are of 2 bodies, the scene has 3; .*index="),
        ({"position": P, "index": {"tool": 3}}, r"must be in 0\.\.2, got 3"),
        ({"position": P, "index": {"floor": 0}}, "'floor' is fixed"),
        ({"position": P, "index": {"wall": 0}}, "wall"),
    ],
)
def test_what_cannot_be_bound_is_said_before_anything_runs(wrong, said):
    sim, _skin = scene()
    stages = list(sim.plan.stages)
    with pytest.raises(SceneError, match=said):
        sim.bind_poses(**wrong)
    assert sim.plan.stages == stages
    sim.set_pose("tool", position=(0, 0, 1.0))


def test_a_pose_that_is_nan_is_seen_on_the_device_and_said():
    sim, skin = scene()
    rows = one_array(0.0)["poses"]
    rows[3, 2, 4] = np.nan
    sim.bind_poses(rows)
    with pytest.raises(PoseError, match="body 'tool', environment 3, step 1"):
        sim.step()
        sim.check()
    assert np.argwhere(skin.arrays.bad_poses.numpy()).tolist() == [[3, 2]]
    assert np.isnan(skin.read().force[3]).all() and np.isfinite(np.delete(skin.read().force, 3, 0)).all()


class TestResets:
    """By a mask on the device."""

    @pytest.mark.parametrize("kind", ["bool", "uint8", "elsewhere", "strided"])
    def test_of_any_kind(self, kind):
        mask = np.array([0, 1, 0, 0, 1], bool)
        masks = {
            "bool": wp.array(mask, dtype=wp.bool, device="cpu"),
            "uint8": wp.array(mask.astype(np.uint8), dtype=wp.uint8, device="cpu"),
            "elsewhere": FromElsewhere(mask.astype(np.uint8)),
            "strided": wp.array(np.repeat(mask, 2), dtype=wp.bool, device="cpu")[::2],
        }
        readings = []
        for how in (np.flatnonzero(mask), masks[kind]):
            sim, skin = scene()
            for name, where in (("hand", (0, 0, 0.5)), ("tool", (0, 0, 0.517))):
                sim.set_pose(name, position=where)
            sim.step()
            sim.reset(how)
            readings.append([skin.read().force, sim.pose_array.numpy()])
            sim.step()
            readings[-1].append(skin.read().force)
        assert all(np.array_equal(a, b) for a, b in zip(*readings))
        assert not readings[0][0][1].any() and readings[0][0][0].any()

    @pytest.mark.parametrize(
        ("mask", "said"),
        [
            (wp.zeros(4, dtype=wp.bool, device="cpu"), r"must have shape \(5,\).*got \(4,\)"),
            (wp.zeros((5, 1), dtype=wp.bool, device="cpu"), r"got \(5, 1\)"),
            (wp.zeros(5, dtype=wp.float32, device="cpu"), "mask of 5"),
            (np.zeros(4, bool), r"indices in 0\.\.4 or a mask of 5"),
            ([7], r"indices in 0\.\.4"),
        ],
    )
    def test_a_wrong_mask_is_said(self, mask, said):
        sim, skin = scene()
        sim.step()
        before = skin.read().force
        with pytest.raises(SceneError, match=said):
            sim.reset(mask)
        assert np.array_equal(before, skin.read().force)
