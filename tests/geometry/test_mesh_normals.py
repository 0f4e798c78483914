"""Normals and sides of meshes near faces, edges and thin walls, against convex polyhedra in extended precision."""

import functools
import logging

import numpy as np
import pytest
import trimesh
import warp as wp

import tactemu as tt
from tactemu.geometry.shapes.distance import shape_functions
from tactemu.geometry.shapes.mesh import MESH, OPEN_MESH
from tactemu.geometry.shapes.shape import table_type
from tests.sensors.rig import depth_of

REALS = {"float32": wp.float32, "float64": wp.float64}


@functools.cache
def distance_kernel(real, kinds):
    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    distance = shape_functions(real, kinds).distance

    @wp.kernel(module="unique", enable_backward=False)
    def distances(
        shapes: shapes_type, b: int, points: wp.array(dtype=vec3), out: wp.array(dtype=real), way: wp.array(dtype=vec3)
    ):
        i = wp.tid()
        d, n = distance(shapes, b, points[i])
        out[i] = d
        way[i] = n

    return distances


def table_of(mesh, dtype):
    scene = tt.Scene()
    body = scene.add_body(tt.Mesh(source=mesh), name="tool")
    pad = scene.add_body(name="pad")
    scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3), link=pad)
    return scene.build(dtype=dtype)._compiler._shapes.table((body,)), body.index


@pytest.fixture(autouse=True)
def on_the_cpu():
    """Launch where the scenes of these tests are, on a machine with a GPU too."""
    with wp.ScopedDevice("cpu"):
        yield


def ask(mesh, points, dtype):
    """Distances and normals, and the points as the scene's float type has them."""
    table, b = table_of(mesh, dtype)
    real = REALS[dtype]
    given = wp.array(points, dtype=wp.types.vector(3, real))
    d, n = wp.zeros(len(points), dtype=real), wp.zeros(len(points), dtype=given.dtype)
    kernel = distance_kernel(real, table.kinds)
    wp.launch(kernel, dim=len(points), inputs=[table.struct, b, given], outputs=[d, n])
    return d.numpy().astype(float), n.numpy().astype(float), given.numpy().astype(float)


def truth(mesh, points):
    """Distance and normal of a convex mesh, each face in turn, in extended precision."""
    corners, points = np.asarray(mesh.triangles, np.longdouble), points.astype(np.longdouble)
    least = np.full(len(points), np.inf, np.longdouble)
    nearest, highest = np.zeros_like(points), np.full(len(points), -np.inf, np.longdouble)
    for corner in corners:
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        normal /= np.sqrt(normal @ normal)
        height = (points - corner[0]) @ normal
        highest = np.maximum(highest, height)
        gap, beyond = height[:, None] * normal, np.full(len(points), np.inf, np.longdouble)
        for start, way in zip(corner, np.roll(corner, -1, axis=0) - corner):
            here = points - start
            here = here - np.clip(here @ way / (way @ way), 0, 1)[:, None] * way
            size = np.sqrt((here**2).sum(1))
            which = ((points - start) @ np.cross(normal, way) < 0) & (size < beyond)
            gap[which], beyond[which] = here[which], size[which]
        size = np.sqrt((gap**2).sum(1))
        closer = size < least
        least[closer], nearest[closer] = size[closer], gap[closer]
    sign = np.where(highest < 0, -1, 1)
    return (sign * least).astype(float), (sign[:, None] * nearest / least[:, None]).astype(float)


def wedge():
    """20 degrees."""
    y, z = 0.02, 0.02 * np.tan(np.radians(10))
    ends = [[(0, s * y, z), (0, s * y, -z), (0.02, s * y, 0)] for s in (-1, 1)]
    return trimesh.convex.convex_hull(np.concatenate(ends))


MESHES = {
    "box": lambda: trimesh.creation.box((0.04, 0.03, 0.02)),
    "ball": lambda: trimesh.creation.icosphere(2, radius=0.01),
    "wedge": wedge,
}


def probes(mesh, height, n=150):
    """Over faces and under them, and beyond edges and vertices."""
    rng = np.random.default_rng(0)
    corners, normals = np.asarray(mesh.triangles), mesh.face_normals
    face, edge, vertex = (rng.integers(0, k, n) for k in (len(corners), len(mesh.face_adjacency), len(mesh.vertices)))
    over = np.einsum("nc,ncx->nx", rng.dirichlet((0.3, 0.3, 0.3), n), corners[face])
    under = np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), n), corners[face])
    ends, beside = mesh.vertices[mesh.face_adjacency_edges[edge]], normals[mesh.face_adjacency[edge]]
    t, u = rng.random((2, n, 1))
    between = u * beside[:, 0] + (1 - u) * beside[:, 1]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    faces = np.concatenate([over + height * normals[face], under - 0.5 * height * normals[face]])
    edges = ends[:, 0] * t + ends[:, 1] * (1 - t) + height * between
    return faces, np.concatenate([edges, mesh.vertices[vertex] + height * mesh.vertex_normals[vertex]])


@pytest.mark.parametrize("height", [1e-8, 1e-6, 1e-5, 1e-3])
@pytest.mark.parametrize("name", MESHES)
def test_normals_near_faces_edges_and_vertices(name, height):
    mesh = MESHES[name]()
    for points, in_float32 in zip(probes(mesh, height), (1e-3 if height >= 1e-6 else 0.05, 5e-9 / height)):
        for dtype, angle, off in (("float64", 1e-6, 1e-16), ("float32", min(in_float32, 0.5), 3e-9)):
            d, n, given = ask(mesh, points, dtype)
            right, way = truth(mesh, given)
            np.testing.assert_allclose(d, right, rtol=0, atol=off)
            assert np.linalg.norm(n - way, axis=1).max() < angle


def balls(*radii_and_places, turned=()):
    parts = [trimesh.creation.icosphere(3, radius=r).apply_translation((x, 0, 0)) for r, x in radii_and_places]
    faces = [part.faces[:, ::-1] if k in turned else part.faces for k, part in enumerate(parts)]
    both = trimesh.util.concatenate([trimesh.Trimesh(p.vertices, f, process=False) for p, f in zip(parts, faces)])
    return parts, (both.vertices, both.faces)


def height_over(part, points):
    blocks = np.array_split(points, 40)
    corner, normals = part.triangles[:, 0], part.face_normals
    return np.concatenate([np.einsum("pfx,fx->pf", b[:, None] - corner, normals).max(1) for b in blocks])


@pytest.mark.parametrize("dtype", REALS)
@pytest.mark.parametrize("wall", [1e-3, 1e-4])
def test_a_thin_wall_has_no_wrong_side(wall, dtype, caplog):
    rng = np.random.default_rng(1)
    (outer, inner), mesh = balls((0.01, 0), (0.01 - wall, 0), turned=(1,))
    way = rng.normal(size=(20000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    points = way * ((0.01 - wall * rng.uniform(-0.5, 1.5, 20000)) * rng.uniform(0.996, 1.0, 20000))[:, None]
    d, _n, given = ask(mesh, points, dtype)
    side = np.maximum(height_over(outer, given), -height_over(inner, given))
    clear = np.abs(side) > (1e-8 if dtype == "float32" else 1e-14)
    assert not ((d < 0) != (side < 0))[clear].any()
    assert table_of(mesh, dtype)[0].rows[0].kind is MESH and not caplog.text


@pytest.mark.parametrize("second", [(0.01, 0.01), (0.006, 0.0)], ids=["intersecting", "nested"])
def test_shells_within_each_other_have_the_right_side_and_are_named(second, caplog):
    parts, mesh = balls((0.01, 0), second)
    rng = np.random.default_rng(2)
    points = np.concatenate([p.sample(1000, seed=0) for p in parts]) + rng.normal(0, 5e-4, (2000, 3))
    with caplog.at_level(logging.WARNING):
        d, _n, given = ask(mesh, points, "float32")
    side = np.minimum(*(height_over(part, given) for part in parts))
    assert not ((d < 0) != (side < 0))[np.abs(side) > 1e-8].any()
    assert caplog.text.count("2 closed shells") == 1
    assert table_of(mesh, "float32")[0].rows[0].kind is OPEN_MESH


@pytest.mark.parametrize("query", ["sdf", "band", "voxel"])
def test_depth_inside_of_shells_that_intersect_is_to_the_surface_of_their_union(query):
    """4 mm off the middle of one of two balls 10 mm apart it was 4 mm, to a face within the other; 6 mm are right."""
    _parts, mesh = balls((0.01, 0), (0.01, 0.01))
    more = {"voxel_size": 4e-4} if query == "voxel" else {}
    points = [[-4e-3, 0, 0], [0, 6e-3, 0], [0.014, 0, 0]]
    depth = depth_of(tt.Mesh(source=mesh), points, 1e-3, depth_query=query, **more)
    np.testing.assert_allclose(depth, [7e-3, 5e-3, 7e-3], atol=6e-5)  # of polyhedra with 1280 faces


@pytest.mark.parametrize("dtype", REALS)
def test_depth_inside_of_nested_shells_is_to_the_outer_one(dtype):
    parts, mesh = balls((0.01, 0), (0.006, 0))
    points = np.random.default_rng(4).uniform(-0.01, 0.01, (1000, 3))
    d, _n, given = ask(mesh, points, dtype)
    outer, _way = truth(parts[0], given)
    np.testing.assert_allclose(d, outer, atol=5e-9)


def test_depth_near_where_shells_meet_is_off_by_a_face_at_most():
    parts, mesh = balls((0.01, 0), (0.01, 0.01))
    rng = np.random.default_rng(6)
    points = rng.uniform([-0.01, -0.01, -0.01], [0.02, 0.01, 0.01], (4000, 3))
    middles = np.array([[0, 0, 0], [0.01, 0, 0]])
    way = points[:, None] - middles
    far = np.linalg.norm(way, axis=2)
    points, way, far = (each[(far < 0.0099).any(1)] for each in (points, way, far))
    foot = middles + 0.01 * way / far[..., None]
    seen = np.linalg.norm(foot[:, :, None] - middles, axis=-1).min(-1) > 0.01 - 1e-12
    ring = np.hypot(points[:, 0] - 0.005, np.linalg.norm(points[:, 1:], axis=1) - np.sqrt(0.75e-4))
    right = np.minimum(ring, np.where(seen & (far < 0.01), 0.01 - far, np.inf).min(1))
    d, _n, _given = ask(mesh, points, "float64")
    short = right + d
    assert short.min() > -1e-4 and short.max() < parts[0].edges_unique_length.max()
    assert np.mean(np.abs(short) < 6e-5) > 0.7


def test_shells_side_by_side_are_no_matter(caplog):
    _parts, mesh = balls((0.01, 0), (0.01, 0.0205))
    assert table_of(mesh, "float32")[0].rows[0].kind is MESH and not caplog.text


@pytest.mark.parametrize("away", [1, 10, 100])
def test_a_mesh_far_from_its_origin_is_as_near_it(away):
    box, far = trimesh.creation.box((0.04, 0.04, 0.04)), np.array([away, 0.7 * away, -0.3 * away])
    points = np.c_[np.random.default_rng(0).uniform(-0.019, 0.019, (300, 2)), np.full(300, 0.02 + 1e-6)]
    d, n, _given = ask((box.vertices + far, box.faces), points + far, "float64")
    np.testing.assert_allclose(d, 1e-6, atol=4e-16 * away)
    np.testing.assert_allclose(n, np.broadcast_to([0, 0, 1], n.shape), atol=1e-9)


def test_slivers_between_faces_leave_side_and_normal_right():
    """A wedge, on whose sharp edge one face has a vertex more, with the triangle without area that closes it."""
    mesh = wedge()
    sharp = [k for k, p in enumerate(mesh.vertices) if p[0] > 0.01]
    face = next(k for k, f in enumerate(mesh.faces) if set(sharp) <= set(f))
    a, b, c = next(
        np.roll(mesh.faces[face], -k) for k in range(3) if set(np.roll(mesh.faces[face], -k)[:2]) == set(sharp)
    )
    middle = len(mesh.vertices)
    vertices = np.vstack([mesh.vertices, 0.5 * (mesh.vertices[a] + mesh.vertices[b])])
    faces = np.vstack([np.delete(mesh.faces, face, axis=0), [[a, middle, c], [middle, b, c], [a, b, middle]]])
    points = np.array([0.02, 0, 0]) + np.random.default_rng(3).uniform(-1e-3, 1e-3, (4000, 3))
    d, n, _given = ask((vertices, faces), points, "float64")
    right, way = truth(mesh, points)
    np.testing.assert_allclose(d, right, atol=1e-15)
    np.testing.assert_allclose(n, way, atol=1e-6)


@pytest.mark.parametrize(("dtype", "said"), [("float32", 1), ("float64", 0)])
def test_a_body_of_more_than_100_m_is_named_in_float32(dtype, said, caplog):
    with caplog.at_level(logging.WARNING):
        depth_of(tt.Sphere(radius=1000.0), [[0, 0, 1000.0]], 1e-3, dtype=dtype)
        depth_of(tt.Sphere(radius=99.0), [[0, 0, 99.0]], 1e-3, dtype=dtype)
        depth_of(tt.Plane(), [[0, 0, 0]], 1e-3, dtype=dtype)
    assert caplog.text.count("'body' reaches 1000 m") == caplog.text.count('dtype="float64"') == said
