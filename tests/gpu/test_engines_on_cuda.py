"""Simulators that move the bodies on the device, and batches over several devices.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu/test_engines_on_cuda.py``.
"""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tests.scene.engine_models import DROP
from tests.scene.test_batch_engines import LINE, MOTORS, hand
from tests.sensors.test_split import N_ENVS, run, scene

pytestmark = pytest.mark.gpu
ENGINES = {"mujoco-warp": "MujocoWarpEngine", "newton": "NewtonEngine"}


def dropped(folder, kind: str, n_envs: int, device: str):
    """A ball above a skin on the floor: ``(engine, sim, skin, ball)``."""
    path = folder / "drop.xml"
    path.write_text(DROP)
    built = tt.Scene(dt=4e-3)
    engine = getattr(tt, ENGINES[kind])(built, path)
    model = tt.KinematicTaxel(positions=LINE, radius=5e-3, normal_damping=1.0)
    skin = built.add_sensor(model, link=engine.body_of("floor", "skin"))
    ball = next(body for body in engine.bodies if body.name == "ball")
    return engine, built.build(n_envs, device=device), skin, ball


@pytest.mark.parametrize("kind", ENGINES)
def test_an_engine_moves_as_on_the_cpu(tmp_path, kind):
    """Until the ball has come to rest, with a reset of some environments in between."""
    courses = {}
    for device in ("cpu", "cuda:0"):
        _engine, sim, skin, ball = dropped(tmp_path, kind, 5, device)
        course, mask = [], wp.array([False, True, False, True, False], dtype=wp.bool, device=device)
        for step in range(60):
            if step == 30:
                sim.reset(mask)
            sim.step()
            course.append(np.concatenate([sim.pose_array.numpy()[:, ball.index, :3], skin.read().force[:, 2]], -1))
        courses[device] = np.stack(course)
    places, forces = (np.stack([course[..., part] for course in courses.values()]) for part in (slice(3), slice(3, 6)))
    np.testing.assert_allclose(places[1], places[0], atol=2e-5)
    np.testing.assert_allclose(forces[1], forces[0], atol=0.03 * np.abs(forces[0]).max())


@pytest.mark.parametrize("kind", ENGINES)
def test_bodies_start_where_each_environment_has_them(tmp_path, kind):
    places, turns = np.random.default_rng(1).uniform(0.04, 0.06, (5, 3)), np.tile([0.6, 0.0, 0.0, 0.8], (5, 1))
    path = tmp_path / "drop.xml"
    path.write_text(DROP)
    scene = tt.Scene(dt=4e-3)
    engine = getattr(tt, ENGINES[kind])(scene, path)
    engine.starts = {"ball": (places, turns)}
    scene.add_sensor(tt.ContactDepthProbe(positions=LINE), link=engine.body_of("floor", "skin"))
    sim = scene.build(2, device="cuda:0", first_env=3)
    ball = next(body for body in engine.bodies if body.name == "ball")
    np.testing.assert_allclose(sim.pose_array.numpy()[:, ball.index, :3], places[3:], atol=1e-6)
    for _ in range(40):
        sim.step()
    sim.reset(wp.array([False, True], dtype=wp.bool, device="cuda:0"))
    sim.step()
    heights = sim.pose_array.numpy()[:, ball.index, 2] - places[3:, 2]
    assert abs(heights[1]) < 1e-3 < abs(heights[0])


def test_a_hand_closes_alike():
    """With either engine as on the CPU, whose steps MuJoCo's own judge."""
    found = {}
    for device in ("cpu", "cuda:0"):
        for kind in ENGINES:
            engine, sim, skins = hand(kind, device)
            columns = [engine.source.column(joint) for joint in MOTORS]
            for _ in range(150):
                sim.step()
            force = [np.abs(skin.read().force[..., 2]).sum((1, 2)) for skin in skins]
            found[device, kind] = engine.positions.numpy()[:, columns], np.array(force)
    angles, forces = found["cpu", "mujoco-warp"]
    for others in found.values():
        np.testing.assert_allclose(others[0], angles, atol=2e-3)
        np.testing.assert_allclose(others[1], forces, rtol=0.02)


@pytest.mark.parametrize("kind", ENGINES)
def test_an_engine_runs_long_without_a_leak(tmp_path, kind):
    _engine, sim, skin, _ball = dropped(tmp_path, kind, 256, "cuda:0")
    used = []
    for step in range(10_000):
        sim.step()
        if step % 1000 == 999:
            skin.read()
            used.append(wp.get_mempool_used_mem_current("cuda:0"))  # of this process: others may use the GPU, too
    assert used[-1] - used[1] < 16e6


@pytest.mark.parametrize("devices", [["cuda:0", "cuda:0"], ["cuda:0", "cuda:1"], ["cuda:1", "cuda:0", "cuda:1"]])
def test_several_devices_read_as_one(devices):
    if len(wp.get_cuda_devices()) < len(set(devices)):
        pytest.skip(f"needs {len(set(devices))} GPUs")
    built, skin = scene()
    expected = run(built.build(N_ENVS, seed=3, device="cuda:0"), skin.read)
    built, skin = scene()
    split = built.build_split(N_ENVS, devices, seed=3)
    np.testing.assert_array_equal(run(split, lambda: split.read(skin)), expected)
