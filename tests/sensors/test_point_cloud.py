"""Points on surfaces: spread, clusters, primitives."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.geometry.shapes.surface import sample_triangles
from tactemu.sensors.point_cloud import CLUSTER_SIZE, PointCloud, cluster, farthest_points, split_evenly


def test_farthest_points_keep_their_distance():
    """At least 0.7 of the spacing of a hexagonal packing, which random points miss by far."""
    rng = np.random.default_rng(0)
    candidates = np.column_stack([rng.random((4000, 2)), np.zeros(4000)])
    chosen = candidates[farthest_points(candidates, 200)]

    def nearest(points):
        d = np.linalg.norm(points[:, None] - points[None], axis=-1) + np.eye(len(points)) * 9
        return d.min(1)

    assert nearest(chosen).min() > 0.7 * np.sqrt(2 / np.sqrt(3) / 200)
    assert nearest(candidates[:200]).min() < 0.3 * nearest(chosen).min()
    assert farthest_points(candidates[:3], 10).size == 3


def test_samples_lie_on_the_triangles_by_area():
    vertices = np.array([(0, 0, 0), (3, 0, 0), (0, 3, 0), (0, 0, 5), (1, 0, 5), (0, 1, 5), (0, 0, 5)], float)
    faces = np.array([(0, 1, 2), (3, 4, 5), (3, 6, 3)])  # areas 4.5, 0.5 and 0
    points, area = sample_triangles(vertices, faces, 1000, np.random.default_rng(0))
    assert area == pytest.approx(5.0)
    low = np.abs(points[:, 2]) < 1e-9
    assert (low | (np.abs(points[:, 2] - 5) < 1e-9)).all() and 0.85 < low.mean() < 0.95
    assert (points[low, 0] + points[low, 1] <= 3 + 1e-12).all() and (points >= 0).all()
    with pytest.raises(SceneError, match="area of 0"):
        sample_triangles(vertices, faces[2:], 10, np.random.default_rng(0))


@pytest.mark.parametrize("n", [1, 16, 17, 500, 1000])
def test_clusters_hold_every_point_once(n):
    points = np.random.default_rng(0).normal(size=(n, 3))
    clouds = [
        PointCloud(4, points, np.ones(n)),
        PointCloud(5, points[:0], np.ones(0)),
        PointCloud(7, -points, np.ones(n)),
    ]
    c = cluster(clouds)
    filled = c.order >= 0
    assert np.array_equal(np.sort(c.order[filled]), np.arange(2 * n)) and c.bodies.tolist() == [4, 7]
    assert np.array_equal(c.positions[filled], np.concatenate([points, -points])[c.order[filled]])
    assert (c.positions[~filled] > 1e16).all() and not c.areas[~filled].any() and (c.areas[filled] == 1).all()
    assert c.counts.max() <= CLUSTER_SIZE and c.n_points == 2 * n and (c.counts > 0).all()
    assert c.cloud_start[-1] == len(c.ball)
    places = c.positions.reshape(-1, CLUSTER_SIZE, 3)
    for k, count in enumerate(c.counts):
        assert (np.linalg.norm(places[k, :count] - c.ball[k, :3], axis=1) <= c.ball[k, 3] * (1 + 1e-12)).all()


def test_no_points_are_no_clusters():
    assert cluster([]).n_points == 0 and len(cluster([]).counts) == 0


def test_points_are_split_evenly():
    assert split_evenly(500, 2) == [250, 250] and split_evenly(7, 3) == [3, 2, 2] and split_evenly(1, 3) == [1, 1, 1]


@pytest.mark.parametrize(
    "shape, area",
    [
        (tt.Sphere(radius=0.02), 4 * np.pi * 0.02**2),
        (tt.Box(size=(0.01, 0.02, 0.03)), 2 * (2e-4 + 3e-4 + 6e-4)),
        (tt.Capsule(radius=0.01, length=0.03), 2 * np.pi * 0.01 * (0.03 + 0.02)),
        (tt.Cylinder(radius=0.01, length=0.03), 2 * np.pi * 0.01 * (0.03 + 0.01)),
    ],
)
def test_points_lie_evenly_on_the_exact_surface(shape, area):
    points, total = shape.sample("it", 20_000, np.random.default_rng(0))
    assert total == pytest.approx(area) and points.shape == (20_000, 3)
    match shape:
        case tt.Sphere(radius=r):
            off = np.linalg.norm(points, axis=1) - r
        case tt.Box(size=size):
            off = np.max(np.abs(points) - np.array(size) / 2, axis=1)
        case tt.Capsule(radius=r, length=length):
            z = np.maximum(np.abs(points[:, 2]) - length / 2, 0)
            off = np.hypot(np.hypot(points[:, 0], points[:, 1]), z) - r
        case _:
            off = np.maximum(np.hypot(points[:, 0], points[:, 1]) - 0.01, np.abs(points[:, 2]) - 0.015)
    assert np.abs(off).max() < 1e-9
    assert np.abs(points.mean(axis=0)).max() < 0.02 * np.abs(points).max()
    top = points[:, 2] > 0.8 * points[:, 2].max()
    assert top.mean() == pytest.approx(expected_top(shape), rel=0.06)


def expected_top(shape) -> float:
    """Share of the surface above 0.8 of the height, z = 0.8 top."""
    match shape:
        case tt.Sphere():
            return 0.1  # Archimedes: by height
        case tt.Box(size=(x, y, z)):
            return (x * y + 0.1 * z * 2 * (x + y)) / (2 * (x * y + y * z + x * z))
        case tt.Capsule(radius=r, length=length):
            return 0.2 * (r + length / 2) / (2 * r + length)
        case tt.Cylinder(radius=r, length=length):
            return (r / 2 + 0.1 * length) / (length + r)
