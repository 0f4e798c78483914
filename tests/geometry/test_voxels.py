"""The voxel query: error against the exact distance falls with the cell as published, and borders are continuous."""

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base.errors import SceneError
from tests.sensors.rig import depth_of

RADIUS = 0.05


def band(shape, n=8000, low=-0.002, high=0.001, seed=0):
    """Points with an exact distance in the band, and that distance."""
    points = np.random.default_rng(seed).uniform(-0.02, 0.02, (n, 3))
    exact = RADIUS - depth_of(shape, points, RADIUS, dtype="float64")
    near = (exact > low) & (exact < high)
    return points[near], exact[near]


@pytest.mark.parametrize("cell", [1.29e-3, 0.635e-3])
def test_error_on_a_ball_is_that_of_a_trilinear_grid(cell):
    """max = 0.29 c^2 / R (second order). A ball as a mesh, since the voxel query leaves true balls exact."""
    radius = 0.015
    ball = tt.Mesh(source=trimesh.creation.icosphere(4, radius=radius))
    points, exact = band(ball)
    ours = RADIUS - depth_of(ball, points, RADIUS, depth_query="voxel", voxel_size=cell, dtype="float64")
    law = 0.29 * cell**2 / radius
    tessellation = 1.2e-3 * radius
    assert np.abs(ours - exact).max() < 1.5 * law + tessellation


@pytest.mark.parametrize("cell", [1.29e-3, 0.635e-3])
def test_error_at_the_edges_of_a_box_is_of_first_order(cell):
    box = tt.Box(size=(0.021, 0.017, 0.013))
    points, exact = band(box)
    ours = RADIUS - depth_of(box, points, RADIUS, depth_query="voxel", voxel_size=cell, dtype="float64")
    error = np.abs(ours - exact).max()
    assert 0.1 * cell < error < 0.5 * cell


def test_distance_is_continuous_across_the_border_of_the_grid():
    box = tt.Box(size=(0.02, 0.02, 0.02))
    x = np.linspace(0.011, 0.03, 2000)
    points = np.stack([x, 0.3 * x, 0.1 * x], -1)
    ours = depth_of(box, points, RADIUS, depth_query="voxel", dtype="float64")
    exact = depth_of(box, points, RADIUS, dtype="float64")
    assert np.abs(np.diff(ours)).max() < 1.5 * (x[1] - x[0])
    assert np.abs(ours - exact).max() < 2e-4


def test_ray_through_a_grid_enters_at_its_surface():
    values = np.fromfunction(lambda i, j, k: np.sqrt((i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2) - 12, (41, 41, 41))
    ball = tt.VoxelGrid(values=values * 1e-3, origin=(-0.02, -0.02, -0.02), cell=1e-3)
    deep = depth_of(ball, [[0, 0, 0]], 1e-3, position=(0, 0, 0.002), depth_query="ray", dtype="float64")
    assert deep[0] == pytest.approx(1e-3 + 0.010, abs=5e-5)


def test_a_cell_that_makes_the_grid_too_large_is_refused():
    with pytest.raises(SceneError, match="take a larger cell"):
        depth_of(tt.Box(size=(1, 1, 1)), [[0, 0, 0]], 1.0, depth_query="voxel", voxel_size=1e-4)


def test_a_grid_of_distances_given_directly_must_make_sense():
    with pytest.raises(SceneError, match="shape"):
        tt.VoxelGrid(values=np.zeros((3, 3)), origin=(0, 0, 0), cell=1.0)
    with pytest.raises(SceneError, match="finite"):
        tt.VoxelGrid(values=np.full((3, 3, 3), np.nan), origin=(0, 0, 0), cell=1.0)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 20.0, 45.0])
def test_a_ray_finds_a_ball_in_a_turned_grid_that_it_enters_from_outside(degrees):
    """Beyond the grid's box the step along a line must be no longer than the way to the ball."""
    radius, cell = 0.006, 2e-4
    x = np.arange(-0.008, 0.008 + cell / 2, cell)
    values = np.sqrt(x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2) - radius
    ball = tt.VoxelGrid(values=values, origin=(x[0],) * 3, cell=cell)
    across = np.linspace(-0.0024, 0.0024, 13)
    points = np.stack([*np.meshgrid(across, across), np.zeros((13, 13))], -1).reshape(-1, 3)
    half = np.radians(degrees) / 2
    turned = (np.cos(half), np.sin(half), 0.0, 0.0)
    place = (0.0, 0.0, radius - 5e-4)
    ours = depth_of(ball, points, 1e-9, position=place, quaternion=turned, depth_query="ray", dtype="float64")
    across2 = points[:, 0] ** 2 + points[:, 1] ** 2
    exact = np.maximum(0, np.sqrt(radius**2 - across2) - place[2])
    assert np.abs(ours - exact).max() < 2e-5
