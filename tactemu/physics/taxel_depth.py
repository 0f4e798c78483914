"""How deep each taxel's own place is inside the bodies felt, and which part of a grid is in contact."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from tactemu.physics.contact import nearest_function
from tactemu.physics.plan import record
from tactemu.physics.point_cloud import bounding_ball
from tactemu.physics.sensor import Site
from tactemu.physics.shapes import shape_functions, table_type

_SEGMENT = {"cpu": 8, "cuda": 1}
"""Taxels that one thread looks at: if no body reaches their ball, none is looked at closer. On a GPU neighbouring
threads write neighbouring numbers."""
_NOWHERE = 2**30


@dataclass(frozen=True, kw_only=True)
class TaxelDepth:
    """What the stage writes."""

    depth: wp.array
    """``max(0, -distance)`` [m], shape ``(n_envs, n_taxels)``; 0 for fillers; NaN for poses that are not finite."""
    power: wp.array
    """``depth ** exponent``; the same array for exponent 1."""
    box: wp.array
    """First and last row, first and last column in contact, int32, shape ``(n_envs, 4)``; first > last: none."""


@functools.cache
def _kernels(real, kinds: frozenset):
    vec3, vec4 = wp.types.vector(3, real), wp.types.vector(4, real)
    transform = wp.types.transformation(real)
    nearest = nearest_function(real, kinds)
    reaches = shape_functions(real, kinds).reaches

    @wp.kernel(module="unique", enable_backward=False)
    def clear_box(box: wp.array2d(dtype=wp.int32)):
        env = wp.tid()
        box[env, 0] = _NOWHERE
        box[env, 1] = -1
        box[env, 2] = _NOWHERE
        box[env, 3] = -1

    @wp.kernel(module="unique", enable_backward=False)
    def find_depth(
        shapes: table_type(real),
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        positions: wp.array(dtype=vec3),
        is_sensing: wp.array(dtype=wp.bool),
        balls: wp.array(dtype=vec4),
        exponent: real,
        cols: int,
        segment_size: int,
        # outputs
        depth: wp.array2d(dtype=real),
        power: wp.array2d(dtype=real),
        box: wp.array2d(dtype=wp.int32),
    ):
        env, segment = wp.tid()
        first = segment * segment_size
        last = wp.min(first + segment_size, positions.shape[0])
        ball = balls[segment]
        near = bool(False)
        for t in range(targets.shape[0]):
            b = targets[t]
            near = near or reaches(shapes, b, pose[env, b], vec3(ball[0], ball[1], ball[2]), ball[3])
        for taxel in range(first, last):
            h = real(0.0)
            if near and is_sensing[taxel]:
                distance, _normal, _body = nearest(shapes, pose, targets, env, positions[taxel], real(0.0))
                if not (distance >= real(0.0)):  # so that NaN goes on
                    h = -distance
                    row = taxel // cols
                    col = taxel - row * cols
                    wp.atomic_min(box, env, 0, row)
                    wp.atomic_max(box, env, 1, row)
                    wp.atomic_min(box, env, 2, col)
                    wp.atomic_max(box, env, 3, col)
            depth[env, taxel] = h
            if exponent == real(2.0):
                power[env, taxel] = h * h
            elif exponent != real(1.0):
                power[env, taxel] = wp.pow(h, exponent)

    return clear_box, find_depth


def _balls(site: Site, size: int) -> wp.array:
    """A ball around each segment of taxels: centre, and radius with room for rounding."""
    real, positions = site.context.real, site.probes.positions
    parts = [positions[i : i + size] for i in range(0, len(positions), size)]
    balls = np.array([bounding_ball(part) for part in parts]) * [1.0, 1.0, 1.0, 1.0 + 1e-5]
    return wp.array(balls, dtype=wp.types.vector(4, real), device=site.context.device)


def taxel_depth(site: Site, is_sensing: wp.array, exponent: float) -> tuple[TaxelDepth, Callable[[], None]]:
    """Allocate the arrays and record the query. ``exponent`` > 0."""
    context = site.context
    real, device, shape = context.real, context.device, (context.n_envs, site.probes.n)
    depth = wp.zeros(shape, dtype=real, device=device)
    power = depth if exponent == 1.0 else wp.zeros(shape, dtype=real, device=device)
    box = wp.zeros((context.n_envs, 4), dtype=wp.int32, device=device)
    size = _SEGMENT["cpu" if device.is_cpu else "cuda"]
    clear_box, find_depth = _kernels(real, site.table.kinds)
    clear = record(clear_box, context.n_envs, [], [box], device)
    inputs = [site.table.struct, site.view.pose, site.targets, site.positions, is_sensing, _balls(site, size), exponent]
    find = record(
        find_depth,
        (shape[0], -(-shape[1] // size)),
        [*inputs, site.probes.layout[-1], size],
        [depth, power, box],
        device,
    )

    def launch():
        clear()
        find()

    return TaxelDepth(depth=depth, power=power, box=box), launch
