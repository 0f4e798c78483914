"""torch and JAX over the memory of a skin, both ways, without a copy; in an environment of their own, nightly.

``tests/drivers/environments/torch_and_jax.txt`` pins them. Where they are installed the tests run anywhere;
``tests/gpu`` has those of a GPU.
"""

import os
import re
import subprocess
import sysconfig
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tests.drivers.environments import python_with
from tests.sensors.test_poses_on_the_device import N_ENVS, one_array, scene, truth

ROOT = Path(__file__).parents[2]
T_S = 0.02


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="torch: an environment of its own, nightly")


@pytest.fixture
def jax():
    found = pytest.importorskip("jax", reason="JAX: an environment of its own, nightly")
    found.config.update("jax_enable_x64", True)  # else it rounds poses to float32, which is a copy
    return found


@pytest.mark.nightly
def test_in_an_environment_of_their_own():
    """All other tests of this file, with both libraries; none may be skipped."""
    ours = [str(ROOT), sysconfig.get_path("purelib")]
    done = subprocess.run(
        [python_with("torch_and_jax"), "-m", "pytest", "-p", "no:cacheprovider", "-q", __file__],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": os.pathsep.join(ours)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    counted = {word: int(n) for n, word in re.findall(r"(\d+) (passed|skipped)", done.stdout.splitlines()[-1])}
    assert counted["passed"] > 10 and counted["skipped"] == 1, done.stdout[-2000:]  # this one


def stepped():
    """A simulation in which a body touches a skin, and the skin."""
    sim, skin = scene()
    sim.set_pose("tool", position=(0, 0, 0.018))
    sim.step()
    return sim, skin


def error(reading) -> float:
    """Relative to the largest number that the skin reads when the host sets the poses."""
    expected = truth(T_S)
    return np.abs(np.concatenate(reading, -1) - expected).max() / np.abs(expected).max()


def test_torch_sees_every_array_of_a_skin(torch):
    sim, skin = stepped()
    for name in dir(skin.arrays):
        array = getattr(skin.arrays, name)
        tensor = torch.from_dlpack(array)
        assert tensor.data_ptr() == array.ptr and tensor.shape == array.shape, name
        assert np.array_equal(tensor.numpy(), array.numpy()), name
    force = torch.from_dlpack(skin.arrays.force)
    assert force.abs().max() > 0.1
    before = force.clone()
    sim.set_pose("tool", position=(0, 0, 0.0175))
    sim.step()
    assert not torch.equal(force, before) and np.array_equal(force.numpy(), skin.read().force)


def test_torch_writes_the_poses_of_a_step(torch):
    sim, skin = scene()
    poses = torch.from_dlpack(sim.pose_array)
    assert poses.data_ptr() == sim.pose_array.ptr and poses.dtype == torch.float64
    poses[:, ::2] = torch.from_numpy(one_array(T_S)["poses"][:, ::2])
    sim.step()
    assert error(skin.read()) < 1e-5


@pytest.mark.parametrize(("number", "tolerance"), [("float32", 3e-4), ("float64", 1e-5)])
def test_torch_tensors_are_bound_in_place(torch, number, tolerance):
    """Strided views of one tensor, quaternions with w last; what is written later is read at the next step."""
    rows = one_array(T_S)["poses"][:, ::2].astype(number)  # position, quaternion, two velocities
    wide = torch.zeros((N_ENVS, 2, 16), dtype=getattr(torch, number))
    wide[:, :, 0:13] = torch.from_numpy(rows)
    wide[:, :, 3:7] = torch.roll(wide[:, :, 3:7], -1, dims=-1)
    parts = {"position": (0, 3), "quaternion": (3, 7), "linear_velocity": (7, 10), "angular_velocity": (10, 13)}
    sim, skin = scene()
    given = {name: wide[:, :, first:end] for name, (first, end) in parts.items()}
    sim.bind_poses(**given, order="xyzw", index={"tool": 1, "hand": 0})
    sim.step()
    assert error(skin.read()) < tolerance
    felt = skin.read().force.copy()
    wide[2, 1, 2] += 1.0
    sim.step()
    lifted = skin.read().force
    assert not lifted[2].any() and np.array_equal(np.delete(lifted, 2, 0), np.delete(felt, 2, 0))


def test_torch_sets_poses_masks_resets_and_takes_readings(torch):
    sim, skin = scene()
    places = torch.tensor([[0.0, 0.0, 0.018]]).repeat(N_ENVS, 1)
    places[1, 2] += 1.0
    sim.set_pose("tool", position=places)
    sim.step()
    memory = torch.zeros(skin.host_array().shape)
    reading = skin.read(out=memory)
    assert not reading.force[1].any() and reading.force[0].any()
    assert np.shares_memory(memory.numpy(), reading.force)
    sim.reset(torch.arange(N_ENVS) == 0)
    force = torch.from_dlpack(skin.arrays.force)
    assert not force[0].any() and force[2].any()


def test_jax_sees_the_readings_of_a_skin(jax):
    _sim, skin = stepped()
    packed = jax.dlpack.from_dlpack(skin.arrays.packed)
    assert packed.unsafe_buffer_pointer() == skin.arrays.packed.ptr
    reading = skin.read()
    for name, columns in skin.model.layouts.items():
        assert np.array_equal(np.asarray(packed[..., columns]), getattr(reading, name))
    assert np.abs(np.asarray(packed)).max() > 0.1


def test_jax_takes_no_strided_field_and_says_so(jax):
    """docs/batches.md names ``packed`` for this; when JAX takes strides the page can be simpler."""
    _sim, skin = stepped()
    with pytest.raises(Exception, match="compact"):
        jax.dlpack.from_dlpack(skin.arrays.force)


@pytest.mark.parametrize(
    "model", [tt.ContactDepthProbe, tt.ContactProbe, tt.ElastomerTaxel], ids=lambda model: model.__name__
)
def test_jax_sees_a_field_of_a_model_with_one(jax, model):
    built = tt.Scene()
    pad = built.add_body(tt.Box(size=(0.02, 0.02, 0.02)), fixed=True)
    built.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.0195))
    skin = built.add_sensor(model(positions=[(0, 0, 0.01), (0.002, 0, 0.01)], radius=0.002), link=pad)
    built.build(n_envs=3).step()
    (name,) = model.layouts
    array = getattr(skin.arrays, name)
    assert jax.dlpack.from_dlpack(array).unsafe_buffer_pointer() == array.ptr
    assert np.abs(array.numpy().astype(float)).max() > 0


def test_jax_arrays_are_bound_and_read_in_place(jax):
    sim, skin = scene()
    poses = jax.numpy.asarray(np.nan_to_num(one_array(T_S)["poses"]))
    sim.bind_poses(poses)
    sim.step()
    assert error(skin.read()) < 1e-5
    over = wp.from_dlpack(poses)
    assert over.ptr == poses.unsafe_buffer_pointer()


def test_jax_sets_poses_and_masks_resets(jax):
    sim, skin = scene()
    sim.set_pose("tool", position=jax.numpy.array([0.0, 0.0, 0.018]))
    sim.step()
    assert skin.read().force[0].any()
    sim.reset(jax.numpy.arange(N_ENVS) == 0)
    assert not skin.arrays.force.numpy()[0].any() and skin.arrays.force.numpy()[1].any()


def test_jax_sees_the_poses_of_a_step(jax):
    sim, _skin = scene()
    poses = jax.dlpack.from_dlpack(sim.pose_array)
    assert poses.unsafe_buffer_pointer() == sim.pose_array.ptr and poses.shape == sim.pose_array.shape
