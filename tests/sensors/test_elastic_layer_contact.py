"""Normal contact against closed forms, finite elements and another solver."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from tests.sensors.elastic_layer_rig import LayerRig, coordinates

DATA = Path(__file__).parents[1] / "data" / "elastic_layer"
SHIFTS = [(0.0, 0.0), (0.25, 0.4), (0.5, 0.5)]
E = 1e5


def paraboloid(cells, pitch, radius, depth, shift=(0.0, 0.0)):
    x, y = coordinates(cells, pitch, shift)
    return depth - (x**2 + y**2) / (2 * radius)


def force(pressure, pitch):
    return float(pressure.sum()) * pitch**2


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize(("cells_per_a", "tolerance"), [(4, 7e-3), (16, 4e-4)])
def test_hertz(cells_per_a, tolerance, shift):
    radius, depth, nu = 5e-3, 1e-4, 0.3
    a = np.sqrt(radius * depth)
    pitch, cells = a / cells_per_a, 4 * cells_per_a
    rig = LayerRig((cells, cells), pitch, E, nu, np.inf)
    pressure = rig.press(paraboloid(cells, pitch, radius, depth, shift))
    hertz = 4 / 3 * E / (1 - nu**2) * np.sqrt(radius) * depth**1.5
    assert force(pressure, pitch) == pytest.approx(hertz, rel=tolerance)
    x, y = coordinates(cells, pitch, shift)
    p0 = 2 * E / (1 - nu**2) * a / (np.pi * radius)
    truth = p0 * np.sqrt(np.maximum(0, 1 - (x**2 + y**2) / a**2))
    assert np.linalg.norm(pressure - truth) / np.linalg.norm(truth) < {4: 0.07, 16: 0.015}[cells_per_a]


def test_hertz_surface():
    radius, depth, nu, cells = 5e-3, 1e-4, 0.3, 96
    a = np.sqrt(radius * depth)
    pitch = a / 16
    rig = LayerRig((cells, cells), pitch, E, nu, np.inf, real=wp.float64)
    rig.press(paraboloid(cells, pitch, radius, depth))
    along, across, into = rig.surface()
    x, y = coordinates(cells, pitch)
    r = np.hypot(x, y)
    outside = np.maximum(r, a)
    ratio = a / outside
    p0, effective = 2 * E / (1 - nu**2) * a / (np.pi * radius), E / (1 - nu**2)
    w = p0 / (2 * effective * a) * (
        (2 * a**2 - outside**2) * np.arcsin(ratio) + outside**2 * ratio * np.sqrt(1 - ratio**2)
    )  # fmt: skip
    w = np.where(r <= a, depth - r**2 / (2 * radius), w)
    assert np.abs(into - w).max() < 4e-3 * depth
    u = -(1 - 2 * nu) * (1 + nu) / (3 * E) * a**2 / r * p0 * (1 - np.maximum(0, 1 - (r / a) ** 2) ** 1.5)
    assert np.abs(along - u * x / r).max() < 0.02 * np.abs(u).max()
    assert np.abs(across - u * y / r).max() < 0.02 * np.abs(u).max()


def fem_cases():
    data = json.loads((DATA / "fem_linear.json").read_text())
    return [pytest.param(data, case, id=f"nu {case['nu']} depth {case['d']}") for case in data["cases"]]


@pytest.mark.parametrize(("data", "case"), fem_cases())
def test_layer_against_finite_elements(data, case):
    nu, depth, cells = case["nu"], case["d"], 224
    a = 1.6 * np.sqrt(data["R"] * depth)
    pitch = 3.2 * a / 128
    rig = LayerRig((cells, cells), pitch, data["E"], nu, data["h"], real=wp.float64, tolerance=1e-6)
    pressure = rig.press(paraboloid(cells, pitch, data["R"], depth, (0.25, 0.25)))
    assert force(pressure, pitch) == pytest.approx(case["F"], rel=1e-3)
    along, across, into = rig.surface()
    x, y = coordinates(cells, pitch, (0.25, 0.25))
    r = np.hypot(x, y)
    near = r < case["r"][-1]
    assert np.abs(into - np.interp(r, case["r"], case["uz"]))[near].max() < 4e-3 * depth
    outward = (along * x + across * y) / r
    wanted = np.interp(r, case["r"], case["ur"])
    assert np.linalg.norm((outward - wanted)[near]) < 0.02 * np.linalg.norm(wanted[near])


def test_layer_against_another_solver():
    with (DATA / "contact.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["object"] == "sphere" and float(row["h"]) <= 4e-3]
    for row in rows:
        nu, radius, depth, h = (float(row[key]) for key in ("nu", "R", "d", "h"))
        extent = 1.25 * float(row["a(area radius)"])
        cells = 64
        pitch = 2 * extent / cells
        x, y = coordinates(cells, pitch)
        overlap = depth - (radius - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0)))
        rig = LayerRig((cells, cells), pitch, E, nu, h)
        assert force(rig.press(overlap), pitch) == pytest.approx(float(row["F"]), rel=3e-3), row


def test_thin_compressible_layer_is_a_bed_of_springs():
    radius, depth, nu, h, cells = 5e-3, 1e-4, 0.3, 2e-5, 128
    pitch = 2.4 * np.sqrt(2 * radius * depth) / cells
    rig = LayerRig((cells, cells), pitch, E, nu, h)
    modulus = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    pressure = rig.press(paraboloid(cells, pitch, radius, depth))
    assert force(pressure, pitch) == pytest.approx(np.pi * modulus * radius * depth**2 / h, rel=0.01)


def test_thin_incompressible_layer():
    radius, depth, cells = 5e-3, 1e-4, 128
    a = 2 * np.sqrt(radius * depth)
    h = 0.02 * a
    pitch = 2.4 * a / cells
    rig = LayerRig((cells, cells), pitch, E, 0.5, h)
    pressure = rig.press(paraboloid(cells, pitch, radius, depth))
    thin = 2 * np.pi * (E / 3) * radius**2 * depth**3 / h**3
    assert force(pressure, pitch) == pytest.approx(thin, rel=0.01)


def test_flat_punch():
    a, depth, nu, cells = 1e-3, 1e-4, 0.3, 160
    pitch = 2.5 * a / cells
    x, y = coordinates(cells, pitch)
    overlap = np.where(np.hypot(x, y) < a, depth, -1.0)
    rig = LayerRig((cells, cells), pitch, E, nu, np.inf)
    radius = np.sqrt((overlap > 0).sum() * pitch**2 / np.pi)
    assert force(rig.press(overlap), pitch) == pytest.approx(2 * E / (1 - nu**2) * radius * depth, rel=3e-3)


def objects(cells, pitch):
    """Overlaps [m] of the objects of the ladder, 0.5 mm deep."""
    x, y = coordinates(cells, pitch)
    depth, radius = 5e-4, 5e-3
    round_ = np.sqrt(np.maximum(radius**2 - x**2, 0))
    yield "sphere", depth - radius + np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0)) - 1e3 * (x**2 + y**2 > radius**2)
    yield "box", np.where((np.abs(x) < 4e-3) & (np.abs(y) < 4e-3), depth, -1.0)
    yield "edge", np.where(np.abs(y) < 6e-3, depth - np.abs(x), -1.0)
    yield "cylinder", np.where((np.abs(y) < 6e-3) & (np.abs(x) < radius), depth - radius + round_, -1.0)
    yield "tilted box", np.where((np.abs(x) < 4e-3) & (np.abs(y) < 4e-3), depth + 0.1 * x, -1.0)


@pytest.mark.parametrize("name", [name for name, _ in objects(8, 5e-4)])
def test_four_iterations_are_enough(name):
    cells, pitch = 64, 5e-4
    overlap = dict(objects(cells, pitch))[name]
    best = LayerRig((cells, cells), pitch, E, 0.49, 4e-3, tolerance=1e-6)
    four = LayerRig((cells, cells), pitch, E, 0.49, 4e-3, iterations=4, tolerance=1e-6)
    truth, rough = best.press(overlap), four.press(overlap)
    assert -0.08 < rough.sum() / truth.sum() - 1 < 5e-3
    assert np.linalg.norm(rough - truth) < 0.09 * np.linalg.norm(truth)
    for got, wanted in zip(four.surface(), best.surface()):
        assert np.linalg.norm(got - wanted) < 0.09 * np.linalg.norm(wanted)
    assert four.residual > best.residual


def test_complementarity_and_balance():
    cells, pitch = 64, 5e-4
    for name, overlap in objects(cells, pitch):
        rig = LayerRig((cells, cells), pitch, E, 0.45, 4e-3, tolerance=1e-5, real=wp.float64)
        pressure = rig.press(overlap)
        gap = rig.surface()[2] - overlap
        assert (pressure >= 0).all(), name
        assert np.abs(gap[pressure > 0]).max() < 1e-3 * 5e-4, name
        assert gap.min() > -1e-3 * 5e-4, name
        work, energy = (pressure * overlap).sum(), (pressure * rig.surface()[2]).sum()
        assert work == pytest.approx(energy, rel=1e-4), name


def test_float32_is_float64():
    cells, pitch = 64, 5e-4
    for name, overlap in objects(cells, pitch):
        got = [
            force(LayerRig((cells, cells), pitch, E, 0.49, 4e-3, real=real, tolerance=1e-6).press(overlap), pitch)
            for real in (wp.float32, wp.float64)
        ]
        assert got[0] == pytest.approx(got[1], rel=1e-5), name


def test_thickness_is_continuous():
    cells, pitch = 32, 5e-4
    overlap = paraboloid(cells, pitch, 5e-3, 2e-4)
    for nu in (0.3, 0.5):
        last = None
        for h in np.geomspace(1e-6, 1e3, 10):
            both = [
                force(LayerRig((cells, cells), pitch, E, nu, t, tolerance=1e-4).press(overlap), pitch)
                for t in (h, h * 1.001)
            ]
            assert np.isfinite(both).all() and both[0] > 0
            assert both[1] == pytest.approx(both[0], rel=1e-2), h
            assert last is None or both[0] < 1.001 * last  # thicker is softer
            last = both[0]
        half_space = force(LayerRig((cells, cells), pitch, E, nu, np.inf).press(overlap), pitch)
        assert last == pytest.approx(half_space, rel=1e-3)


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1.0, 1e3])
def test_scale_does_not_matter(scale):
    cells = 32
    one = LayerRig((cells, cells), 5e-4, E, 0.49, 4e-3).press(paraboloid(cells, 5e-4, 5e-3, 2e-4))
    overlap = paraboloid(cells, 5e-4, 5e-3, 2e-4) * scale
    other = LayerRig((cells, cells), 5e-4 * scale, E, 0.49, 4e-3 * scale).press(overlap)
    np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-5 * one.max())


def test_swapping_axes_transposes():
    x, y = coordinates(48, 5e-4)
    overlap = (3e-4 - (x - 2e-3) ** 2 / 8e-3 - (y + 1e-3) ** 2 / 3e-3)[:21]
    one = LayerRig((21, 48), 5e-4, E, 0.49, 4e-3, tolerance=1e-6).press(overlap)
    other = LayerRig((48, 21), 5e-4, E, 0.49, 4e-3, tolerance=1e-6).press(overlap.T)
    np.testing.assert_allclose(other.T, one, atol=2e-4 * one.max())


def test_single_row_and_single_cell():
    for cells in ((1, 40), (40, 1), (1, 1)):
        pressure = LayerRig(cells, 5e-4, E, 0.49, 4e-3).press(np.full(cells, 1e-4))
        assert np.isfinite(pressure).all() and (pressure > 0).all()


def test_environments_do_not_know_each_other():
    cells, pitch = 32, 5e-4
    overlaps = [paraboloid(cells, pitch, 5e-3, d, (4 * k, -3 * k)) for k, d in enumerate((2e-4, -1e-4, 5e-4))]
    together = LayerRig((cells, cells), pitch, E, 0.49, 4e-3, n_envs=3).press(np.stack(overlaps))
    for overlap, pressure in zip(overlaps, together):
        alone = LayerRig((cells, cells), pitch, E, 0.49, 4e-3).press(overlap)
        np.testing.assert_array_equal(pressure, alone)


def test_broken_overlap_leaves_other_environments_alone():
    cells, pitch = 32, 5e-4
    good = paraboloid(cells, pitch, 5e-3, 2e-4)
    bad = good.copy()
    bad[3, 4] = np.nan
    rig = LayerRig((cells, cells), pitch, E, 0.49, 4e-3, n_envs=2)
    pressure = rig.press(np.stack([bad, good]))
    assert np.isnan(rig.pressed.residual.numpy()[0])
    np.testing.assert_array_equal(pressure[1], LayerRig((cells, cells), pitch, E, 0.49, 4e-3).press(good))


def test_still_scene_is_not_solved_again_and_an_unfinished_one_is():
    overlap = paraboloid(64, 5e-4, 5e-3, 5e-4)
    rig = LayerRig((64, 64), 5e-4, E, 0.49, 4e-3, iterations=2, tolerance=1e-4)
    rig.press(overlap)
    steps, last = 0, np.inf
    while rig.pressed.iterations.numpy()[0] > 0:
        assert rig.residual < last
        last = rig.residual
        rig.press(overlap)
        steps += 1
    assert 1 < steps < 10 and rig.residual <= 1e-4
    assert rig.pressed.changed.numpy()[0] == 0


def test_window_follows_the_contact():
    rig = LayerRig((256, 256), 5e-4, E, 0.49, 4e-3)
    for shift in ((0, 0), (-100, 90)):
        rig.press(paraboloid(256, 5e-4, 5e-3, 5e-4, shift))
        assert rig.pressed.box.numpy()[0, 2:].max() <= 32
    rig.press(np.full((256, 256), -1.0))
    assert not rig.pressure.any() and rig.residual == 0.0


def test_neo_hookean_gap():
    """How far small strains are from a skin at finite strain: the figures of docs/accuracy.md."""
    data = json.loads((DATA / "neo_hookean.json").read_text())
    radius, cells = data["R"], 64
    bounds = {0.49: (-0.005, 0.025), 0.45: (-0.035, 0.005), 0.3: (-0.14, -0.015)}
    for case in data["cases"]:
        if case["d"] < 4e-4:
            continue
        pitch = 3.0 * case["a"] / cells
        x, y = coordinates(cells, pitch)
        overlap = case["d"] - radius + np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))
        rig = LayerRig((cells, cells), pitch, data["E"], case["nu"], data["h"])
        low, high = bounds[case["nu"]]
        assert low < force(rig.press(overlap), pitch) / case["F"] - 1 < high, case
