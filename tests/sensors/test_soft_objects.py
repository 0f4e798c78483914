"""Soft objects on an elastic layer: Hertz with both moduli, a soft ball by finite elements, Cattaneo and Mindlin."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.sensors.layer.compliance import transfer

DATA = json.loads((Path(__file__).parents[1] / "data" / "elastic_layer" / "soft_ball.json").read_text())
E, R = 1e5, 5e-3
MATERIALS = [(0.49, 1e5, 0.49), (0.3, 3e4, 0.45), (0.49, 1e7, 0.3), (0.45, 3e5, 0.0)]


def pressed(pitch, cells, depth, slides=(), **options):
    """Return the reading of a ball pressed into a layer and then slid along x, and the sums of its forces."""
    x = (np.arange(cells) - (cells - 1) / 2) * pitch
    positions = np.stack([*np.meshgrid(x, x), np.zeros((cells, cells))], -1)
    scene = tt.Scene()
    pad, ball = scene.add_body(name="pad", fixed=True), scene.add_body(tt.Sphere(radius=R))
    given = {"young_modulus": E, "friction": 0.0, "iterations": 300, "tolerance": 1e-6, "look_depth": 1e-2, **options}
    skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=positions, **given), link=pad)
    sim = scene.build(dtype="float64")
    for slide in (0.0, *slides):
        sim.set_pose(ball, position=(slide, 0, R - depth))
        sim.step()
    reading = skin.read()
    return reading, reading.force.sum((0, 1))


def effective(nu, object_young, object_nu):
    return 1 / ((1 - nu**2) / E + (1 - object_nu**2) / object_young)


def object_of(material):
    nu, young, object_nu = material
    return {"poisson_ratio": nu, "object_young_modulus": young, "object_poisson_ratio": object_nu}


@pytest.mark.parametrize("thickness_radii", [np.inf, 200.0])
@pytest.mark.parametrize("material", MATERIALS)
def test_a_thick_layer_and_a_soft_object_are_hertz_with_both_moduli(material, thickness_radii):
    depth = 2e-5
    a = np.sqrt(R * depth)
    options = object_of(material) | {"thickness": thickness_radii * a}
    reading, force = pressed(a / 16, 42, depth, **options)
    hertz = 4 / 3 * effective(*material) * np.sqrt(R) * depth**1.5
    tolerance = 1e-3 if thickness_radii == np.inf else 1e-2
    assert -force[2] == pytest.approx(hertz, rel=tolerance)
    share = effective(*material) * (1 - material[0] ** 2) / E  # the surface that is read is the skin's own
    assert -reading.displacement[..., 2].min() == pytest.approx(share * depth, rel=tolerance)


@pytest.mark.parametrize("material", MATERIALS)
def test_a_layer_of_ten_contact_radii_is_stiffer_than_hertz_by_its_base(material):
    """The base takes a part of the motion that is even over the contact: ``force / (2 pi G h)`` times an integral."""
    depth, nu = 2e-5, material[0]
    a = np.sqrt(R * depth)
    thickness, young = 10 * a, effective(*material)
    taken = quad(lambda q: 1 - nu - float(transfer(q, nu).nn), 0, 40)[0] * (1 + nu) / (np.pi * E * thickness)
    expected = brentq(lambda f: (9 * f**2 / (16 * young**2 * R)) ** (1 / 3) - taken * f - depth, 1e-9, 1.0)
    _, force = pressed(a / 16, 42, depth, **object_of(material) | {"thickness": thickness})
    assert -force[2] == pytest.approx(expected, rel=3e-3)
    assert -force[2] > 1.02 * 4 / 3 * young * np.sqrt(R) * depth**1.5


@pytest.mark.parametrize("case", DATA["cases"], ids=lambda c: f"{c['nu']} {c['object_E']} {c['object_nu']} {c['d']}")
def test_a_soft_ball_on_a_layer_agrees_with_finite_elements(case):
    cells = 128
    options = {"poisson_ratio": case["nu"], "thickness": DATA["h"], "displacement": False}
    if case["object_E"]:
        soft = {"object_young_modulus": case["object_E"], "object_poisson_ratio": case["object_nu"]}
        options |= soft | {"object_radius": DATA["R"]}
    assert (DATA["E"], DATA["R"]) == (E, R)
    _, force = pressed(3.2 * np.sqrt(R * case["d"]) / cells, cells, case["d"], **options)
    assert -force[2] == pytest.approx(case["F"], rel=8e-3)


def test_a_soft_object_slides_as_cattaneo_and_mindlin():
    """Equal materials, which pressure does not move apart: half of the compliance each."""
    nu, depth, mu = 0.3, 2e-5, 0.4
    a, shear = np.sqrt(R * depth), E / 2.6
    load = 4 / 3 * effective(nu, E, nu) * np.sqrt(R) * depth**1.5
    whole = 3 * mu * load * 2 * (2 - nu) / (16 * a * shear)
    slides = np.linspace(0, 0.5 * whole, 6)[1:]
    options = object_of((nu, E, nu)) | {"thickness": np.inf, "friction": mu, "coupled": True, "tolerance": 1e-5}
    _, force = pressed(a / 16, 42, depth, slides, **options)
    assert force[0] == pytest.approx(mu * load * (1 - 0.5**1.5), rel=5e-3)


def test_a_hard_object_of_finite_modulus_is_nearly_rigid_and_a_rigid_one_costs_nothing():
    soft, force = pressed(1e-4, 24, 1e-4, object_young_modulus=1e12)
    rigid, same = pressed(1e-4, 24, 1e-4)
    assert force == pytest.approx(same, rel=1e-5)
    np.testing.assert_allclose(soft.displacement, rigid.displacement, atol=1e-10)


def test_a_radius_without_a_modulus_is_refused_and_the_plan_names_the_modulus():
    with pytest.raises(SceneError, match="give object_young_modulus"):
        pressed(1e-4, 24, 1e-4, object_radius=R)
    scene = tt.Scene()
    x = np.linspace(-1e-3, 1e-3, 8)
    positions = np.stack([*np.meshgrid(x, x), np.zeros((8, 8))], -1)
    scene.add_sensor(
        tt.ElasticLayerTaxel(positions=positions, object_young_modulus=2e5), link=scene.add_body(name="pad")
    )
    assert "under objects of 200000 Pa" in str(scene.build().plan)
