"""Signed distances of primitives against closed forms, and their normals against finite differences."""

import numpy as np
import pytest

from tactemu import Box, Capsule, ContactDepthProbe, Cylinder, KinematicTaxel, Plane, Scene, Sphere

OFFSET = 5.0
"""A probe of this radius reads OFFSET - distance for all points nearer than it."""


def sphere(p):
    return np.linalg.norm(p, axis=-1) - 0.7


def box(p):
    q = np.abs(p) - np.array([0.5, 0.35, 0.2])
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


def capsule(p):
    axis = np.stack([0 * p[..., 0], 0 * p[..., 0], np.clip(p[..., 2], -0.4, 0.4)], -1)
    return np.linalg.norm(p - axis, axis=-1) - 0.3


def cylinder(p):
    q = np.stack([np.hypot(p[..., 0], p[..., 1]) - 0.3, np.abs(p[..., 2]) - 0.4], -1)
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


CLOSED_FORMS = {
    "sphere": (Sphere(radius=0.7), sphere),
    "box": (Box(size=(1.0, 0.7, 0.4)), box),
    "capsule": (Capsule(radius=0.3, length=0.8), capsule),
    "cylinder": (Cylinder(radius=0.3, length=0.8), cylinder),
    "plane": (Plane(), lambda p: p[..., 2]),
}


def random_pose(rng):
    q = rng.normal(size=4)
    return rng.uniform(-0.5, 0.5, 3), q / np.linalg.norm(q)


def to_body(position, quaternion, points):
    w, u = quaternion[0], -quaternion[1:]
    v = points - position
    t = 2 * np.cross(np.broadcast_to(u, v.shape), v)
    return v + w * t + np.cross(np.broadcast_to(u, v.shape), t)


@pytest.mark.parametrize("kind", CLOSED_FORMS)
@pytest.mark.parametrize(("dtype", "tolerance"), [("float32", 1e-6), ("float64", 1e-14 * OFFSET)])
def test_distance_is_exact(kind, dtype, tolerance):
    shape, truth = CLOSED_FORMS[kind]
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (4000, 3))
    scene = Scene()
    link = scene.add_body(fixed=True)
    body = scene.add_body(shape)
    probe = scene.add_sensor(ContactDepthProbe(positions=points, radius=OFFSET), link=link)
    sim = scene.build(dtype=dtype)
    for _ in range(3):
        position, quaternion = random_pose(rng)
        sim.set_pose(body, position=position, quaternion=quaternion)
        sim.step()
        expected = np.maximum(OFFSET - truth(to_body(position, quaternion, points)), 0)
        assert np.abs(probe.read() - expected).max() < tolerance


@pytest.mark.parametrize("kind", CLOSED_FORMS)
def test_normals_are_gradients_of_the_distance(kind):
    shape, truth = CLOSED_FORMS[kind]
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (3000, 3))
    scene = Scene()
    link = scene.add_body(fixed=True)
    body = scene.add_body(shape)
    only_normal = {"normal_stiffness": 1.0, "normal_damping": 0.0, "shear_scalar": 0.0, "twist_scalar": 0.0}
    springs = KinematicTaxel(positions=points, radius=OFFSET, **only_normal)
    skin = scene.add_sensor(springs, link=link)
    sim = scene.build(dtype="float64")
    position, quaternion = random_pose(rng)
    sim.set_pose(body, position=position, quaternion=quaternion)
    sim.step()
    force = skin.read().force
    normal = force / np.linalg.norm(force, axis=1, keepdims=True)
    step = 1e-6
    gradient = np.stack(
        [
            truth(to_body(position, quaternion, points + step * axis))
            - truth(to_body(position, quaternion, points - step * axis))
            for axis in np.eye(3)
        ],
        -1,
    ) / (2 * step)
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-6  # else two surfaces are equally near
    assert smooth.mean() > 0.99
    assert np.abs(normal - gradient)[smooth].max() < 1e-6
