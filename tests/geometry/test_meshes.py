"""Distances to meshes: signs, tessellation error, and what is refused, mended or warned about."""

import logging

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base.errors import MeshError
from tactemu.geometry.shapes.triangles import load_mesh
from tests.sensors.genesis_case import DATA
from tests.sensors.rig import depth_of

RADIUS = 4.0


def sharp_cone(sides=12, half_angle=10.0):
    rim = np.tan(np.radians(half_angle))
    angle = 2 * np.pi * np.arange(sides) / sides
    vertices = np.vstack([np.c_[rim * np.cos(angle), rim * np.sin(angle), 0 * angle], [0, 0, 1], [0, 0, 0]])
    side = [[i, (i + 1) % sides, sides] for i in range(sides)]
    base = [[(i + 1) % sides, i, sides + 1] for i in range(sides)]
    return trimesh.Trimesh(vertices, side + base, process=False)


def distance(mesh, points):
    return RADIUS - depth_of(tt.Mesh(source=mesh), points, RADIUS)


@pytest.mark.parametrize("span", [0.3, 1e-3])
def test_no_wrong_sign_at_a_sharp_cone(span):
    cone = sharp_cone()
    rng = np.random.default_rng(0)
    points = np.array([0, 0, 1.0]) + rng.uniform(-span, span, (40000, 3))
    gap = np.einsum("pfk,fk->pf", points[:, None] - cone.triangles[None, :, 0], cone.face_normals).max(1)
    clear = np.abs(gap) > 4e-7  # float32 of a point at z = 1
    wrong = (distance(cone, points) < 0) != (gap < 0)
    assert wrong[clear].mean() < 1e-4


@pytest.mark.parametrize(("subdivisions", "error"), [(3, 4.6e-3), (4, 1.2e-3)])
def test_icosphere_is_right_to_its_tessellation(subdivisions, error):
    points = np.random.default_rng(1).uniform(-1.3, 1.3, (20000, 3))
    truth = np.linalg.norm(points, axis=1) - 1.0
    ours = distance(trimesh.creation.icosphere(subdivisions), points)
    assert np.abs(ours - truth).max() < error
    assert not ((ours < 0) != (truth < 0))[np.abs(truth) > error].any()


def test_torus_is_right_to_its_tessellation():
    points = np.random.default_rng(2).uniform(-1.4, 1.4, (20000, 3))
    truth = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3
    ours = distance(trimesh.creation.torus(1.0, 0.3, 96, 96), points)
    assert np.abs(ours - truth).max() < 1.5e-3
    assert not ((ours < 0) != (truth < 0))[np.abs(truth) > 1.5e-3].any()


def test_a_box_mesh_is_a_box():
    points = np.random.default_rng(3).uniform(-1, 1, (5000, 3))
    ours = depth_of(tt.Mesh(source=trimesh.creation.box((1.0, 0.7, 0.4))), points, RADIUS)
    exact = depth_of(tt.Box(size=(1.0, 0.7, 0.4)), points, RADIUS)
    assert np.abs(ours - exact).max() < 2e-6


def test_an_open_box_warns_and_encloses(caplog):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    opened = trimesh.Trimesh(box.vertices, box.faces[np.abs(box.face_normals[:, 2] - 1) > 0.5], process=False)
    with caplog.at_level(logging.WARNING):
        inside, outside = distance(opened, [[0, 0, 0], [0, 0, 0.9]])
    assert inside == pytest.approx(-0.5, abs=1e-5) and outside == pytest.approx(np.hypot(0.5, 0.4), abs=1e-5)
    assert "not closed (4 edges" in caplog.text


def test_inside_out_is_turned_round(caplog):
    ball = trimesh.creation.icosphere(2)
    with caplog.at_level(logging.WARNING):
        inverted = distance((ball.vertices, ball.faces[:, ::-1]), [[0, 0, 0.5]])
    assert inverted == distance(ball, [[0, 0, 0.5]]) and inverted < 0
    assert "inside out" in caplog.text


def test_vertices_repeated_per_triangle_are_one_surface(tmp_path):
    ball = trimesh.creation.icosphere(2)
    path = tmp_path / "ball.stl"
    ball.export(path)
    assert load_mesh(path).closed
    soup = (ball.triangles.reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3))
    assert load_mesh(soup).closed


def test_triangles_without_area_change_nothing(caplog):
    # a vertex in the middle of an edge, with the sliver that closes the surface again
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    a, b, c = box.faces[0]
    vertices = np.vstack([box.vertices, 0.5 * (box.vertices[a] + box.vertices[b])])
    m = len(vertices) - 1
    faces = np.vstack([box.faces[1:], [[a, m, c], [m, b, c], [a, b, m], [a, a, b]]])
    points = np.random.default_rng(4).uniform(-1, 1, (2000, 3))
    with caplog.at_level(logging.WARNING):
        ours = distance((vertices, faces), points)
    assert "2 of 15 triangles have no area" in caplog.text and "not closed" not in caplog.text
    assert np.abs(ours - distance(box, points)).max() < 1e-6


def test_scale_is_metres_per_unit():
    ball = trimesh.creation.icosphere(3, radius=10.0)
    small = depth_of(tt.Mesh(source=ball, scale=1e-3), [[0, 0, 0.011]], 0.002)
    assert small == pytest.approx(0.001, abs=2e-5)
    oval = depth_of(tt.Mesh(source=ball, scale=(1e-3, 1e-3, 2e-3)), [[0, 0, 0.021]], 0.002)
    assert oval == pytest.approx(0.001, abs=2e-5)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e3])
def test_any_scale_reads_the_same(unit):
    ball = trimesh.creation.icosphere(3)
    points = np.random.default_rng(5).uniform(-1.2, 1.2, (500, 3))
    ours = depth_of(tt.Mesh(source=ball, scale=unit), points * unit, 0.5 * unit)
    assert np.abs(ours / unit - depth_of(tt.Mesh(source=ball), points, 0.5)).max() < 1e-5


def bad_meshes():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    nan = box.vertices.copy()
    nan[3, 1] = np.nan
    against = box.faces.copy()
    against[0] = against[0, ::-1]
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    return {
        "no such file": ("missing.stl", 1.0),
        "vertex 3 is not finite": ((nan, box.faces), 1.0),
        "wound against each other": ((box.vertices, against), 1.0),
        "no triangle has an area": ((line, [[0, 1, 2]]), 1.0),
        "scale must be > 0": (box, -1.0),
        "faces must name vertices 0..7": ((box.vertices, box.faces + 1), 1.0),
        r"expected \(n, 3\) vertices": ((box.vertices, np.zeros((0, 3), int)), 1.0),
        "expected a path": (3.0, 1.0),
    }


@pytest.mark.parametrize("message", bad_meshes())
def test_unusable_meshes_are_refused_by_name(message):
    source, scale = bad_meshes()[message]
    with pytest.raises(MeshError, match=message) as error:
        depth_of(tt.Mesh(source=source, scale=scale), [[0, 0, 0]], 1.0)
    assert "'body'" in str(error.value)


def test_a_file_that_is_no_mesh_is_refused(tmp_path):
    path = tmp_path / "broken.stl"
    path.write_text("solid nothing\nendsolid nothing\n")
    with pytest.raises(MeshError, match=r"broken\.stl"):
        depth_of(tt.Mesh(source=path), [[0, 0, 0]], 1.0)


def test_distances_are_those_of_libigl():
    """Genesis's grid of a non-convex mesh: 32768 signed distances that libigl computed."""
    arrays = np.load(DATA / "c10_contact.npz")
    to_index = arrays["g1_sdf_T"]
    nodes = np.stack(np.meshgrid(*map(np.arange, arrays["g1_sdf_val"].shape), indexing="ij"), -1).reshape(-1, 3)
    points = (nodes - to_index[:3, 3]) / np.diag(to_index)[:3]
    theirs = arrays["g1_sdf_val"].reshape(-1)
    blob = tt.Mesh(source=(arrays["g1_verts"], arrays["g1_faces"]))
    ours = 0.1 - depth_of(blob, points, 0.1)
    assert not ((ours < 0) != (theirs < 0))[np.abs(theirs) > 1e-7].any()
    assert np.abs(ours - theirs).max() < 2e-8
