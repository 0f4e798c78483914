"""What every shape must keep: its distance, normal, ray, points and reach tell of one and the same solid."""

import numpy as np

import tactemu as tt
from tests.sensors.rig import scene_with


def distance_and_normal(shape, points, far):
    """Signed distances [m] and unit normals at points of the body's frame, as sensors get them."""
    at = {"positions": points, "radius": far}
    springs = {"normal_stiffness": 1.0, "normal_damping": 0.0, "shear_scalar": 0.0, "twist_scalar": 0.0}
    readings = []
    for model in (tt.ContactDepthProbe(**at), tt.KinematicTaxel(**at, **springs)):
        sim, _, skin = scene_with(shape, model, dtype="float64")
        sim.step()
        readings.append(skin.read())
    force = readings[1].force
    return far - readings[0], force / np.linalg.norm(force, axis=1, keepdims=True)


def entered_at(shape, points, normals, reach, far):
    """Where lines enter the shape, looked at from ``reach`` behind the points on; at most ``far`` [m]."""
    ray = {"depth_query": "ray", "ray_reach": reach}
    model = tt.ContactDepthProbe(positions=points, normals=normals, radius=far, **ray)
    sim, _, skin = scene_with(shape, model, dtype="float64")
    sim.step()
    return far - skin.read()


def check_shape(
    shape: tt.Sphere, size: float, *, has_points: bool = True, tolerance: float = 1e-9, ray_tolerance: float = 1e-7
) -> None:
    """Press a shape with points and lines, and compare what its parts say of it.

    Args:
        shape: of a body.
        size: it lies within this of its origin, or that much of it is looked at [m].
        has_points: can points be spread over its surface?
        tolerance: of distances, in parts of ``size``; a surface that is known in pieces needs more.
        ray_tolerance: of where lines enter, likewise; lines that are followed in steps need more.
    """
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.5 * size, 1.5 * size, (400, 3))
    d, normal = distance_and_normal(shape, points, 10 * size)
    _normals_are_gradients(shape, points, d, normal, size, tolerance)
    _lines_enter_where_the_distance_is_zero(shape, points, size, ray_tolerance)
    if has_points:
        _points_lie_on_it(shape, points, d, size, tolerance)


def _normals_are_gradients(shape, points, d, normal, size, tolerance):
    step = 1e-5 * size
    along, _ = distance_and_normal(shape, points + step * normal, 10 * size)
    smooth = np.abs(along - d - step) < 0.1 * step + tolerance * size
    assert smooth.mean() > 0.95, "a step along the normal does not change the distance by its length"


def _lines_enter_where_the_distance_is_zero(shape, points, size, tolerance):
    lines = np.random.default_rng(1).normal(size=(400, 3))
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    far = 10 * size
    s = entered_at(shape, points, lines, 3 * size, far)
    starts, _ = distance_and_normal(shape, points - 3 * size * lines, far)
    hit = (s < 3 * size) & (starts > 0)
    assert hit.sum() > 20, "hardly a line hits it"
    there, _ = distance_and_normal(shape, points[hit] + s[hit, None] * lines[hit], far)
    assert np.abs(there).max() < tolerance * size, "a line enters where the distance is not zero"
    between = points[hit] + (s[hit] - 0.5 * np.minimum(s[hit] + 3 * size, 0.2 * size))[:, None] * lines[hit]
    before, _ = distance_and_normal(shape, between, far)
    behind = s[hit] > 0  # what ends before the skin is not felt: there a line may have passed through
    assert (before[~behind] > -tolerance * size).mean() > 0.9, "a line was inside before it entered"


def _points_lie_on_it(shape, points, d, size, tolerance):
    rng = np.random.default_rng(2)
    surface, area = shape.sample("body", 20_000, rng)
    on, _ = distance_and_normal(shape, surface[:400], 10 * size)
    assert np.abs(on).max() < tolerance * size, "points lie off the surface"
    spacing = 4 * np.sqrt(area / len(surface))
    nearest = np.sqrt(((points[:100, None] - surface) ** 2).sum(-1)).min(1)
    assert (np.abs(np.abs(d[:100]) - nearest) < spacing).all(), "the distance is not that to the points of the surface"
    for direction in np.vstack([np.eye(3), -np.eye(3), rng.normal(size=(4, 3))]):
        direction = direction / np.linalg.norm(direction)
        assert abs((surface @ direction).max() - shape.reach("body", direction)) < spacing, (
            "it reaches farther, or less"
        )
