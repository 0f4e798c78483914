"""Transfer functions against 50-digit arithmetic, and kernels against point loads on a half-space."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tactemu.sensors.layer.compliance import sample_kernels, spectrum, transfer

TABLE = Path(__file__).parents[1] / "data" / "elastic_layer" / "transfer.csv"


def table():
    with TABLE.open() as file:
        rows = np.array([[float(v) for v in row] for row in list(csv.reader(file))[1:]])
    return rows[rows[:, 1] > 0]


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 2e-9), (np.float32, 2e-6)])
def test_transfer_functions_match_50_digits(dtype, tolerance):
    for nu, q, cnn, ctt, cnt, css, *_ in table():
        if dtype is np.float32 and float(np.float32(nu)) != nu and nu > 0.45:
            continue  # 1 - 2 nu has no six digits left in float32
        got = transfer(q, nu, dtype)
        for value, wanted in zip(got, (cnn * q, ctt * q, css * q, cnt * q)):
            assert value == pytest.approx(wanted, rel=tolerance, abs=0.02 * tolerance * min(q, 1.0)), (nu, q)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49, 0.5])
def test_transfer_functions_are_finite_for_every_q(dtype, nu):
    q = np.array([0.0, 1e-38, 1e-12, 1e-3, 0.35, 1, 44.4, 44.5, 89, 1e4, 1e20, np.inf], dtype)
    got = transfer(q, nu, dtype)
    assert all(np.isfinite(values).all() for values in got)
    assert all(values.dtype == dtype for values in got)
    assert got.nn[-1] == pytest.approx(1 - nu) and got.tt[-1] == 1.0
    assert got.nl[-1] == pytest.approx((1 - 2 * nu) / 2)


def test_thin_layers_have_their_limits():
    q = 1e-4
    for nu in (0.0, 0.3, 0.45):
        modulus_over_shear = 2 * (1 - nu) / (1 - 2 * nu)
        assert transfer(q, nu).nn / q == pytest.approx(1 / modulus_over_shear, rel=1e-6)
    assert transfer(q, 0.5).nn / q == pytest.approx(q**2 / 3, rel=1e-6)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_kernels_far_away_are_point_loads_on_a_half_space(nu):
    pitch, shear = 1e-3, 2e4
    kernels = sample_kernels((33, 33), (pitch, pitch), shear, nu, np.inf)
    y, x = 24 * pitch, 18 * pitch
    r, force = np.hypot(x, y), pitch**2
    at = (24, 18)
    assert kernels.nn[at] == pytest.approx((1 - nu) * force / (2 * np.pi * shear * r), rel=2e-3)
    cerruti = force / (2 * np.pi * shear * r)
    assert kernels.xx[at] == pytest.approx(cerruti * ((1 - nu) + nu * x**2 / r**2), rel=4e-3)
    assert kernels.yy[at] == pytest.approx(cerruti * ((1 - nu) + nu * y**2 / r**2), rel=4e-3)


def test_spectrum_of_an_odd_kernel_convolves():
    rng = np.random.default_rng(1)
    n, kernel = 16, rng.standard_normal((9, 9))
    for odd in ((False, False), (True, True), (False, True), (True, False)):
        for axis in range(2):
            if odd[axis]:
                kernel = kernel.copy()
                kernel[(slice(None),) * axis + (0,)] = 0.0
        factors = spectrum(kernel, (n, n), odd)
        field = np.zeros((n, n))
        field[:5, :5] = rng.standard_normal((5, 5))

        mirrored = _cas(field)
        for axis in range(2):
            if odd[axis]:
                mirrored = np.roll(np.flip(mirrored, axis), 1, axis)
        got = _cas(factors * mirrored) / n**2
        wanted = np.zeros((5, 5))
        for j, i, b, a in np.ndindex(5, 5, 5, 5):
            dy, dx = j - b, i - a
            sign = (-1.0 if odd[0] and dy < 0 else 1.0) * (-1.0 if odd[1] and dx < 0 else 1.0)
            wanted[j, i] += sign * kernel[abs(dy), abs(dx)] * field[b, a]
        np.testing.assert_allclose(got[:5, :5], wanted, atol=1e-10)


def _cas(field):
    """The Hartley transform along both axes."""
    n = len(field)
    angle = 2 * np.pi * np.outer(np.arange(n), np.arange(n)) / n
    cas = np.cos(angle) + np.sin(angle)
    return cas @ field @ cas
