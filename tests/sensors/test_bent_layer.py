"""Bent pads as one layer in arc length: against finite elements of the bent layer."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tests.sensors.bent_layer_truth import BentLayer, BentPad, overlap_of_cylinder

YOUNG, THICK, PITCH = 1e5, 4e-3, 1e-3
ALONG_Y = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
"""A cylinder's axis is z."""


def pad(radius, columns=24, rows=20, pitch_y=3e-3):
    """Places and normals of a pad bent around y, its middle in the origin; ``radius < 0``: concave."""
    angle = (np.arange(columns) - (columns - 1) / 2) * PITCH / radius
    y = (np.arange(rows) - (rows - 1) / 2) * pitch_y
    x, z = radius * np.sin(angle), radius * (np.cos(angle) - 1)
    places = np.stack([np.tile(x, (rows, 1)), np.tile(y[:, None], columns), np.tile(z, (rows, 1))], -1)
    normals = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
    return places, np.tile(normals, (rows, 1, 1))


def pad_both_ways(radii, n=41, pitch=5e-4):
    """Of an arc along x that is moved along one along y; its middle in the origin."""
    far = (np.arange(n) - (n - 1) / 2) * pitch
    return BentPad.surface(far[None, :], far[:, None], np.array(radii))


def ball_cap(radius, n):
    """Of a ball, at equal angles along both sides."""
    angle = (np.arange(n) - (n - 1) / 2) * 1e-3 / radius
    out = np.stack(np.broadcast_arrays(np.tan(angle), np.tan(angle)[:, None], 1.0), -1)
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    return radius * (out - [0, 0, 1]), out


def pressed(places, normals, shape, height, quaternion=(1, 0, 0, 0), **options):
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(None, name="pad", fixed=True)
    body = scene.add_body(shape, name="body", position=(0, 0, 1))
    model = tt.ElasticLayerTaxel(
        positions=places, normals=normals, radius=5e-4, young_modulus=YOUNG, thickness=THICK,
        iterations=200, tolerance=1e-4, **{"friction": 0.0, "displacement": False, **options},
    )  # fmt: skip
    skin = scene.add_sensor(model, link=link)
    sim = scene.build()
    sim.set_pose(body, position=height if np.ndim(height) else (0, 0, height), quaternion=quaternion)
    sim.step()
    return skin.read_ground_truth()


NIGHTLY = pytest.mark.nightly


@pytest.mark.parametrize(
    ("nu", "radius", "within"),
    [
        (0.3, 40e-3, 0.03),
        (0.45, -40e-3, 0.06),
        pytest.param(0.3, -40e-3, 0.03, marks=NIGHTLY),
        pytest.param(0.3, 20e-3, 0.06, marks=NIGHTLY),
        pytest.param(0.45, 40e-3, 0.07, marks=NIGHTLY),
        pytest.param(0.49, 80e-3, 0.06, marks=NIGHTLY),
        pytest.param(0.49, 40e-3, 0.10, marks=NIGHTLY),
        pytest.param(0.49, -40e-3, 0.10, marks=NIGHTLY),
    ],
)
def test_a_cylinder_pressed_into_a_bent_pad_is_held_as_by_finite_elements(nu, radius, within):
    indenter, depth = 8e-3, 8e-4
    places, normals = pad(radius)
    long = tt.Cylinder(radius=indenter, length=0.2)
    felt = pressed(places, normals, long, indenter - depth, ALONG_Y, poisson_ratio=nu, oversampling=2)
    middle = felt.force[len(places) // 2 - 1 : len(places) // 2 + 1, :, 2].sum(axis=1).mean() / -3e-3
    face = BentLayer(YOUNG, nu, THICK, radius, 0.03)
    true = face.lift(overlap_of_cylinder(face.along, radius, indenter, depth))
    flat = BentLayer(YOUNG, nu, THICK, np.inf, 0.03)
    assert middle == pytest.approx(true, rel=within)
    as_flat = flat.lift(overlap_of_cylinder(flat.along, np.inf, indenter, depth))
    assert abs(middle / true - 1) < abs(as_flat / true - 1), "better than if it were flat"


@pytest.mark.parametrize(
    ("nu", "thicknesses", "within"),
    [
        (0.45, (10, -10), 0.015),
        pytest.param(0.45, (np.inf, np.inf), 0.01, marks=NIGHTLY),
        pytest.param(0.45, (10, 10), 0.05, marks=NIGHTLY),
        pytest.param(0.45, (-10, -10), 0.05, marks=NIGHTLY),
        pytest.param(0.3, (5, -5), 0.015, marks=NIGHTLY),
        pytest.param(0.49, (5, 5), 0.12, marks=NIGHTLY),
        pytest.param(0.49, (20, 5), 0.08, marks=NIGHTLY),
    ],
)
def test_a_ball_pressed_into_a_pad_that_is_bent_both_ways_is_held_as_by_finite_elements(nu, thicknesses, within):
    ball, depth = 8e-3, 0.2 * THICK
    radii = np.array(thicknesses) * THICK
    truth = BentPad(YOUNG, nu, THICK, radii, 0.012, 0.0045, n=10, m=3)
    felt = pressed(*pad_both_ways(radii), tt.Sphere(radius=ball), ball - depth, poisson_ratio=nu, oversampling=2)
    assert -felt.force[..., 2].sum() == pytest.approx(truth.lift(ball, depth), rel=within)


def test_a_pad_on_a_ball_and_a_saddle_is_one_layer_however_it_lies():
    """Rows and columns exchanged, turned in the link, pressed off its middle: what is felt goes along."""
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    for places, normals in (pad_both_ways((0.05, -0.04), 17, 1e-3), ball_cap(0.06, 17)):
        at = places[5, 11] + 5.5e-3 * normals[5, 11]
        first = pressed(places, normals, tt.Sphere(radius=6e-3), at)
        assert np.unravel_index(np.argmax(first.pressure), first.pressure.shape) == (5, 11)
        other = pressed(
            places.swapaxes(0, 1) @ turn.T, normals.swapaxes(0, 1) @ turn.T, tt.Sphere(radius=6e-3), turn @ at
        )
        largest = np.abs(first.force).max()
        np.testing.assert_allclose(other.force.swapaxes(0, 1) @ turn, first.force, atol=2e-3 * largest)
        pushed = first.pressure > 0.05 * first.pressure.max()
        expected = -first.pressure[..., None] * normals * 1e-6
        np.testing.assert_allclose(first.force[pushed], expected[pushed], atol=0.02 * largest)


@pytest.mark.parametrize("rubs", [False, pytest.param(True, marks=NIGHTLY)])
def test_it_does_not_matter_how_a_bent_pad_is_turned_and_listed(rubs):
    """Bent along its columns or its rows, backwards, listed: the same taxels feel the same."""
    places, normals = pad(0.05, 12, 10, 1e-3)
    ball = tt.Sphere(radius=6e-3)
    options = {"friction": 0.5 * rubs, "displacement": rubs}
    first = pressed(places, normals, ball, 5.4e-3, **options)
    assert first.force[..., 2].sum() < 0
    for turn in (lambda a: a.swapaxes(0, 1)[::-1], lambda a: a[:, ::-1].reshape(-1, 3)):
        other = pressed(turn(places).copy(), turn(normals).copy(), ball, 5.4e-3, **options)
        for name in ("force", "displacement") if rubs else ("force",):
            one = turn(getattr(first, name))
            np.testing.assert_allclose(getattr(other, name), one, atol=2e-3 * np.abs(one).max())


def test_forces_on_a_bent_pad_point_into_it_where_they_act():
    places, normals = pad(0.03, 20, 12, 1e-3)
    felt = pressed(places, normals, tt.Sphere(radius=0.03), 0.0285)
    pushed = felt.pressure > 0.05 * felt.pressure.max()
    expected = -felt.pressure[..., None] * normals * PITCH**2
    np.testing.assert_allclose(felt.force[pushed], expected[pushed], rtol=1e-4, atol=1e-9)


def test_what_is_bent_too_much_or_otherwise_is_refused():
    places, normals = pad(0.015)
    with pytest.raises(SceneError, match=r"a radius of 5 thicknesses or more"):
        pressed(places, normals, tt.Sphere(radius=5e-3), 4e-3)
    places, normals = pad(0.05)
    saddle = places + np.array([0, 0, 1.0]) * places[..., 1:2] ** 2
    with pytest.raises(SceneError, match="bent surface"):
        pressed(saddle, normals, tt.Sphere(radius=5e-3), 4e-3)
    places, normals = ball_cap(0.04, 17)
    pressed(places, normals, tt.Sphere(radius=5e-3), 4e-3)
    with pytest.raises(SceneError, match="bent surface"):
        pressed(*ball_cap(0.022, 17), tt.Sphere(radius=5e-3), 4e-3)
    with pytest.raises(SceneError, match="bent surface"):
        pressed(places.reshape(-1, 3), normals.reshape(-1, 3), tt.Sphere(radius=5e-3), 4e-3)
