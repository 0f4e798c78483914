"""Points spread over the surface of a body: a ProximityTaxel senses them, and they stick to an elastomer in shear.

Candidates are drawn from the surface by area; farthest-point selection keeps an even spread of these. Points given by
the user are not changed. For the kernels a cloud is sorted into small clusters with bounding balls, so that a taxel
skips those that it cannot reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CLUSTER_SIZE = 8
"""Maximum number of points per cluster."""
FAR_AWAY_M = 1.0e17
"""Coordinate of a point out of reach of every taxel [m]; its square still fits float32."""


@dataclass(frozen=True)
class PointCloud:
    """Points fixed to one body, in its frame."""

    body: int
    """Index of the body in the scene."""
    positions: np.ndarray
    """Positions [m], float64, shape ``(n, 3)``."""
    areas: np.ndarray
    """Surface that each point stands for [m^2], shape ``(n,)``; NaN where unknown (points given without areas)."""


def farthest_points(candidates: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of ``count`` candidates, each the one farthest from those chosen before, starting with the
    first.

    ``candidates`` has shape ``(n, 3)``; if it has fewer rows, all are returned.
    """
    x, y, z = np.ascontiguousarray(candidates.T)
    chosen = np.zeros(min(count, len(candidates)), dtype=np.int64)
    nearest = np.full(len(candidates), np.inf)
    for i in range(1, len(chosen)):
        last = chosen[i - 1]
        squared = (x - x[last]) ** 2 + (y - y[last]) ** 2 + (z - z[last]) ** 2
        np.minimum(nearest, squared, out=nearest)
        chosen[i] = int(nearest.argmax())
    return chosen


def split_evenly(total: int, parts: int) -> list[int]:
    """Return the numbers of points that split ``total`` over ``parts`` links, at least one each; the first links get
    the remainder."""
    return [max(1, total // parts + (i < total % parts)) for i in range(parts)]


@dataclass(frozen=True)
class Clusters:
    """The clouds of one sensor, sorted so that neighbours in space are neighbours in memory.

    Cluster ``c`` has the places from ``c * CLUSTER_SIZE``; places beyond its points hold points far away.
    """

    order: np.ndarray
    """Index in the concatenated clouds of each place, -1 for an empty one, shape ``(n_places,)``."""
    positions: np.ndarray
    """Positions in the body frame [m], shape ``(n_places, 3)``; ``FAR_AWAY_M`` for an empty place."""
    areas: np.ndarray
    """Surface that each place stands for [m^2], shape ``(n_places,)``."""
    counts: np.ndarray
    """Number of points of each cluster, shape ``(n_clusters,)``."""
    ball: np.ndarray
    """Centre and radius of each cluster, body frame [m], shape ``(n_clusters, 4)``."""
    bodies: np.ndarray
    """Body of each cloud, shape ``(n_clouds,)``."""
    cloud_start: np.ndarray
    """First cluster of each cloud, and the number of clusters at the end, shape ``(n_clouds + 1,)``."""
    cloud_ball: np.ndarray
    """Centre and radius of each cloud, shape ``(n_clouds, 4)``."""

    @property
    def n_points(self) -> int:
        """Number of points in all clouds."""
        return int(self.counts.sum())


def _halves(indices: np.ndarray, positions: np.ndarray, size: int) -> list[np.ndarray]:
    """Return the indices split at the median of the longest side until each part has at most ``size``."""
    if len(indices) <= size:
        return [indices] if len(indices) else []
    axis = int(np.argmax(np.ptp(positions[indices], axis=0)))
    order = indices[np.argsort(positions[indices, axis], kind="stable")]
    middle = size * max(1, round(len(order) / 2 / size))
    return _halves(order[:middle], positions, size) + _halves(order[middle:], positions, size)


def spatial_order(positions: np.ndarray, size: int) -> np.ndarray:
    """Return an order of positions ``(n, 3)`` in which every ``size`` consecutive ones are near each other."""
    return np.concatenate(_halves(np.arange(len(positions)), positions, size))


def bounding_ball(points: np.ndarray) -> np.ndarray:
    """Return the centre and radius of a ball around points ``(n, 3)``; shape ``(4,)``."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.append(centre, np.linalg.norm(points - centre, axis=1).max())


def cluster(clouds: list[PointCloud]) -> Clusters:
    """Sort the clouds of a sensor into clusters. Clouds without points are left out."""
    clouds = [cloud for cloud in clouds if len(cloud.positions)]
    points = np.concatenate([cloud.positions for cloud in clouds]) if clouds else np.zeros((0, 3))
    areas = np.concatenate([cloud.areas for cloud in clouds]) if clouds else np.zeros(0)
    parts, cloud_start, offset = [], [0], 0
    for cloud in clouds:
        n = len(cloud.positions)
        parts += _halves(np.arange(offset, offset + n), points, CLUSTER_SIZE)
        cloud_start.append(len(parts))
        offset += n
    order = np.full((len(parts), CLUSTER_SIZE), -1, dtype=np.int64)
    for row, part in zip(order, parts):
        row[: len(part)] = part
    order = order.reshape(-1)
    filled = order >= 0
    positions = np.full((len(order), 3), FAR_AWAY_M)
    positions[filled] = points[order[filled]]
    return Clusters(
        order=order,
        positions=positions,
        areas=np.where(filled, np.append(areas, 0.0)[order], 0.0),
        counts=np.array([len(part) for part in parts], dtype=np.int64),
        ball=np.array([bounding_ball(points[part]) for part in parts]).reshape(-1, 4),
        bodies=np.array([cloud.body for cloud in clouds], dtype=np.int64),
        cloud_start=np.array(cloud_start),
        cloud_ball=np.array([bounding_ball(cloud.positions) for cloud in clouds]).reshape(-1, 4),
    )
