"""The windowed, transformed and preconditioned solvers against plain dense matrices of the same kernels."""

import numpy as np
import pytest
import warp as wp

from tactemu.sensors.layer.compliance import sample_kernels
from tests.sensors.elastic_layer_rig import LayerRig

E, PITCH = 1e5, 1e-3
ODD = {"nn": (1, 1), "xx": (1, 1), "yy": (1, 1), "xy": (-1, -1), "nx": (1, -1), "ny": (-1, 1)}
LAYERS = [(0.3, 2e-3), (0.5, 5e-4), (0.0, np.inf)]


def dense(name, cells, nu, thickness):
    """The matrix ``(n, n)`` that a kernel stands for: displacement of each cell by a load on each."""
    rows, columns = cells
    kernel = getattr(sample_kernels(cells, (PITCH, PITCH), E / (2 * (1 + nu)), nu, thickness), name)
    y, x = (part.ravel() for part in np.indices((rows, columns)))
    dy, dx = y[:, None] - y[None, :], x[:, None] - x[None, :]
    flip_y, flip_x = ODD[name]
    sign = np.where(dy < 0, flip_y, 1) * np.where(dx < 0, flip_x, 1)
    return kernel[np.abs(dy), np.abs(dx)] * sign


def solve_dense(matrix, overlap):
    """Complementarity by cyclic projected relaxation: slow, and with nothing in common with the solver."""
    pressure = np.zeros(len(overlap))
    for _ in range(6000):
        for i in range(len(overlap)):
            gap = matrix[i] @ pressure - overlap[i]
            pressure[i] = max(0.0, pressure[i] - gap / matrix[i, i])
        gap = matrix @ pressure - overlap
        if np.abs(np.minimum(pressure * matrix[0, 0], gap)).max() < 1e-10 * np.abs(overlap).max():
            break
    return pressure


def bumps(cells, seed):
    """A rough object: several bumps, so that the contact falls apart."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(cells) * PITCH
    overlap = np.full(cells, -1e-3)
    for _ in range(4):
        cy, cx = rng.uniform(0, 1, 2) * np.array(cells) * PITCH
        overlap = np.maximum(overlap, rng.uniform(1e-4, 5e-4) - ((y - cy) ** 2 + (x - cx) ** 2) / 8e-3)
    return overlap


@pytest.mark.parametrize(("nu", "thickness"), LAYERS)
@pytest.mark.parametrize("cells", [(9, 14), (1, 20), (20, 1)])
def test_normal_contact(cells, nu, thickness):
    for seed in range(3):
        overlap = bumps(cells, seed)
        rig = LayerRig(cells, PITCH, E, nu, thickness, tolerance=1e-9, real=wp.float64, iterations=500)
        got = rig.press(overlap)
        wanted = solve_dense(dense("nn", cells, nu, thickness), overlap.ravel()).reshape(cells)
        np.testing.assert_allclose(got, wanted, atol=1e-6 * wanted.max())


@pytest.mark.parametrize(("nu", "thickness"), LAYERS)
def test_surface_motion(nu, thickness):
    cells = (11, 18)
    rig = LayerRig(cells, PITCH, E, nu, thickness, tolerance=1e-8, real=wp.float64, iterations=500, mu=0.3)
    pressure = rig.press(bumps(cells, 1)).ravel()
    rig.rub(0.0)
    along, across = (traction.ravel() for traction in rig.rub(3e-5, -2e-5))
    matrix = {name: dense(name, cells, nu, thickness) for name in ODD}
    wanted = (
        matrix["xx"] @ along + matrix["xy"] @ across + matrix["nx"] @ pressure,
        matrix["yy"] @ across + matrix["xy"] @ along + matrix["ny"] @ pressure,
        matrix["nn"] @ pressure,
    )
    assert np.abs(across).max() > 0
    for got, value in zip(rig.surface(), wanted):
        # Beyond their reach responses below 1e-5 of that at the load are left out.
        np.testing.assert_allclose(got.ravel(), value, atol=1e-3 * np.abs(value).max())


@pytest.mark.parametrize(("nu", "thickness"), LAYERS)
def test_friction_is_a_minimum_of_the_energy(nu, thickness):
    """No change of a cell's traction within its disc lowers q.A q / 2 - q.s."""
    cells, slide = (10, 12), np.array([4e-5, 2e-5])
    rig = LayerRig(cells, PITCH, E, nu, thickness, tolerance=1e-8, real=wp.float64, iterations=500, mu=0.4)
    pressure = rig.press(bumps(cells, 2)).ravel()
    rig.rub(0.0)
    x, y = (traction.ravel() for traction in rig.rub(*slide))
    matrix = {name: dense(name, cells, nu, thickness) for name in ("xx", "yy", "xy")}
    gap_x = matrix["xx"] @ x + matrix["xy"] @ y - slide[0]
    gap_y = matrix["yy"] @ y + matrix["xy"] @ x - slide[1]
    limit = 0.4 * pressure
    touching = limit > 0
    step = 1.0 / matrix["xx"][0, 0]
    next_x, next_y = x - step * gap_x, y - step * gap_y
    size = np.maximum(np.hypot(next_x, next_y), 1e-300)
    shrink = np.minimum(1.0, limit / size)
    moved = np.hypot(next_x * shrink - x, next_y * shrink - y)[touching]
    assert moved.max() < 1e-4 * limit.max()


def test_one_number_per_lane_as_on_a_gpu():
    """The code that a GPU runs, one column per thread, gives what the CPU's eight columns side by side give."""
    cells = (21, 32)
    results = []
    for lanes in (1, 8):
        rig = LayerRig(cells, PITCH, E, 0.45, 2e-3, tolerance=1e-6, mu=0.4, coupled=True, lanes=lanes)
        pressure = rig.press(bumps(cells, 3))
        rig.rub(0.0)
        results.append([pressure, *rig.rub(3e-5, 1e-5), *rig.surface()])
    for one, other in zip(*results):
        np.testing.assert_allclose(one, other, atol=2e-5 * np.abs(other).max())
