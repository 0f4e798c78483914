"""Friction against Cattaneo and Mindlin, and what Coulomb's law says of any history."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tests.sensors.elastic_layer_rig import LayerRig, coordinates

E, RADIUS, DEPTH, MU = 1e5, 5e-3, 1e-4, 0.4
A = np.sqrt(RADIUS * DEPTH)


def pressed(nu, cells_per_a=16, **options):
    """A ball pressed into a half-space, without sliding."""
    pitch, cells = A / cells_per_a, 4 * cells_per_a
    x, y = coordinates(cells, pitch, (0.37, 0.21))
    rig = LayerRig((cells, cells), pitch, E, nu, np.inf, mu=MU, tolerance=1e-5, **options)
    pressure = rig.press(DEPTH - (x**2 + y**2) / (2 * RADIUS))
    rig.rub(0.0)
    return rig, pressure


def mindlin(nu, slide):
    """Force along the slide, slide at which all slips, and radius of the stick zone."""
    shear = E / (2 * (1 + nu))
    load = 4 / 3 * E / (1 - nu**2) * np.sqrt(RADIUS) * DEPTH**1.5
    full = 3 * MU * load * (2 - nu) / (16 * A * shear)
    force = MU * load * (1 - max(1 - slide / full, 0) ** 1.5)
    return force, full, A * (1 - force / (MU * load)) ** (1 / 3)


@pytest.mark.parametrize(("nu", "tolerance"), [(0.0, 3e-4), (0.45, 1.5e-3)])
def test_cattaneo_mindlin(nu, tolerance):
    """Mindlin neglects the tractions across the slide, which for nu = 0.45 cost him 1e-3."""
    rig, pressure = pressed(nu)
    full = mindlin(nu, 0.0)[1]
    cell = rig.pitch**2
    for k in range(1, 5):
        along, across = rig.rub(0.2 * full)
        force, _, stick = mindlin(nu, 0.2 * k * full)
        gross = MU * pressure.sum() * cell
        assert abs(along.sum() * cell - force) < tolerance * gross
        assert abs(across.sum()) * cell < 1e-4 * gross
        assert np.abs(across).max() < (1e-4 if nu == 0 else 0.08) * MU * pressure.max()
        radius = np.sqrt((rig.state.slip.numpy() == 1).sum() * cell / np.pi)
        assert radius == pytest.approx(stick, abs=0.02 * A)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_gross_slip_is_mu_times_load(nu):
    rig, pressure = pressed(nu)
    full = mindlin(nu, 0.0)[1]
    for _ in range(6):
        along, across = rig.rub(full, 0.5 * full)
    load = MU * pressure.sum()
    assert np.hypot(along.sum(), across.sum()) == pytest.approx(load, rel=1e-4)
    assert np.arctan2(across.sum(), along.sum()) == pytest.approx(np.arctan2(0.5, 1.0), abs=1e-3)
    assert set(np.unique(rig.state.slip.numpy())) == {0, 2}


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_coulomb_holds_everywhere_on_any_path(real):
    rig, pressure = pressed(0.45, cells_per_a=8, coupled=True, real=real)
    full = mindlin(0.45, 0.0)[1]
    rng = np.random.default_rng(3)
    for _ in range(12):
        along, across = rig.rub(*rng.normal(0, 0.6 * full, 2))
        traction = np.hypot(along, across)
        assert (traction <= MU * pressure * (1 + 1e-6)).all()
        assert not traction[pressure == 0].any()
        assert np.isfinite(traction).all()


def test_sliding_back_and_forth_dissipates():
    """After full slip, going back half the way leaves less than the force, and the work over a loop is positive."""
    rig, _ = pressed(0.0)
    full = mindlin(0.0, 0.0)[1]
    steps = [0.25 * full] * 8 + [-0.25 * full] * 16 + [0.25 * full] * 16
    forces = [rig.rub(step)[0].sum() for step in steps]
    work = sum(force * step for force, step in zip(forces[8:40], steps[8:40]))
    assert work > 0
    top = forces[7]
    assert forces[23] == pytest.approx(-top, rel=1e-3)
    assert forces[39] == pytest.approx(top, rel=1e-3)
    # Unloading by Mindlin and Deresiewicz: the force falls as if 2 mu were available.
    back = 1.0
    expected = 1 - 2 * (1 - (1 - back * full / (2 * full)) ** 1.5)
    assert forces[11] / top == pytest.approx(expected, abs=3e-3)


def test_a_still_object_keeps_its_tractions():
    rig, _ = pressed(0.3)
    full = mindlin(0.3, 0.0)[1]
    along, _ = rig.rub(0.5 * full)
    for _ in range(3):
        again, _ = rig.rub(0.0)
    np.testing.assert_allclose(again, along, atol=5e-4 * np.abs(along).max())  # steps go on solving
    rig.pressed.changed.fill_(0)
    rig.rub(0.0)
    assert rig.state.iterations.numpy()[0] == 0


def test_lifting_lets_go():
    rig, _ = pressed(0.3)
    rig.rub(1e-5)
    rig.press(np.full(rig.over.overlap.shape, -1e-3))
    along, across = rig.rub(0.0)
    assert not along.any() and not across.any()
    assert not rig.state.slip.numpy().any() and not rig.state.held_by.numpy().any()
    assert not rig.state.anchor_x.numpy().any()


def test_stuck_surface_follows_the_object():
    rig, pressure = pressed(0.3)
    full = mindlin(0.3, 0.0)[1]
    rig.rub(0.1 * full)
    moved, across, _ = rig.surface()
    core = pressure > 0.5 * pressure.max()
    assert rig.state.slip.numpy()[0][core].max() == 1
    by_pressure = LayerRig(rig.over.overlap.shape[1:], rig.pitch, E, 0.3, np.inf, tolerance=1e-5)
    by_pressure.press(rig.over.overlap.numpy()[0] * rig.tables.length_scale)
    assert np.abs(moved - by_pressure.surface()[0] - 0.1 * full)[core].max() < 1e-3 * full
    assert np.abs(across - by_pressure.surface()[1])[core].max() < 1e-3 * full


@pytest.mark.parametrize("seed", range(4))
def test_both_solvers_converge_whatever_happens(seed):
    """Any object, any layer, and slides from a nanometre to a metre in one step."""
    rng = np.random.default_rng(seed)
    cells, nu, thickness = (
        int(rng.choice([16, 40, 64])),
        float(rng.choice([0, 0.3, 0.49, 0.5])),
        10 ** rng.uniform(-5, 0),
    )
    mu = float(rng.choice([0.1, 0.5, 1.5]))
    rig = LayerRig((cells, cells), 5e-4, E, nu, thickness, mu=mu, coupled=True, tolerance=1e-4, iterations=40)
    x, y = coordinates(cells, 5e-4)
    for _ in range(8):
        depth, (cx, cy) = 10 ** rng.uniform(-6, -3), rng.uniform(-3e-3, 3e-3, 2)
        objects = (
            depth - ((x - cx) ** 2 + (y - cy) ** 2) / 1e-2,
            np.where((abs(x - cx) < 3e-3) & (abs(y - cy) < 2e-3), depth, -1.0),
            depth * rng.uniform(-1, 1, (cells, cells)),
            depth - abs(x - cx) * rng.uniform(0.1, 2) + 0.1 * (y - cy),
        )
        pressure = rig.press(objects[rng.integers(4)])
        along, across = rig.rub(*(10 ** rng.uniform(-9, 0) * rng.choice([-1, 1], 2)))
        assert rig.residual <= 1e-4 and rig.state.residual.numpy()[0] <= 1e-4
        assert (pressure >= 0).all() and (np.hypot(along, across) <= mu * pressure * (1 + 1e-5)).all()


def after_laps(path, tolerance, laps):
    """Tractions along x and y [Pa] after the fifth lap and after ``laps`` of a ball that slips at its edge alone."""
    x, y = coordinates(24, 5e-4)
    rig = LayerRig((24, 24), 5e-4, E, 0.49, 4e-3, mu=0.5, coupled=True, iterations=16, tolerance=tolerance)
    overlap = 4e-4 - (x**2 + y**2) / 0.04
    rig.press(overlap)
    rig.rub(0.0)
    before, found = np.zeros(2), []
    for step in range(1, 20 * laps + 1):
        turn = 2 * np.pi * step / 20
        if path == "while pressed deeper and less":
            rig.press(overlap + 5e-5 * np.sin(2 * turn))
        here = 3e-5 * np.array([np.sin(turn), 1 - np.cos(turn) if path == "round" else 0.0])
        tractions = rig.rub(*(here - before))
        before = here
        if step in (100, 20 * laps):
            found.append(np.array(tractions))
    return found


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, pytest.param(1e-4, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("path", ["there and back", "round", "while pressed deeper and less"])
def test_partial_slip_does_not_drift(path, tolerance):
    fifth, last = after_laps(path, tolerance, laps=100)
    assert np.abs(last - fifth).max() < 5e-3 * np.abs(fifth).max()


# -- friction that falls with slip -------------------------------------------------------------------------------------


def forces(rig, slides):
    """Shares of the load along the slide after each of the slides."""
    load = rig.pressure.sum()
    return np.array([rig.rub(slide)[0].sum() / load for slide in slides])


def test_onset_of_slip_by_distance():
    """The slide at which Cattaneo and Mindlin expect a force, and the radius of what still sticks."""
    rig, pressure = pressed(0.0)
    full = mindlin(0.0, 0.0)[1]
    load = MU * pressure.sum()
    for k in range(1, 10):
        share = rig.rub(0.1 * full)[0].sum() / load
        slide = full * (1 - (1 - share) ** (2 / 3))
        assert slide == pytest.approx(0.1 * k * full, rel=3e-3)
        stick = np.sqrt((rig.state.slip.numpy() == 1).sum() * rig.pitch**2 / np.pi)
        assert stick / A == pytest.approx((1 - share) ** (1 / 3), abs=0.02)


def test_the_same_coefficient_twice_is_one():
    one, _ = pressed(0.3, cells_per_a=8)
    two, _ = pressed(0.3, cells_per_a=8, mu_kinetic=MU)
    slide = 0.3 * mindlin(0.3, 0.0)[1]
    for _ in range(6):
        np.testing.assert_array_equal(one.rub(slide, 0.2 * slide), two.rub(slide, 0.2 * slide))


@pytest.mark.parametrize("distance", [1e-3, 1e-4])
def test_a_thin_layer_weakens_as_its_springs_do(distance):
    """A layer much thinner than a cell is a bed of springs k = G / t: q = k (x - w), and mu(w) p once it slips."""
    young, nu, thickness, static, kinetic = 1e5, 0.3, 1e-4, 0.5, 0.3
    rig = LayerRig(
        (24, 24), 1e-3, young, nu, thickness, mu=static, mu_kinetic=kinetic, slip_distance=distance, tolerance=1e-6,
        iterations=300, real=wp.float64,
    )  # fmt: skip
    pressure = rig.press(np.full((24, 24), 1e-5))[12, 12]
    rig.rub(0.0)
    stiffness = young / (2 * (1 + nu)) / thickness
    full = static * pressure / stiffness
    step, felt = full / 40, []
    for _ in range(200):
        felt.append(rig.rub(step)[0][12, 12] / pressure)
    x = step * np.arange(1, 201)
    falls = (static - kinetic) * pressure / distance
    slip = np.maximum((stiffness * x - static * pressure) / (stiffness - falls), 0)
    expected = np.where(x < full, stiffness * x / pressure, np.maximum(static - falls * slip / pressure, kinetic))
    assert np.abs(felt - expected).max() < 2e-3


def test_the_peak_lies_between_both_coefficients_and_the_end_is_kinetic():
    """A short distance leaves no peak, as cells let go one after another; where it is resolved, cells do not matter."""
    kinetic, full = 0.6 * MU, mindlin(0.0, 0.0)[1]
    peaks = {}
    for distance in (100 * full, full, 0.1 * full):
        for cells_per_a in (6, 12):
            rig, _ = pressed(0.0, cells_per_a, mu_kinetic=kinetic, slip_distance=distance)
            felt = forces(rig, [0.05 * full] * 60)
            peaks.setdefault(distance, []).append(felt.max())
            if distance <= full:
                assert felt[-1] == pytest.approx(kinetic, rel=1e-4)
    long, middle, short = peaks.values()
    assert long == pytest.approx([MU, MU], rel=1e-3)
    assert MU > middle[0] > short[0] > kinetic
    assert middle[0] == pytest.approx(middle[1], rel=1e-3) and short[0] == pytest.approx(short[1], rel=1e-3)


def test_an_object_that_stands_still_is_held_again():
    kinetic, full = 0.5 * MU, mindlin(0.0, 0.0)[1]
    rig, _ = pressed(0.0, 8, mu_kinetic=kinetic, slip_distance=full)
    first = forces(rig, [0.1 * full] * 40)
    rig.pressed.changed.fill_(0)
    going_on = forces(rig, [0.1 * full] * 5)
    still = forces(rig, [0.0] * 3)
    again = forces(rig, [0.1 * full] * 20)
    assert first[-1] == pytest.approx(kinetic, rel=1e-3) and going_on == pytest.approx([kinetic] * 5, rel=1e-3)
    assert still == pytest.approx([kinetic] * 3, rel=1e-3)
    assert again.max() > 1.5 * kinetic and again[-1] == pytest.approx(kinetic, rel=1e-3)


def test_a_scene_takes_both_coefficients():
    x = (np.arange(16) - 7.5) * 1e-3
    positions = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((16, 16))], axis=-1)

    def drag(**options):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(None, fixed=True, name="pad")
        ball = scene.add_body(tt.Sphere(radius=0.01), name="ball")
        model = tt.ElasticLayerTaxel(positions=positions, radius=5e-4, tolerance=1e-5, iterations=100, **options)
        sensor = scene.add_sensor(model, link=pad)
        sim = scene.build()
        ratios = []
        for k in range(60):
            sim.set_pose(ball, position=(2e-5 * k, 0, 0.0095))
            sim.step()
            force = sensor.read().force.sum(axis=(0, 1))
            ratios.append(force[0] / -force[2])
        return np.array(ratios), sim

    plain, _ = drag(friction=0.5)
    np.testing.assert_array_equal(plain, drag(friction=0.5, kinetic_friction=0.5)[0])
    falling, sim = drag(friction=0.5, kinetic_friction=0.2, slip_distance=2e-4)
    assert plain.max() == pytest.approx(plain[-1], rel=2e-3)
    assert falling.max() > 1.3 * falling[-1] and falling[-1] == pytest.approx(0.2, rel=0.1)
    assert "0.5, 0.2 once it slips" in str(sim.plan)
    with pytest.raises(tt.SceneError, match="kinetic_friction must be at most friction"):
        drag(friction=0.2, kinetic_friction=0.3)
