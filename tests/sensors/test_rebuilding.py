"""A built simulation is of its scene as it was; what has changed since is refused, not ignored."""

import dataclasses

import numpy as np
import pytest

import tactemu as tt
from tactemu.sensors.sensor import reading_array


@pytest.fixture
def world():
    """``(scene, ball, skin)``: a ball 1 mm deep in a pad."""
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.02)), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 0.019))
    model = tt.ContactDepthProbe(positions=[(0, 0, 0.009)], radius=1e-3)
    return scene, ball, scene.add_sensor(model, link=pad, name="skin")


def test_a_simulation_is_outdated_by_the_next_build(world):
    scene, ball, skin = world
    first = scene.build()
    first.step()
    assert skin.read() == pytest.approx(1e-3, abs=1e-8)
    second = scene.build()
    with pytest.raises(tt.SceneError, match="step: the scene was built again"):
        first.step()
    second.set_pose(ball, position=(0, 0, 0.0195))
    second.step()
    assert skin.read() == pytest.approx(5e-4, abs=1e-8)


@pytest.mark.parametrize("what", ["body", "sensor"])
def test_what_is_added_after_a_build_asks_for_another(world, what):
    scene, _ball, skin = world
    sim = scene.build()
    if what == "body":
        scene.add_body(tt.Sphere(radius=0.01), name="late")
    else:
        scene.add_sensor(skin.model, link="pad", name="late")
    with pytest.raises(tt.SceneError, match=f"step: {what} 'late' was added after the scene was built"):
        sim.step()
    scene.build().step()


def test_a_build_that_fails_leaves_the_one_before(world):
    scene, _ball, skin = world
    sim = scene.build()
    with pytest.raises(tt.SceneError, match="n_envs"):
        scene.build(n_envs=0)
    with pytest.raises(tt.SceneError, match="dtype"):
        scene.build(dtype="float16")
    sim.step()
    assert skin.read() == pytest.approx(1e-3, abs=1e-8)


def test_a_model_cannot_be_edited(world):
    *_, skin = world
    with pytest.raises(dataclasses.FrozenInstanceError, match="radius"):
        skin.model.radius = 0.1
    noisy = tt.ElectronicsOptions(noise=0.1)
    assert dataclasses.replace(skin.model, electronics=noisy).electronics.noise == 0.1


def test_a_time_step_below_a_nanosecond_is_refused(world):
    with pytest.raises(tt.SceneError, match="dt must be >= 1e-07 and <= 10 s, got 4e-10"):
        tt.Scene(dt=4e-10)
    sim = world[0].build()
    with pytest.raises(ValueError, match="at least 1e-9 s, got 4e-10"):
        sim.step(dt=4e-10)
    sim.step(dt=0.0)
    sim.step(dt=1e-9)
    assert sim.time_ns == 1


@pytest.mark.parametrize("kind", [tt.ProximityTaxel, tt.ElastomerTaxel])
def test_two_identical_sensors_read_the_same(kind):
    """Points are drawn once for a body, from the stream of the first sensor that asks for so many."""

    def readings(*names):
        scene = tt.Scene()
        pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.02)), fixed=True, name="pad")
        ball = scene.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 1))
        options = {"positions": [(0, 0, 0.01), (2e-3, 0, 0.01)], "radius": 3e-3, "n_sample_points": 500}
        skins = [scene.add_sensor(kind(**options), link=pad, name=name) for name in names]
        sim = scene.build(seed=3)
        for x in (0.0, 5e-4):
            sim.set_pose(ball, position=(x, 0, 0.0195))
            sim.step()
        return [reading_array(skin).numpy().copy() for skin in skins]

    first, second = readings("one", "two")
    assert np.abs(first).max() > 0 and np.array_equal(first, second)
    (alone,) = readings("one")
    assert np.array_equal(alone, first)
