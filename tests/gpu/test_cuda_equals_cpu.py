"""CPU and CUDA give the same numbers within float32 rounding: every sensor model, with its imperfections, in batches.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu``. Random draws are counter-based: noise is the
same on both.
"""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.option_groups import from_flat

pytestmark = pytest.mark.gpu

N_ENVS, STEPS = 5, 12
X, Y = np.meshgrid((np.arange(9) - 4) * 2e-3, (np.arange(7) - 3) * 2e-3)
GRID = np.stack([X, Y, np.full_like(X, 0.01)], -1)
SPOILED = {"noise": 1e-4, "random_walk": 1e-5, "bias": 1e-3, "delay": 0.002, "gain": 1.1}

MODELS = {
    "ContactProbe": {"radius": 0.002},
    "ContactDepthProbe": {"radius": 0.002, **SPOILED},
    "KinematicTaxel": {"radius": 0.002, **SPOILED},
    "ElastomerTaxel": {"radius": 0.002, "sense": [1, 2]},
    "ProximityTaxel": {"radius": 0.004, "sense": [1, 2], "n_sample_points": 300},
    "ElasticLayerTaxel": {"thickness": 0.003},
}


def simulate(model: str, options: dict, device: str, **build):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.01))
    box = scene.add_body(tt.Box(size=(0.01, 0.012, 0.014)))
    skin = scene.add_sensor(from_flat(getattr(tt, model), {"positions": GRID, **options}), link=pad)
    sim = scene.build(n_envs=N_ENVS, device=device, seed=4, **build)
    readings = []
    for step in range(STEPS):
        offset = 1e-3 * np.arange(N_ENVS)[:, None] * [1.0, 0.5, 0.0]
        ball_at = np.add(offset, [-0.004 + 2e-4 * step, 0.0, 0.019 - 5e-5 * step])
        sim.set_pose(ball, position=ball_at, linear_velocity=(0.2, 0.0, -0.05))
        tilt = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
        sim.set_pose(box, position=[0.006, 0.003, 0.016], quaternion=tilt, angular_velocity=(0.0, 0.0, 1.0))
        sim.step()
        for reading in (skin.read(), skin.read_ground_truth()):
            readings.append(np.concatenate([np.ravel(part).astype(float) for part in as_tuple(reading)]))
    return np.array(readings)


def as_tuple(reading):
    return reading if isinstance(reading, tuple) else (reading,)


@pytest.mark.parametrize("model", MODELS)
def test_same_numbers(model):
    if not hasattr(tt, model):
        pytest.fail(f"tactemu has no {model}")
    cpu = simulate(model, MODELS[model], "cpu")
    cuda = simulate(model, MODELS[model], "cuda:0")
    largest = np.abs(cpu).max()
    assert largest > 0, "the case must be in contact"
    assert np.isfinite(cuda).all()
    assert np.abs(cpu - cuda).max() <= 2e-5 * largest


@pytest.mark.parametrize("model", ["ContactDepthProbe", "KinematicTaxel"])
def test_same_numbers_in_float64(model):
    cpu = simulate(model, MODELS[model], "cpu", dtype="float64")
    cuda = simulate(model, MODELS[model], "cuda:0", dtype="float64")
    assert np.abs(cpu - cuda).max() <= 1e-12 * np.abs(cpu).max()
