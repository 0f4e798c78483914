"""The point clouds of a sensor's tracked bodies: given by the user, or sampled with the scene's seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.options import number
from tactemu.base.random_streams import generator
from tactemu.geometry.bodies import Body
from tactemu.sensors.point_cloud import PointCloud, farthest_points, split_evenly
from tactemu.sensors.sensor_model import Site

FEWER_POINTS = "lower `n_sample_points`"
"""The advice to make a cloud cost less, for the plan."""
MAX_SAMPLE_POINTS = 1_000_000
"""Maximum number of points sampled on a sensor's bodies; bounds memory."""


def _counts(given: int | Sequence[int], n_bodies: int, sensor: str) -> list[int]:
    counts = [
        number(sensor, "n_sample_points", count, Annotated[int, Bounds(low=1, high=MAX_SAMPLE_POINTS)])
        for count in (given if isinstance(given, list | tuple | np.ndarray) else [given])
    ]
    if isinstance(given, list | tuple | np.ndarray):
        if len(counts) != n_bodies:
            raise SceneError(f"{sensor}: n_sample_points must be one number or {n_bodies}, got {len(counts)}")
        return counts
    return split_evenly(counts[0], n_bodies)


def _given_clouds(points, area: float, site: Site) -> list[PointCloud]:
    n = len(site.target_bodies)
    arrays = [points] if np.ndim(points[0]) == 1 else list(points)
    if len(arrays) != n:
        raise SceneError(f"{site.name}: points must hold one array per tracked body ({n}), got {len(arrays)}")
    clouds = []
    for body, array in zip(site.target_bodies, arrays):
        positions = np.asarray(array, dtype=np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3 or not np.isfinite(positions).all():
            raise SceneError(
                f"{site.name}: points of body {body.name!r} must be finite and of shape (M, 3), got {positions.shape}"
            )
        clouds.append(PointCloud(body.index, positions, np.full(len(positions), area)))
    return clouds


def surface_points(
    site: Site, n_sample_points: int | Sequence[int], points=None, point_area: float | None = None
) -> list[PointCloud]:
    """Return one cloud per tracked body.

    Args:
        site: the site of the sensor, whose target bodies are sampled.
        n_sample_points: number of points for all bodies together, split evenly, or one number per body.
        points: points to use instead of sampling, ``(M, 3)`` for one body or a list of such arrays.
        point_area: surface that each of these points stands for [m^2].

    Raises:
        SceneError: numbers do not fit the bodies, or a body has no surface to sample.
    """
    if points is not None and len(points):
        return _given_clouds(points, np.nan if point_area is None else float(point_area), site)
    clouds = []
    for body, count in zip(site.target_bodies, _counts(n_sample_points, max(len(site.target_bodies), 1), site.name)):
        key = body.index, count
        if key not in site.clouds:
            site.clouds[key] = _sampled(body, count, site)
        clouds.append(site.clouds[key])
    return clouds


def _sampled(body: Body, count: int, site: Site) -> PointCloud:
    """Return an even spread of points over a body, from the random stream of the first sensor that needs this number of
    points."""
    rng = generator(site.context.seed, f"{site.name}/points of {body.name}")
    assert body.shape is not None  # sensed bodies have a shape
    candidates, area = body.shape.sample(body.name, max(256, 4 * count), rng)
    positions = candidates[farthest_points(candidates, count)]
    return PointCloud(body.index, positions, np.full(count, area / count))
