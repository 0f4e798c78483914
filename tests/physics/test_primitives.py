"""Signed distances of primitives against closed forms, and their normals against finite differences."""

import numpy as np
import pytest
import warp as wp

from tactemu import Box, Capsule, ContactDepthProbe, Cylinder, Plane, Scene, Sphere

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
@pytest.mark.parametrize(("dtype", "tolerance"), [("float32", 1e-6), ("float64", 1e-14)])
def test_distance_is_exact(kind, dtype, tolerance):
    shape, truth = CLOSED_FORMS[kind]
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (4000, 3))
    scene = Scene()
    link = scene.add_body(fixed=True)
    body = scene.add_body(shape)
    probe = scene.add_sensor(ContactDepthProbe(probe_local_pos=points, probe_radius=OFFSET), link=link)
    sim = scene.build(dtype=dtype)
    for _ in range(3):
        position, quaternion = random_pose(rng)
        sim.set_pose(body, position=position, quaternion=quaternion)
        sim.step()
        expected = np.maximum(OFFSET - truth(to_body(position, quaternion, points)), 0)
        assert np.abs(probe.read() - expected).max() < tolerance * OFFSET
    wp.synchronize()
