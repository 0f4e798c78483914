"""The tree of a mesh's faces against all of its faces, one by one."""

import numpy as np
import pytest
import trimesh
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.face_tree import build_tree, nearest_face_function, trees_type, upload_trees

nearest_face = nearest_face_function()


@warp_kernel
def search(
    trees: trees_type(),  # pyright: ignore[reportInvalidTypeForm]
    body: int,
    points: wp.array(dtype=wp.vec3),  # pyright: ignore[reportInvalidTypeForm]
    farthest: float,
    seed: int,
    out: wp.array(dtype=wp.int32),  # pyright: ignore[reportInvalidTypeForm]
):
    k = wp.tid()
    out[k] = nearest_face(trees, body, points[k], farthest, seed)


def found(trees, points, *, body=0, farthest=100.0, seed=-1):
    out = wp.zeros(len(points), dtype=wp.int32, device="cpu")
    given = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(search, dim=len(points), inputs=[trees, body, given, farthest, seed], outputs=[out], device="cpu")
    return out.numpy()


def distances(corners, points):
    """The distance of each point to each face, shape ``(points, faces)``."""
    return np.stack([
        np.linalg.norm(
            trimesh.triangles.closest_point(np.broadcast_to(face, (len(points), 3, 3)), points) - points, axis=1
        )
        for face in corners
    ], axis=1)  # fmt: skip


def soup(count, size, seed=0):
    """Triangles anywhere in a box of unit size; some are long and thin."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-1, 1, (count, 1, 3))
    return middles + rng.normal(size=(count, 3, 3)) * size * rng.choice([1.0, 1e-3], (count, 1, 3))


def sheet(count):
    """Neighbouring faces of a wavy sheet."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, count)] * 2)
    points = np.stack([x, y, 0.2 * np.sin(5 * x) * np.cos(4 * y)], -1)
    corners = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.concatenate([np.stack([corners[0], corners[k], corners[k + 1]], -2).reshape(-1, 3, 3) for k in (1, 2)])


MESHES = {
    **{f"{count} faces": soup(count, 0.3) for count in (1, 2, 3, 8, 9, 33, 129)},
    "600 small faces": soup(600, 0.01),
    "faces of all sizes": np.concatenate([soup(200, 0.5, 1), soup(200, 1e-3, 2)]),
    "a sheet": sheet(20),
    "a ball": np.asarray(trimesh.creation.icosphere(3).triangles),
    "faces in one place": np.repeat(soup(1, 0.5), 20, axis=0),
}


def tree_of(corners):
    return build_tree(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@pytest.mark.parametrize("name", MESHES)
def test_the_nearest_face_is_found_from_every_seed(name):
    corners = MESHES[name].astype(np.float32).astype(float)
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.5, 1.5, (300, 3)).astype(np.float32).astype(float)
    points[:60] = corners[rng.integers(len(corners), size=60)].mean(axis=1)  # on the faces
    away = distances(corners, points)
    tree = tree_of(corners)
    trees = upload_trees([tree], "cpu")
    every = np.arange(len(points))
    assert np.all(away[every, found(trees, points)] <= away.min(axis=1) + 1e-6)
    seeds = np.arange(len(corners))
    trees.seeds = wp.array(tree.index_of(seeds), dtype=wp.int32, device="cpu")
    for seed in rng.choice(seeds, 5):
        assert np.all(away[every, found(trees, points, seed=int(seed))] <= away.min(axis=1) + 1e-6)


def test_a_face_as_far_as_the_limit_is_not_found():
    points = np.array([[0.0, 0.0, 0.5]])
    trees = upload_trees([tree_of(sheet(2) * [1, 1, 0])], "cpu")
    assert found(trees, points, farthest=0.4999)[0] == -1
    assert found(trees, points, farthest=0.5001)[0] in (0, 1)


def test_bodies_have_trees_of_their_own_or_share_one():
    one, other = tree_of(sheet(9)), tree_of(MESHES["a ball"])
    points = np.random.default_rng(2).uniform(-1, 1, (50, 3))
    alone = [found(upload_trees([tree], "cpu"), points) for tree in (one, other)]
    trees = upload_trees([None, one, other, one], "cpu")
    for body, expected in ((1, alone[0]), (2, alone[1]), (3, alone[0])):
        assert np.array_equal(found(trees, points, body=body), expected)
    assert len(trees.faces) == 3 * (len(one.faces) + len(other.faces))
