"""The layer on a GPU: the solvers give what they give on a CPU, many environments give what one gives.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu``.
"""

import numpy as np
import pytest

import tactemu as tt
from tests.sensors.elastic_layer_rig import LayerRig, coordinates

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("cells", [(16, 16), (29, 32), (21, 40), (100, 70)])
def test_solvers(cells):
    """The first two are solved in a block's own memory, the others in the device's."""
    x, y = coordinates(max(cells), 5e-4, (0.2, 0.4))
    overlap = (4e-4 - (x**2 + y**2) / 1.2e-2)[: cells[0], : cells[1]]
    results = []
    for device in ("cpu", "cuda:0"):
        rig = LayerRig(cells, 5e-4, 1e5, 0.45, 4e-3, tolerance=1e-6, mu=0.4, coupled=True, device=device)
        pressure = rig.press(overlap)
        rig.rub(0.0)
        results.append([pressure, *rig.rub(3e-5, 1e-5), *rig.surface()])
    for one, other in zip(*results):
        np.testing.assert_allclose(one, other, atol=2e-5 * np.abs(one).max())


def test_environments_beyond_the_blocks_at_once():
    """More environments than blocks take turns; each reads as it does alone."""
    x = (np.arange(16) - 7.5) * 1e-3
    positions = np.stack([*np.meshgrid(x, x), np.zeros((16, 16))], -1)

    def simulate(n_envs, depths):
        scene = tt.Scene()
        pad = scene.add_body(None, name="pad", fixed=True)
        ball = scene.add_body(tt.Sphere(radius=8e-3), position=(0, 0, 1))
        skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=positions), link=pad)
        sim = scene.build(n_envs=n_envs, device="cuda:0")
        for k in range(5):  # the second step is captured in a graph, later ones run it
            height = 8e-3 - depths * (0.6 + 0.1 * k)
            sim.set_pose(ball, position=np.stack([np.full(n_envs, 2e-5 * k), np.zeros(n_envs), height], -1))
            sim.step()
        return skin.read()

    depths = np.linspace(0, 1e-3, 2500)
    many = simulate(2500, depths)
    assert np.isfinite(many.force).all() and many.residual.max() < 1e-3
    for env in (0, 1, 1055, 1056, 2499):
        alone = simulate(1, depths[env : env + 1])
        for one, other in zip(many, alone):
            np.testing.assert_array_equal(one[env], other[0])


@pytest.mark.parametrize("object_young_modulus", [None, 1e5])
@pytest.mark.parametrize("cells", [16, 40])
def test_a_layer_that_relaxes(cells, object_young_modulus):
    """A ball, rigid or soft, that presses, drags, and lets go reads as on a CPU; small skins in shared memory."""
    x = (np.arange(cells) - (cells - 1) / 2) * 5e-4
    positions = np.stack([*np.meshgrid(x, x), np.zeros((cells, cells))], -1)
    readings = []
    for device in ("cpu", "cuda:0"):
        scene = tt.Scene(dt=5e-3)
        pad = scene.add_body(None, fixed=True)
        ball = scene.add_body(tt.Sphere(radius=5e-3), position=(0, 0, 1))
        model = tt.ElasticLayerTaxel(
            positions=positions,
            thickness=4e-3,
            iterations=100,
            tolerance=1e-5,
            relaxation=((0.4, 0.02), (0.3, 0.2)),
            object_young_modulus=object_young_modulus,
        )
        skin = scene.add_sensor(model, link=pad)
        sim = scene.build(n_envs=3, device=device)
        for k in range(40):
            height = 5e-3 - np.array([2e-4, 3e-4, 4e-4]) * min(k, 10, 40 - k) / 10
            sim.set_pose(ball, position=np.stack([np.full(3, 3e-5 * k), np.zeros(3), height], -1))
            sim.step()
            readings.append(skin.read())
    for one, other in zip(readings[:40], readings[40:]):
        for field in ("force", "displacement"):
            largest = max(np.abs(getattr(each, field)).max() for each in readings)
            np.testing.assert_allclose(getattr(one, field), getattr(other, field), atol=1e-4 * largest)
