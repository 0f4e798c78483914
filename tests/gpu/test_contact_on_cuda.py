"""Queries, poses from device arrays, errors and resets on a CUDA device, against the CPU.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu``.
"""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError
from tactemu.base.option_groups import from_flat
from tests.sensors.genesis_case import Case

pytestmark = pytest.mark.gpu

trimesh = pytest.importorskip("trimesh")
DEVICE = "cuda:0"
N_ENVS = 4
LINE = np.stack([np.linspace(-8e-3, 8e-3, 33), np.linspace(-3e-3, 5e-3, 33), np.full(33, 0.01)], -1)
SHAPES = {
    "sphere": tt.Sphere(radius=0.01),
    "capsule": tt.Capsule(radius=0.005, length=0.01),
    "cylinder": tt.Cylinder(radius=0.008, length=0.01),
    "plane": tt.Plane(),
    "mesh": tt.Mesh(source=trimesh.creation.icosphere(3, radius=0.01)),
    "open mesh": tt.Mesh(
        source=(trimesh.creation.icosphere(3, radius=0.01).vertices, trimesh.creation.icosphere(3).faces[:-40])
    ),
}


def built(shape, model, device):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.02)), fixed=True, name="pad")
    body = scene.add_body(shape, name="body", position=(0, 0, 0.018))
    skin = scene.add_sensor(model, link=pad, name="skin")
    return scene.build(N_ENVS, device=device), body, skin


def poses(step):
    rng = np.random.default_rng(step)
    position = np.c_[rng.uniform(-2e-3, 2e-3, (N_ENVS, 2)), rng.uniform(0.009, 0.019, N_ENVS)]
    return {
        "position": position,
        "quaternion": rng.normal(size=(N_ENVS, 4)),
        "linear_velocity": rng.normal(size=(N_ENVS, 3)),
        "angular_velocity": rng.normal(size=(N_ENVS, 3)),
    }


@pytest.mark.parametrize("query", ["sdf", "band", "voxel", "ray"])
@pytest.mark.parametrize("kind", SHAPES)
def test_every_query_reads_the_same(kind, query):
    readings = {}
    for device in ("cpu", DEVICE):
        model = tt.KinematicTaxel(positions=LINE, radius=2e-3, depth_query=query)
        sim, body, skin = built(SHAPES[kind], model, device)
        found = []
        for step in range(5):  # the first runs launch by launch, the second is captured
            sim.set_pose(body, **poses(step))
            sim.step()
            found.append(np.concatenate(skin.read(), -1))
        readings[device] = np.array(found)
    cpu, cuda = readings["cpu"], readings[DEVICE]
    assert np.isfinite(cuda).all() and np.abs(cpu).max() > 0
    differ = (np.abs(cpu - cuda) > 2e-5 * np.abs(cpu).max()).any(-1)
    assert differ.mean() <= (0.0 if kind in ("sphere", "plane") else 0.01)  # ties of faces and edges


def test_poses_from_device_arrays_and_from_the_host_mix():
    """A body may be posed from the device, then in part from the host, then from the device again."""
    model = tt.KinematicTaxel(positions=LINE, radius=2e-3)
    readings = []
    for on_device in (False, True):
        sim, body, skin = built(SHAPES["sphere"], model, DEVICE)
        for step in range(6):
            given = poses(step)
            if on_device and step % 3 != 1:
                given["position"] = wp.array(given["position"], dtype=wp.float64, device=DEVICE)
                given["linear_velocity"] = wp.array(given["linear_velocity"], dtype=wp.vec3d, device=DEVICE)
            sim.set_pose(body, **given)
            sim.set_pose(body, position=(0, 0, 0.0185), envs=[2])
            sim.step()
            readings.append(np.concatenate(skin.read(), -1))
    assert np.array_equal(readings[:6], readings[6:])


def test_a_bad_pose_is_told_once_and_harms_no_other_environment():
    model = tt.ContactDepthProbe(positions=LINE, radius=2e-3)
    sim, body, skin = built(SHAPES["sphere"], model, DEVICE)
    sim.step()
    good = skin.read()
    sim.set_pose(body, position=(0, np.nan, 0), envs=[1])
    with pytest.raises(PoseError, match="body 'body', environment 1, step 2"):
        sim.step()
        skin.read()
    after = skin.read()
    assert np.array_equal(after[[0, 2, 3]], good[[0, 2, 3]]) and np.isnan(after[1]).all()
    sim.reset([1])
    sim.step()
    assert np.array_equal(skin.read(), good)


def test_the_step_length_may_change_under_a_captured_graph():
    options = {"positions": LINE, "radius": 2e-3, "hysteresis_strength": 0.5, "hysteresis_tau": 0.01}
    readings = {}
    for device in ("cpu", DEVICE):
        sim, body, skin = built(SHAPES["sphere"], from_flat(tt.ContactDepthProbe, options), device)
        found = []
        for step, dt in enumerate((1e-3, 1e-3, 2e-3, 0.0, 5e-3)):
            sim.set_pose(body, **poses(step))
            sim.step(dt=dt)
            found.append(skin.read())
        assert sim.time_ns == 9_000_000 == int(sim.context.time_ns.numpy()[0])
        readings[device] = np.array(found)
    assert np.abs(readings["cpu"] - readings[DEVICE]).max() < 1e-8


@pytest.mark.parametrize(("name", "keys"), [("c03_contact", ("hertz",)), ("c10_contact", ("depth", "bool", "kin"))])
def test_the_seed_systems_readings(name, keys):
    case = Case(name)
    readings = case.replay(case.grid(1), keys, "float32", device=DEVICE)
    for key in keys:
        for _part, ours, theirs in case.parts(key, readings, "_gt"):
            touching = case.arrays["n_contacts"][:, 0] > 0
            if ours.dtype == bool:
                assert np.array_equal(ours[touching], theirs[touching])
            else:
                assert np.abs(ours - theirs)[touching].max() < 2e-5 * np.abs(theirs).max()
