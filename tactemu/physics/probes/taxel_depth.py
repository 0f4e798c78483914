"""How deep each taxel's own place is inside the bodies felt, and which part of a grid is in contact."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from tactemu.physics.probes.query import contact_function, probe_arrays, probes_struct, strip_function, strips, turned
from tactemu.physics.sensor import Site
from tactemu.physics.shapes.shape import table_type
from tactemu.plan.plan import record

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
def _clear_kernel():
    @wp.kernel(module="unique", enable_backward=False)
    def clear_box(box: wp.array2d(dtype=wp.int32)):
        env = wp.tid()
        box[env, 0] = _NOWHERE
        box[env, 1] = -1
        box[env, 2] = _NOWHERE
        box[env, 3] = -1

    return clear_box


@functools.cache
def _depth_kernel(real, kinds: frozenset, along_normal: bool, in_strips: bool):
    transform = wp.types.transformation(real)
    contact, touches = contact_function(real, kinds, along_normal), strip_function(real, kinds)

    @wp.kernel(module="unique", enable_backward=False)
    def find_depth(
        shapes: table_type(real),
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_struct(real),
        exponent: real,
        cols: int,
        # outputs
        depth: wp.array2d(dtype=real),
        power: wp.array2d(dtype=real),
        box: wp.array2d(dtype=wp.int32),
    ):
        env, strip = wp.tid()
        if wp.static(turned(kinds, in_strips)):
            strip, env = wp.tid()
        first = strip * probes.strip
        near = bool(True)
        if wp.static(in_strips):
            near = touches(shapes, pose, targets, probes, env, strip, real(0.0))
        for taxel in range(first, wp.min(first + probes.strip, probes.positions.shape[0])):
            h = real(0.0)
            if near and probes.radii[taxel] > real(0.0):
                distance, _normal, _body = contact(shapes, pose, targets, probes, env, taxel, real(0.0))
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

    return find_depth


def taxel_depth(site: Site, exponent: float) -> tuple[TaxelDepth, Callable[[], None]]:
    """Allocate the arrays and record the query. ``exponent`` > 0."""
    context = site.context
    real, device, shape = context.real, context.device, (context.n_envs, site.probes.n)
    depth = wp.zeros(shape, dtype=real, device=device)
    power = depth if exponent == 1.0 else wp.zeros(shape, dtype=real, device=device)
    box = wp.zeros((context.n_envs, 4), dtype=wp.int32, device=device)
    clear = record(_clear_kernel(), context.n_envs, [], [box], device)
    kernel = _depth_kernel(real, site.table.kinds, site.along_normal, device.is_cpu)
    inputs = [site.table.struct, site.view.pose, site.targets, probe_arrays(site), exponent, site.probes.layout[-1]]
    find = record(kernel, strips(site), inputs, [depth, power, box], device)

    def launch():
        clear()
        find()

    return TaxelDepth(depth=depth, power=power, box=box), launch
