"""Steering by hand: how far bodies reach, and ways that are continuous."""

import numpy as np
import pytest
import trimesh

from tactemu import Box, Capsule, Cylinder, Mesh, Sphere
from tactemu.base.errors import SceneError
from tactemu.geometry import rotation
from tactemu.geometry.motion import Pose
from tactemu.scene.scene import Scene
from tactemu.scene.steering import Steered, Waypoint, press_path, reach


def _capsule() -> trimesh.Trimesh:
    """The hull of two balls."""
    balls = [
        trimesh.creation.icosphere(subdivisions=5, radius=0.004).apply_translation((0, 0, z)) for z in (-0.01, 0.01)
    ]
    return trimesh.util.concatenate(balls).convex_hull


SHAPES = {
    # shape, and what makes its mesh
    "sphere": (Sphere(radius=0.01), lambda: trimesh.creation.icosphere(subdivisions=5, radius=0.01)),
    "box": (Box(size=(0.01, 0.02, 0.03)), lambda: trimesh.creation.box(extents=(0.01, 0.02, 0.03))),
    "capsule": (Capsule(radius=0.004, length=0.02), _capsule),
    "cylinder": (Cylinder(radius=0.004, length=0.02), lambda: trimesh.creation.cylinder(0.004, 0.02, sections=512)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_reach_is_that_of_the_shapes_mesh(name):
    shape, make_mesh = SHAPES[name]
    mesh = make_mesh()
    rng = np.random.default_rng(0)
    body = Scene().add_body(shape)
    twin = Scene().add_body(Mesh(source=mesh))
    for _ in range(20):
        turn = rotation.normalised(rng.normal(size=4))
        d = rng.normal(size=3)
        d /= np.linalg.norm(d)
        farthest = (rotation.rotate(turn, mesh.vertices - mesh.bounds.mean(axis=0)) @ d).max()
        assert reach(body, turn, d) == pytest.approx(farthest, abs=2e-5)
        offset = rotation.rotate(turn, mesh.bounds.mean(axis=0)) @ d
        assert reach(twin, turn, d) == pytest.approx(farthest + offset, abs=1e-9)


def test_a_frame_has_no_reach():
    with pytest.raises(SceneError, match="it has no shape"):
        reach(Scene().add_body(name="frame"), np.array(rotation.IDENTITY), np.array((0, 0, 1.0)))


def test_a_way_changed_while_it_is_gone_has_no_jump():
    motion = Steered((0, 0, 1), (1, 0, 0, 0))
    end = motion.follow(0.5, [Waypoint(1.0, np.array((1, 0, 1.0)), np.array((0, 0, 0, 1.0)))])
    assert end == 1.5
    np.testing.assert_allclose(motion.world(0.2).position, (0, 0, 1))
    before = motion.world(1.0)
    np.testing.assert_allclose(before.position, (0.5, 0, 1))
    np.testing.assert_allclose(rotation.rotate(before.quaternion, (1, 0, 0)), (0, 1, 0), atol=1e-12)
    motion.follow(1.0, [Waypoint(1.0, np.array((0, 0, 0.0)))])
    after = motion.world(1.0)
    np.testing.assert_allclose(after.position, before.position)
    np.testing.assert_allclose(np.abs(after.quaternion @ before.quaternion), 1.0)
    np.testing.assert_allclose(after.linear_velocity, (-0.5, 0, -1))


@pytest.mark.parametrize("normal", [(0, 0, 1.0), (0.6, 0, 0.8), (0, -1.0, 0)])
def test_a_press_ends_at_its_depth_and_never_enters_the_skin_on_its_way(normal):
    normal = np.array(normal)
    body = Scene().add_body(Sphere(radius=0.01), position=(0.03, 0.02, -0.01))
    target = np.array((0.005, -0.004, 0.002))
    here = Pose(np.array(body.position))
    legs, over = press_path(body, here, target, normal, depth=1e-3, approach=2e-3, clearance=1e-3, speed=0.05)
    gaps = [float((leg.position - target) @ normal) - 0.01 for leg in legs]
    assert gaps[-1] == pytest.approx(-1e-3)
    assert min(gaps[:-1]) >= 2e-3 - 1e-12
    assert (over - target) @ normal - 0.01 == pytest.approx(2e-3)
