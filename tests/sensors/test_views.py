"""Readings on the device by name, without a copy, and in memory of the caller's own."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import from_flat
from tactemu.sensors.sensor import reading_array
from tests.sensors.rig import scene_with

GRID = np.stack([*np.meshgrid(np.linspace(-8e-3, 8e-3, 6), np.linspace(-6e-3, 6e-3, 5)), np.full((5, 6), 0.01)], -1)
AT = {"link_shape": tt.Box(size=(0.03, 0.03, 0.02)), "position": (0, 0, 0.0195)}


def pressed(model, n_envs=3, slide=2e-4, **options):
    made = from_flat(model, {"positions": GRID, **options})
    sim, body, skin = scene_with(tt.Sphere(radius=0.01), made, n_envs=n_envs, **AT)
    for k in range(3):
        sim.set_pose(body, position=(k * slide, 0, 0.0194), linear_velocity=(0.2, 0, 0))
        sim.step()
    return sim, body, skin


@pytest.mark.parametrize("n_envs", [None, 3])
@pytest.mark.parametrize(
    ("model", "names"),
    [
        (tt.KinematicTaxel, ("force", "torque")),
        (tt.ElasticLayerTaxel, ("force", "displacement", "pressure", "traction")),
        (tt.ContactDepthProbe, ("depth",)),
        (tt.ElastomerTaxel, ("displacement",)),
    ],
)
def test_a_view_is_the_reading_and_stays_it(model, names, n_envs):
    sim, body, skin = pressed(model, n_envs, noise=1e-6)
    views = {name: np.from_dlpack(getattr(skin.arrays, name)) for name in names}
    for deeper in (0.0, 1e-4):
        sim.set_pose(body, position=(7e-4, 0, 0.0193 - deeper))
        sim.step()
        for truth in (False, True):
            reading = skin.read_ground_truth() if truth else skin.read()
            for name in names:
                expected = getattr(reading, name) if isinstance(reading, tuple) else reading
                seen = getattr(skin.ground_truth_arrays, name).numpy() if truth else views[name]
                assert seen.shape == expected.shape and np.abs(expected).max() > 0
                if name == "traction":
                    assert np.abs(seen - expected).max() <= 1e-5 * np.abs(expected).max()
                else:
                    assert np.array_equal(seen, expected)
    name = names[0]
    assert getattr(skin.arrays, name) is getattr(skin.arrays, name)
    assert np.shares_memory(np.from_dlpack(getattr(skin.arrays, name)), reading_array(skin).numpy())


def test_a_history_keeps_taxels_in_a_row():
    _sim, _body, skin = pressed(tt.KinematicTaxel, history_length=2)
    assert skin.arrays.force.shape == (3, 2, 30, 3)
    assert np.array_equal(skin.arrays.force.numpy().reshape(3, 2, 5, 6, 3), skin.read().force)


def test_what_is_not_there_is_said():
    _sim, _body, skin = pressed(tt.ContactDepthProbe)
    with pytest.raises(SceneError, match=r"'skin' has no array 'force' \(arrays: depth, packed, contacts, bad_poses\)"):
        _ = skin.arrays.force
    with pytest.raises(SceneError, match="build the scene"):
        scene = tt.Scene()
        _ = scene.add_sensor(tt.ContactDepthProbe(), link=scene.add_body(fixed=True)).arrays


def test_reading_into_memory_of_ones_own():
    sim, body, skin = pressed(tt.ElasticLayerTaxel)
    for out in (skin.host_array(), np.zeros(reading_array(skin).shape, np.float32)):
        reading = skin.read(out=out)
        memory = out if isinstance(out, np.ndarray) else out.numpy()
        assert np.shares_memory(reading.force, memory)
        plain = skin.read()
        assert all(np.array_equal(a, b) for a, b in zip(reading, plain)) and not np.shares_memory(plain.force, memory)
    kept = skin.read().force
    sim.set_pose(body, position=(0, 0, 1.0))
    sim.step()
    assert kept.any() and not skin.read().force.any()  # plain readings are copies


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((3, 30, 5), np.float32),
        np.zeros((3, 30, 6), np.float64),
        np.zeros((3, 30, 12), np.float32)[..., ::2],
        wp.zeros((3, 6, 30), dtype=wp.float32, device="cpu"),
    ],
)
def test_other_memory_is_refused(wrong):
    _sim, _body, skin = pressed(tt.KinematicTaxel)
    with pytest.raises(SceneError, match=r"out must be an array of the host of shape \(3, 30, 6\) of float32"):
        skin.read(out=wrong)
