"""Weights of the dilation against exact arithmetic, closed forms and each other."""

from fractions import Fraction

import numpy as np
import pytest

from tactemu.sensors.elastomer.dilation_direct import free_areas, free_spacing
from tactemu.sensors.elastomer.dilation_grid import plane_terms
from tactemu.sensors.elastomer.dilation_kernels import (
    DilationOptions,
    _bessel_j1,
    layer_response,
    radial_layer,
    radial_weight,
    spectral_layer,
)
from tactemu.sensors.elastomer.separable import overlapping_blocks, separable_terms
from tactemu.sensors.probe_grid import Grid, find_grid


def exact_layer_response(q: float) -> Fraction:
    """``2 q^2 / (sinh 2q - 2q)`` from the power series in rational numbers."""
    x = 2 * Fraction(q)
    term, total, n = x**3 / 6, Fraction(0), 3
    while n < 9 or term > total / 10**22:
        total += term
        term = (term * x * x / ((n + 1) * (n + 2))).limit_denominator(10**70)
        n += 2
    return x * x / 2 / total


@pytest.mark.parametrize("q", [1e-6, 1e-3, 0.1, 0.349, 0.351, 1.0, 5.0, 12.0])
def test_layer_response_is_exact(q):
    assert abs(float(layer_response(np.float64(q)) / exact_layer_response(q) - 1)) < 2e-13


def test_layer_response_never_overflows():
    q = np.logspace(-300, 300, 4001)
    value = layer_response(q)
    assert np.isfinite(value[q > 1e-290]).all() and (value >= 0).all() and (np.diff(value) <= 0).all()


def test_bessel_function():
    from scipy.special import j1

    x = np.linspace(0, 400, 999)
    assert np.abs(_bessel_j1(x) - j1(x)).max() < 1e-13


def test_unbounded_layer_is_the_periodic_one_without_its_images():
    """On a box 1.5 times finer and far larger than the layer, the images leave the field of a uniform background."""
    thickness, pitch, n = 4e-3, 5e-4, 1024
    i = np.arange(1, 32)
    periodic = spectral_layer((n, n), (pitch, pitch), thickness)[0, 0, i] / pitch**2
    background = 3 / (4 * thickness) * i * pitch / (n * pitch) ** 2
    assert radial_layer(i * pitch, thickness) == pytest.approx(periodic + background, rel=1e-5)


def test_unbounded_layer_far_away():
    """Far field 3 / (4 pi H rho) per area, from the small-q limit of S."""
    assert radial_layer(np.array([1.0]), 1e-2)[0] == pytest.approx(3 / (4 * np.pi * 1e-2), rel=1e-12)


@pytest.mark.parametrize("shape", [(9, 9), (10, 12), (3, 17)])
def test_separable_terms_add_up(shape):
    rows, cols = shape
    rng = np.random.default_rng(0)
    y, x = np.meshgrid(np.arange(1 - rows, rows), np.arange(1 - cols, cols), indexing="ij")
    for table in (x / (x**2 + y**2 + 1.0), np.exp(-0.1 * (x**2 + y**2)), rng.normal(size=x.shape)):
        row, col = separable_terms(table, 1e-14)
        assert row.T @ col == pytest.approx(table, abs=1e-12)
    assert len(separable_terms(np.exp(-0.1 * (x**2 + y**2)), 1e-13)[0]) == 1
    zero_row, zero_col = separable_terms(np.zeros_like(x, dtype=float), 1e-13)
    assert not (zero_row.T @ zero_col).any()


def test_large_tables_are_decomposed_as_exactly():
    y, x = np.meshgrid(np.arange(-210, 211), np.arange(-205, 206), indexing="ij")
    for table in (x / (x**2 + y**2 + 1.0), np.random.default_rng(0).normal(size=x.shape)):
        row, col = separable_terms(table, 1e-13)
        assert row.T @ col == pytest.approx(table, abs=1e-11)


def test_blocks_hold_neighbours():
    blocks = overlapping_blocks(np.arange(5.0)[None], 3)
    assert blocks[0, 1].tolist() == [1, 2, 3] and blocks[0, 4].tolist() == [4, 0, 0]


@pytest.mark.parametrize("compressibility", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("thickness", [0.0, 2e-3])
def test_area_weighted_grid_has_the_weights_of_a_free_layout(compressibility, thickness):
    """The grid's planes are the radial weight times the offset times the taxel's area."""
    grid = Grid(7, 9, 1e-3, 1e-3, np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.zeros(3))
    options = DilationOptions(
        lambda_d=2e5, compressibility=compressibility, elastomer_thickness=thickness, area_weighted=True
    )
    (row, col), *_ = plane_terms(grid, options, 1e-14)
    plane = row.T @ col
    weight = radial_weight(options, 1e-3, reach=2e-2)
    v, u = np.meshgrid(np.arange(-6, 7) * 1e-3, np.arange(-8, 9) * 1e-3, indexing="ij")
    rho = np.hypot(u, v)
    if weight.table is None:
        w = weight.gaussian * np.exp(-2e5 * rho**2) + weight.far / (rho**2 + (thickness or 1e-3) ** 2)
        if thickness and compressibility < 1:
            pytest.fail("a layer needs its table")
    else:
        table = np.interp(rho, weight.table_step * np.arange(len(weight.table)), weight.table)
        w = weight.gaussian * np.exp(-2e5 * rho**2) + weight.far * table
    assert plane == pytest.approx(1e-6 * u * w, abs=2e-5 * np.abs(plane).max())


def test_grid_detection():
    x, y = np.meshgrid(np.arange(5) * 2e-3, np.arange(4) * 3e-3)
    positions = np.stack([x, y, 0 * x], -1)
    up = np.broadcast_to([0.0, 0.0, 1.0], (20, 3))
    grid = find_grid(positions, up)
    assert (grid.rows, grid.cols) == (4, 5) and grid.is_exact
    assert (grid.du, grid.dv) == pytest.approx((2e-3, 3e-3))
    assert find_grid(positions[:1], up[:5]) is None and find_grid(positions.reshape(-1, 3), up) is None
    bent = positions.copy()
    bent[..., 2] = 5 * x**2
    assert find_grid(bent, up) is None
    fanned = up + np.stack([0.01 * x, 0 * x, 0 * x], -1).reshape(-1, 3)
    assert find_grid(positions, fanned) is None


@pytest.mark.parametrize("hexagonal", [False, True])
def test_areas_of_a_free_layout(hexagonal):
    pitch = 1e-3
    i, j = np.meshgrid(np.arange(21), np.arange(21), indexing="ij")
    x, y = (i + 0.5 * (j % 2), j * np.sqrt(3) / 2) if hexagonal else (i, j)
    positions = pitch * np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    areas = free_areas(positions, np.broadcast_to([0.0, 0.0, 1.0], positions.shape)).reshape(21, 21)
    assert areas[10, 10] == pytest.approx(pitch**2 * (np.sqrt(3) / 2 if hexagonal else 1), rel=1e-4)


def test_free_spacing_of_a_line_and_a_plane():
    line = np.array([[0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    assert free_spacing(line) == pytest.approx(np.sqrt(9 / 4))
    assert free_spacing(np.array([[0, 0, 0], [2.0, 1.0, 0]])) == pytest.approx(1.0)
