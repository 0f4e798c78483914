"""The depth of each taxel's own position inside the sensed bodies, and the part of a grid that is in contact."""

# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.warp_collectives import lanes_per_environment, warp_max
from tactemu.plan.launches import in_turn
from tactemu.plan.scalars import natural
from tactemu.sensors.probes.query import probes_struct, touch_type
from tactemu.sensors.probes.strips import record_strips
from tactemu.sensors.sensor_model import Site

_NO_INDEX = 2**30


@dataclass(frozen=True, kw_only=True)
class TaxelDepth:
    """The arrays that the stage writes."""

    depth: wp.array
    """``max(0, -distance)`` [m], shape ``(n_envs, n_taxels)``; 0 for fillers; NaN for poses that are not finite."""
    power: wp.array
    """``depth ** exponent``; the same array for exponent 1."""
    box: wp.array
    """First and last row, first and last column in contact, int32, shape ``(n_envs, 4)``; first > last without
    contact."""


@functools.cache
def _clear_kernel():
    @warp_kernel
    def clear_box(first_env: int, box: wp.array2d(dtype=wp.int32)):
        env = wp.tid()
        env += first_env
        box[env, 0] = _NO_INDEX
        box[env, 1] = -1
        box[env, 2] = _NO_INDEX
        box[env, 3] = -1

    return clear_box


@functools.cache
def box_kernel(real, lanes: int):
    """Return the kernel that finds the box with a warp per environment: on a GPU atomics of many taxels on few numbers
    would queue."""

    @warp_kernel
    def find_box(first_env: int, depth: wp.array2d(dtype=real), cols: int, box: wp.array2d(dtype=wp.int32)):
        env, lane = wp.tid()
        env = natural(env + first_env)
        top = int(_NO_INDEX)
        bottom = int(-1)
        left = int(_NO_INDEX)
        right = int(-1)
        row = lane // cols
        col = lane - row * cols
        for i in range(lane, depth.shape[1], wp.static(lanes)):
            i = natural(i)
            if not (depth[env, i] <= real(0.0)):  # NaN is in contact
                top = wp.min(top, row)
                bottom = wp.max(bottom, row)
                left = wp.min(left, col)
                right = wp.max(right, col)
            col += wp.static(lanes)
            while col >= cols:
                col -= cols
                row += 1
        top = -warp_max(-top)
        bottom = warp_max(bottom)
        left = -warp_max(-left)
        right = warp_max(right)
        if lane == 0:
            box[env, 0] = top
            box[env, 1] = bottom
            box[env, 2] = left
            box[env, 3] = right

    return find_box


@functools.cache
def _box_type(real):
    @wp.struct
    class Boxes:
        exponent: real
        cols: wp.int32
        power: wp.array2d(dtype=real)  # written: depth ** exponent
        box: wp.array2d(dtype=wp.int32)  # on a CPU: widened by every taxel in contact

    return Boxes


@functools.cache
def _depth_formula(real, widens: bool):
    """Return the formula of depth. With ``widens`` each taxel in contact widens the box, on a CPU, where one thread
    handles all taxels of an environment."""
    boxes_type, probes_type, touch_struct = _box_type(real), probes_struct(real), touch_type(real)
    readings = wp.array3d(dtype=real)

    @wp.func
    def measure(boxes: boxes_type, probes: probes_type, touch: touch_struct, e: int, i: int, out: readings):
        h = real(0.0)
        if not (touch.depth <= real(0.0)):  # a form of the test that lets NaN pass
            h = touch.depth
            if wp.static(widens):
                row = i // boxes.cols
                col = i - row * boxes.cols
                wp.atomic_min(boxes.box, e, 0, row)
                wp.atomic_max(boxes.box, e, 1, row)
                wp.atomic_min(boxes.box, e, 2, col)
                wp.atomic_max(boxes.box, e, 3, col)
        out[e, i, 0] = h
        if boxes.exponent == real(2.0):
            boxes.power[e, i] = h * h
        elif boxes.exponent != real(1.0):
            boxes.power[e, i] = wp.pow(h, boxes.exponent)

    return measure


def taxel_depth(site: Site, exponent: float) -> tuple[TaxelDepth, Callable[[], None]]:
    """Allocate the arrays, and return them with the launch of the query; ``exponent`` > 0."""
    context = site.context
    real, shape = context.real, (context.n_envs, site.probes.n)
    depth = context.zeros(shape, real)
    power = depth if exponent == 1.0 else context.zeros(shape, real)
    box = context.zeros((context.n_envs, 4), wp.int32)
    on_cpu, cols = context.device.is_cpu, site.probes.layout[-1]
    boxes = _box_type(real)()
    boxes.exponent, boxes.cols, boxes.power, boxes.box = exponent, cols, power, box
    out = depth.reshape((*shape, 1))
    find = record_strips(site, _depth_formula(real, on_cpu), _box_type(real), boxes, out, out, at_surface=True)
    found = TaxelDepth(depth=depth, power=power, box=box)
    if on_cpu:
        return found, in_turn(context.record(_clear_kernel(), context.n_envs, [], [box]), find)
    side = lanes_per_environment(context.device)
    bound = context.record(box_kernel(real, side), (context.n_envs, side), [depth, cols], [box])
    return found, in_turn(find, bound)
