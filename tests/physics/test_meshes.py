"""Distances to meshes: signs, tessellation error, and what is refused, mended or warned about."""

import logging

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.errors import MeshError
from tactemu.physics.shapes.triangles import load_mesh
from tests.physics.genesis_case import DATA
from tests.physics.rig import depth_of, scene_with

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
    """The seed's grid of a non-convex mesh: 32768 signed distances that libigl computed."""
    arrays = np.load(DATA / "c10_contact.npz")
    to_index = arrays["g1_sdf_T"]
    nodes = np.stack(np.meshgrid(*map(np.arange, arrays["g1_sdf_val"].shape), indexing="ij"), -1).reshape(-1, 3)
    points = (nodes - to_index[:3, 3]) / np.diag(to_index)[:3]
    theirs = arrays["g1_sdf_val"].reshape(-1)
    blob = tt.Mesh(source=(arrays["g1_verts"], arrays["g1_faces"]))
    ours = 0.1 - depth_of(blob, points, 0.1)
    assert not ((ours < 0) != (theirs < 0))[np.abs(theirs) > 1e-7].any()
    assert np.abs(ours - theirs).max() < 2e-8


def normals(shape, points, radius):
    """Unit normals that springs feel at points of the body's frame, in float64."""
    springs = {"normal_stiffness": 1.0, "normal_damping": 0.0, "shear_scalar": 0.0, "twist_scalar": 0.0}
    sim, _, skin = scene_with(
        shape, tt.KinematicTaxel(probe_local_pos=points, probe_radius=radius, **springs), dtype="float64"
    )
    sim.step()
    force = skin.read().force
    return force / np.linalg.norm(force, axis=1, keepdims=True)


@pytest.mark.parametrize("gap", [1e-6, 50e-9, 1e-9, 0.0, -50e-9])
@pytest.mark.parametrize("mesh", [trimesh.creation.box((0.04,) * 3), trimesh.creation.icosphere(3, radius=0.02)])
def test_near_a_face_its_normal_and_its_plane_are_felt(mesh, gap):
    rng = np.random.default_rng(6)
    face = rng.integers(0, len(mesh.faces), 300)
    weights = rng.dirichlet((4.0, 4.0, 4.0), 300)
    corners, expected = mesh.triangles[face], np.cross(*np.moveaxis(np.diff(mesh.triangles[face], axis=1), 1, 0))
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    points = np.einsum("ik,ikx->ix", weights, corners) + gap * expected
    shape = tt.Mesh(source=mesh)
    assert np.abs(normals(shape, points, 1e-3) - expected).max() < 1e-9
    depth = depth_of(shape, points, 1e-3, dtype="float64")
    assert np.abs(depth - (1e-3 - gap)).max() < 1e-15


def test_lines_enter_a_mesh_where_its_faces_are():
    points = np.random.default_rng(8).uniform(-0.019, 0.019, (200, 3)) * (1, 1, 0) + (0, 0, -0.0205)
    ray = {"contact_depth_query": "ray", "dtype": "float64"}
    ours = depth_of(tt.Mesh(source=trimesh.creation.box((0.04,) * 3)), points, 1e-3, **ray)
    assert ours == pytest.approx(depth_of(tt.Box(size=(0.04,) * 3), points, 1e-3, **ray), abs=1e-15)


@pytest.mark.parametrize("query", [None, "ray"])
def test_a_mesh_far_from_its_bodys_origin_keeps_its_digits(query):
    """A box whose file puts it 10 m away, seen by a skin that is where the box is."""
    box = trimesh.creation.box((0.04, 0.04, 0.04))
    rng = np.random.default_rng(7)
    turn = np.array((0.5, 0.5, 0.5, 0.5))  # x to y, y to z, z to x
    points = np.column_stack([rng.uniform(-0.03, 0.03, (200, 2)), rng.uniform(-0.0215, -0.0205, 200)])
    near = depth_of(tt.Mesh(source=box), points, 1e-3, contact_depth_query=query)
    away = box.copy().apply_translation((10.0, 0.0, 0.0))
    shape = tt.Mesh(source=away)
    ours = depth_of(shape, points, 1e-3, position=(0, -10.0, 0), quaternion=turn, contact_depth_query=query)
    assert near.any() and np.abs(ours - near).max() < 4e-8


def test_points_on_a_far_mesh_keep_their_digits():
    readings = []
    for shift in (0.0, 10.0):
        box = trimesh.creation.box((0.04, 0.04, 0.04)).apply_translation((shift, 0, 0))
        points = [[0.001 * x + shift, 0.001 * y, -0.02] for x in range(5) for y in range(5)]
        model = tt.ProximityTaxel(probe_local_pos=[[0.001, 0.001, 0]], probe_radius=0.003, points=points)
        sim, body, skin = scene_with(tt.Mesh(source=box), model)
        sim.set_pose(body, position=(-shift, 0, 0.019))
        sim.step()
        readings.append(skin.read().force[0])
    assert readings[0][2] != 0 and np.abs(readings[1] - readings[0]).max() < 1e-6 * np.abs(readings[0]).max()


def test_a_skin_on_a_far_mesh_looks_through_it():
    """The link is a box that its file puts 10 m away: a ball sinks into it, and is felt as far as the box goes."""
    box = trimesh.creation.box((0.04, 0.04, 0.02)).apply_translation((10.0, 0, 0))
    at = {"probe_local_pos": [[10.0, 0, 0.01]], "probe_radius": 1e-3, "contact_depth_query": "ray"}
    sim, ball, skin = scene_with(tt.Sphere(radius=1e-3), tt.ContactDepthProbe(**at), link_shape=tt.Mesh(source=box))
    depths = []
    for z in (0.01, 0.0, -0.008, -0.02):
        sim.set_pose(ball, position=(10.0, 0, z))
        sim.step()
        depths.append(skin.read()[0])
    assert depths == pytest.approx([2e-3, 12e-3, 20e-3, 0.0], abs=2e-6)
