"""Plain motions as a table, and the kernel that evaluates it at each environment's own time."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportOperatorIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.bodies import Body
from tactemu.geometry.motion import InTurn, Motion, Together
from tactemu.geometry.motion.track import PlainMotion, Track
from tactemu.plan.clock import Clock

MAX_DEPTH = 8
"""Deepest nesting of sequences that the kernel evaluates; deeper motions are evaluated in Python."""
_KNOT, _NUMBERS = 16, 11

Times = wp.types.vector(MAX_DEPTH, wp.float64)


@wp.struct
class Paths:
    """The motions of bodies, each a run of nodes: tracks, which apply one after another, and windows, parts of a
    sequence, which apply until their own end only.

    A node's numbers are ``delay, duration, repeats, turn period`` of a track, and ``first, end, start, period`` of a
    window in the time of its sequence, with the displacement ``(3), (4)`` that the parts before it have left.
    """

    bodies: wp.array(dtype=wp.int32)  # index of each body
    first: wp.array(dtype=wp.int32)  # first node of each, and the end of the last
    nodes: wp.array2d(dtype=wp.int32)  # depth, the node after a window (0: a track), first knot, number of knots
    numbers: wp.array2d(dtype=wp.float64)
    knots: wp.array2d(dtype=wp.float64)  # time, distance, speed, axis (3), turn (3), origin (3), quaternion (4)
    starts: wp.array2d(dtype=wp.float64)  # start pose of each body
    driven: wp.array2d(dtype=wp.uint8)  # (n_envs, n): 0 where the body is taken from its motion


class _Table:
    """The rows of :class:`Paths` while they are collected."""

    def __init__(self) -> None:
        self.nodes: list[list[int]] = []
        self.numbers: list[list[float]] = []
        self.knots: list[np.ndarray] = []

    def add(self, motion: Motion, depth: int = 0) -> None:
        """Add the nodes of a motion whose time is that of a depth."""
        if isinstance(motion, Together):
            for part in motion.motions:
                self.add(part, depth)
        elif isinstance(motion, InTurn):
            self._add_sequence(motion, depth)
        else:
            assert isinstance(motion, PlainMotion)
            self._add_track(motion.track, depth)

    def _add_track(self, track: Track, depth: int) -> None:
        self.nodes.append([depth, 0, len(self.knots), len(track.knots)])
        self._number(track.delay, track.duration, float(track.repeats), track.turn_period)
        self.knots += [np.hstack(knot) for knot in track.knots]

    def _add_sequence(self, sequence: InTurn, depth: int) -> None:
        ends = [start for start, _ in sequence.starts[1:]] + [math.inf]
        period = sequence.duration_once if sequence.repeat else 0.0
        for k, (part, (start, left), end) in enumerate(zip(sequence.motions, sequence.starts, ends)):
            window = [depth, 0, 0, 0]
            self.nodes.append(window)
            self._number(start if k else -math.inf, end, start, period, *left.position, *left.quaternion)
            self.add(part, depth + 1)
            window[1] = len(self.nodes)

    def _number(self, *values: float) -> None:
        self.numbers.append([*map(float, values), *[0.0] * (_NUMBERS - len(values))])


def is_plain(motion: Any, depth: int = 0) -> bool:
    """Return True for a motion that the kernel can evaluate."""
    if isinstance(motion, InTurn | Together):
        depth += isinstance(motion, InTurn)
        return depth < MAX_DEPTH and all(is_plain(part, depth) for part in motion.motions)
    return isinstance(motion, PlainMotion)


def paths_of(bodies: Sequence[Body], starts: wp.array, driven: wp.array, device: wp.Device) -> Any:
    """Return the table of the bodies' motions, which are plain.

    Args:
        bodies: the bodies that move.
        starts: start pose of each body of the scene, ``(n_bodies, 13)``.
        driven: 1 where the motion moves the body, ``(n_envs, n)``.
        device: the device of these arrays.
    """
    table, first = _Table(), []
    for body in bodies:
        first.append(len(table.nodes))
        table.add(body.motion)  # pyright: ignore[reportArgumentType]
    paths = Paths()
    rows = {
        "bodies": (wp.int32, [body.index for body in bodies]),
        "first": (wp.int32, [*first, len(table.nodes)]),
        "nodes": (wp.int32, np.array(table.nodes).reshape(-1, 4)),
        "numbers": (wp.float64, np.array(table.numbers).reshape(-1, _NUMBERS)),
        "knots": (wp.float64, np.array(table.knots).reshape(-1, _KNOT)),
    }
    for name, (dtype, values) in rows.items():
        setattr(paths, name, wp.array(values, dtype=dtype, device=device))
    paths.starts, paths.driven = starts, driven
    return paths


@wp.func
def _triple(row: wp.array(dtype=wp.float64), at: int):
    return wp.vec3d(row[at], row[at + 1], row[at + 2])


@wp.func
def _turned(a: wp.quatd, b: wp.quatd):
    """Return the rotation ``b`` followed by ``a``, summed as :func:`~tactemu.geometry.rotation.multiply` does."""
    return wp.quatd(
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@wp.func
def _rotation(v: wp.vec3d):
    """Return the rotation by a rotation vector [rad]."""
    angle = wp.sqrt(wp.dot(v, v))
    half = angle / wp.float64(2.0)
    scale = wp.float64(0.5)
    if angle >= wp.float64(1.0e-12):
        scale = wp.sin(half) / angle
    return wp.quatd(scale * v[0], scale * v[1], scale * v[2], wp.cos(half))


@wp.func
def _remainder(x: wp.float64, period: wp.float64):
    """Return the IEEE remainder: within half a period of 0."""
    r = wp.mod(x, period)
    half = wp.float64(0.5) * period
    if r > half:
        r -= period
    if r < -half:
        r += period
    return r


@wp.func
def _knot_at(knots: wp.array2d(dtype=wp.float64), first: int, n: int, local: wp.float64):
    """Return the last knot whose time has come."""
    low = first
    high = first + n
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle, 0] <= local:
            low = middle
        else:
            high = middle
    return low


@warp_kernel(module_options={"fuse_fp": False})
def move_bodies(
    first_env: int,
    clock: Clock,
    dt_ns: wp.array(dtype=wp.int64),
    ahead: int,
    paths: Paths,
    world: wp.array3d(dtype=wp.float64),
):
    """Set poses and velocities of bodies by their motions, ``ahead`` steps of ``dt_ns`` after each environment's time.

    It rounds as :class:`~tactemu.geometry.motion.track.Track` does, so that both compute the same.
    """
    e, k = wp.tid()
    e += first_env
    if paths.driven[e, k] == wp.uint8(0):
        return
    own_ns = clock.time_ns[0] - clock.began_ns[e] + wp.int64(ahead) * dt_ns[0]
    times = Times()
    times[0] = wp.float64(own_ns) * wp.float64(1.0e-9)
    position = wp.vec3d()
    turn = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    velocity = wp.vec3d()
    spin = wp.vec3d()
    zero = wp.float64(0.0)
    node = int(paths.first[k])
    while node < paths.first[k + 1]:
        depth = paths.nodes[node, 0]
        numbers = paths.numbers[node]
        t = times[depth]
        if paths.nodes[node, 1] > 0:
            if numbers[3] > wp.float64(0.0) and t > wp.float64(0.0):
                t = wp.mod(t, numbers[3])
            if t < numbers[0] or t >= numbers[1]:
                node = paths.nodes[node, 1]
                continue
            times[depth + 1] = t - numbers[2]
            left = wp.quatd(numbers[8], numbers[9], numbers[10], numbers[7])
            position = position + _triple(numbers, 4)
            turn = _turned(left, turn)
            spin = wp.quat_rotate(left, spin)
        else:
            first = paths.nodes[node, 2]
            n = paths.nodes[node, 3]
            local = t - numbers[0]
            at = int(first)
            moved = wp.float64(0.0)
            speed = wp.float64(0.0)
            if t >= numbers[1] or local < paths.knots[first, 0]:
                if t >= numbers[1]:
                    at = first + n - 1
                moved = paths.knots[at, 1]
            else:
                begin = paths.knots[first, 0]
                end = paths.knots[first + n - 1, 0]
                if numbers[2] > wp.float64(0.0) and local >= end:
                    local = begin + wp.mod(local - begin, end - begin)
                at = _knot_at(paths.knots, first, n, local)
                speed = paths.knots[at, 2]
                moved = paths.knots[at, 1] + speed * (local - paths.knots[at, 0])
            knot = paths.knots[at]
            axis = _triple(knot, 3)
            by = _triple(knot, 6)
            position = position + (_triple(knot, 9) + axis * moved)
            velocity = velocity + axis * speed
            own = wp.quatd(knot[13], knot[14], knot[15], knot[12])
            if by[0] != zero or by[1] != zero or by[2] != zero:
                angle = moved
                if numbers[3] > wp.float64(0.0):
                    angle = _remainder(moved, numbers[3])
                own = _turned(_rotation(by * angle), own)
            if own[3] != wp.float64(1.0) or own[0] != zero or own[1] != zero or own[2] != zero:
                turn = _turned(own, turn)
                spin = wp.quat_rotate(own, spin)
            spin = spin + by * speed
        node += 1
    b = paths.bodies[k]
    start = paths.starts[b]
    position = _triple(start, 0) + position
    turn = _turned(turn, wp.quatd(start[4], start[5], start[6], start[3]))
    for i in range(3):
        world[e, b, i] = position[i]
        world[e, b, 4 + i] = turn[i]
        world[e, b, 7 + i] = velocity[i]
        world[e, b, 10 + i] = spin[i]
    world[e, b, 3] = turn[3]


@warp_kernel
def drive_again(mask: wp.array(dtype=wp.bool), may_drive: wp.array(dtype=wp.uint8), driven: wp.array2d(dtype=wp.uint8)):
    """Give bodies back to their motions where the mask is true, unless their poses are bound."""
    e, k = wp.tid()
    if mask[e]:
        driven[e, k] = may_drive[k]
