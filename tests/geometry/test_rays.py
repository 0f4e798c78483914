"""Depth along the taxel's normal: where a line enters a shape, and that it keeps growing."""

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tests.geometry.test_primitives import CLOSED_FORMS, random_pose, to_body
from tests.sensors.rig import depth_of, scene_with

RADIUS = 3.0


def first_inside(truth, points, normals, reach):
    """Where the lines enter, by marching in steps of the exact distance from ``reach`` behind the points."""
    s = np.full(len(points), -reach)
    for _ in range(2000):
        gap = truth(points + s[:, None] * normals)
        s = np.where((gap > 0) & (s < RADIUS), s + np.maximum(gap, 1e-9), s)
        if (s > RADIUS).all():
            break
    return s


@pytest.mark.parametrize(("dtype", "tolerance"), [("float32", 1e-5), ("float64", 1e-7)])
@pytest.mark.parametrize("kind", CLOSED_FORMS)
def test_lines_enter_primitives_where_the_distance_says(kind, dtype, tolerance):
    shape, truth = CLOSED_FORMS[kind]
    rng = np.random.default_rng(11)
    points = rng.uniform(-1, 1, (400, 3))
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    position, quaternion = random_pose(rng)
    reach = 2.5
    ours = RADIUS - depth_of(
        shape, points, RADIUS, position=position, quaternion=quaternion, dtype=dtype,
        normals=normals, depth_query="ray", ray_reach=reach,
    )  # fmt: skip
    local = to_body(position, quaternion, points)
    turned = to_body(0 * position, quaternion, normals)
    expected = np.minimum(first_inside(truth, local, turned, reach), RADIUS)
    outside = truth(local - reach * turned) > 0
    ours, expected = ours[outside], expected[outside]
    grazing = np.abs(ours - expected) > 1e-3  # a line that only just hits or misses
    assert grazing.mean() < 0.01
    assert np.abs(ours - expected)[~grazing].max() < tolerance * 10


@pytest.mark.parametrize(
    "shape",
    [
        tt.Sphere(radius=0.01),
        tt.Box(size=(0.02, 0.02, 0.001)),
        tt.Cylinder(radius=0.01, length=0.001),
        tt.Capsule(radius=0.01, length=0.001),
        tt.Mesh(source=trimesh.creation.box((0.02, 0.02, 0.001))),
        tt.Mesh(source=trimesh.creation.torus(0.008, 0.002)),
    ],
    ids=lambda shape: type(shape).__name__,
)
def test_depth_along_the_normal_grows_with_every_micrometre(shape):
    """A 1 mm plate pressed 1.6 mm deep: to the nearest surface depth falls again, along the normal it goes on."""
    model = tt.ContactDepthProbe(positions=[[0.008, 0, 0.01]], radius=0.001, depth_query="ray")
    sim, body, skin = scene_with(shape, model, link_shape=tt.Box(size=(0.08, 0.08, 0.02)), dtype="float64")
    depths = []
    for pressed in np.arange(0.0, 4e-3, 50e-6):
        sim.set_pose(body, position=(0, 0, 0.0125 - pressed))
        sim.step()
        depths.append(skin.read()[0])
    touched = np.array(depths)[np.array(depths) > 0]
    assert len(touched) > 40
    assert np.abs(np.diff(touched) - 50e-6).max(initial=0) < 1e-6


PROBES = {"positions": [[0, 0, 0.01]], "radius": 1e-3, "depth_query": "ray"}
PAD = [[[x, y, 0.01] for x in (-1e-3, 0, 1e-3)] for y in (1e-3, 0, -1e-3)]
ALONG_THE_NORMAL = {
    "touch": tt.ContactProbe(**PROBES),
    "depth": tt.ContactDepthProbe(**PROBES),
    "spring": tt.KinematicTaxel(**PROBES, normal_damping=0.0),
    "layer": tt.ElasticLayerTaxel(positions=PAD, friction=0.0),
}


def felt(model, shape, height):
    """The largest of what a model on a plate reads (touch, depth, force [N]); the plate's top is at z = 10 mm."""
    sim, body, skin = scene_with(shape, model, link_shape=tt.Box(size=(0.08, 0.08, 0.02)), dtype="float64")
    sim.set_pose(body, position=(0, 0, height))
    sim.step()
    reading = skin.read()
    return np.abs(getattr(reading, "force", reading)).max()


@pytest.mark.parametrize("model", ALONG_THE_NORMAL)
@pytest.mark.parametrize("shape", [tt.Sphere(radius=0.02), tt.Mesh(source=trimesh.creation.icosphere(3, radius=0.02))])
@pytest.mark.parametrize("top", [-0.011, -0.009, 0.0, 0.0065])
def test_what_comes_from_behind_and_has_not_reached_the_skin_is_not_felt(model, shape, top):
    assert felt(ALONG_THE_NORMAL[model], shape, top - 0.02) == 0.0


@pytest.mark.parametrize("model", ALONG_THE_NORMAL)
def test_what_sinks_into_a_thick_link_goes_on_being_felt(model):
    """A ball of 2 mm, 3 to 17 mm deep: deeper than the layer of 4 mm, and still inside the link."""
    readings = [
        felt(ALONG_THE_NORMAL[model], tt.Sphere(radius=1e-3), 0.01 + 1e-3 - deep) for deep in (3e-3, 7e-3, 0.017)
    ]
    if model == "touch":
        assert readings == [1, 1, 1]
    else:
        assert readings[0] > 0 and np.all(np.diff(readings) > 0)


def test_springs_push_along_the_taxels_own_normal():
    options = {"positions": [[0, 0, 0]], "radius": 1e-3, "normal_stiffness": 100.0}
    model = tt.KinematicTaxel(**options, depth_query="ray", shear_scalar=0, twist_scalar=0, normal_damping=0)
    tilt = (np.cos(0.2), np.sin(0.2), 0, 0)
    sim, body, skin = scene_with(tt.Plane(), model)
    sim.set_pose(body, position=(0, 0, -2e-3), quaternion=(0, 1, 0, 0))
    sim.step()
    assert skin.read().force[0] == pytest.approx([0, 0, -0.3], abs=1e-6)
    sim.set_pose(body, position=(0, 0, -2e-3), quaternion=(-tilt[1], tilt[0], 0, 0))
    sim.step()
    force = skin.read().force[0]
    assert force[0] == 0 and force[1] == 0 and force[2] < 0
