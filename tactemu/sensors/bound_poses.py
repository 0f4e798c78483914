"""Poses from arrays that another simulator writes on the device: checked once, converted by one launch per step."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body, find_body
from tactemu.geometry.device_arrays import as_warp_array, check_device, scalar_view, view
from tactemu.plan.plan import Context, Stage
from tactemu.sensors.poses import POSE_WIDTH

FLOATS = (wp.float32, wp.float64)
PARTS = {"position": 3, "quaternion": 4, "linear_velocity": 3, "angular_velocity": 3}
"""The parts of a pose that may be bound, and their widths."""


@wp.struct
class Bound:
    """The bound bodies, in the order in which they are given."""

    bodies: wp.array(dtype=wp.int32)
    columns: wp.array(dtype=wp.int32)  # index in the given arrays
    place_columns: wp.array(dtype=wp.int32)  # index of the place where the velocity is taken
    offsets: wp.array(dtype=wp.vec3d)  # position and turn in the given frame
    turns: wp.array(dtype=wp.quatd)


@functools.cache
def convert_kernel(types: tuple, scalar_last: bool, at_com: bool, at_points: bool, offset: bool):
    """Return the kernel that copies the given arrays into the world's poses, and the type of its ``given``.

    ``types`` are those of the four parts and of the places of the velocities, ``None`` for parts not given; with
    ``offset`` our bodies are displaced in the given frames.
    """
    has_position, has_quaternion, has_velocity, has_spin, _ = (kind is not None for kind in types)
    position_t, quaternion_t, velocity_t, spin_t, place_t = (kind or wp.float32 for kind in types)
    f64 = wp.float64

    @wp.struct
    class Given:
        position: wp.array3d(dtype=position_t)
        quaternion: wp.array3d(dtype=quaternion_t)
        velocity: wp.array3d(dtype=velocity_t)
        spin: wp.array3d(dtype=spin_t)
        place: wp.array3d(dtype=place_t)

    @warp_kernel
    def convert_poses(first_env: int, bound: Bound, given: Given, world: wp.array3d(dtype=wp.float64)):
        e, k = wp.tid()
        e += first_env
        b = bound.bodies[k]
        c = bound.columns[k]
        origin = wp.vec3d(world[e, b, 0], world[e, b, 1], world[e, b, 2])
        turn = wp.quatd(world[e, b, 4], world[e, b, 5], world[e, b, 6], world[e, b, 3])
        if wp.static(has_position):
            origin = wp.vec3d(f64(given.position[e, c, 0]), f64(given.position[e, c, 1]), f64(given.position[e, c, 2]))
        if wp.static(has_quaternion):
            first = wp.static(0 if scalar_last else 1)
            x, y = f64(given.quaternion[e, c, first]), f64(given.quaternion[e, c, first + 1])
            z = f64(given.quaternion[e, c, first + 2])
            turn = wp.quatd(x, y, z, f64(given.quaternion[e, c, wp.static(3 if scalar_last else 0)]))
        frame = origin
        frame_turn = turn
        if wp.static(offset):
            frame_turn = wp.normalize(turn)
            origin = frame + wp.quat_rotate(frame_turn, bound.offsets[k])
            turn = frame_turn * bound.turns[k]
        if wp.static(has_position):
            for i in range(3):
                world[e, b, i] = origin[i]
        if wp.static(has_quaternion):
            world[e, b, 3] = turn[3]
            for i in range(3):
                world[e, b, 4 + i] = turn[i]
        if wp.static(has_spin):
            for i in range(3):
                world[e, b, 10 + i] = f64(given.spin[e, c, i])
        if wp.static(has_velocity):
            v = wp.vec3d(f64(given.velocity[e, c, 0]), f64(given.velocity[e, c, 1]), f64(given.velocity[e, c, 2]))
            if wp.static(at_com or at_points or offset):  # the velocity of the body at another place than its origin
                there = frame
                if wp.static(at_com or at_points):
                    p = bound.place_columns[k]
                    there = wp.vec3d(f64(given.place[e, p, 0]), f64(given.place[e, p, 1]), f64(given.place[e, p, 2]))
                if wp.static(at_com):
                    there = frame + wp.quat_rotate(wp.normalize(frame_turn), there)
                w = wp.vec3d(world[e, b, 10], world[e, b, 11], world[e, b, 12])
                v = v + wp.cross(w, origin - there)
            for i in range(3):
                world[e, b, 7 + i] = v[i]

    return convert_poses, Given


class VelocityPoints(NamedTuple):
    """The arguments of :meth:`Simulation.bind_poses` for the points that move with the velocities."""

    at: Any
    """``velocity_at``."""
    columns: Sequence[int] | np.ndarray | None
    """``velocity_at_index``."""
    com: Any


@dataclass(kw_only=True)
class BoundPoses:
    """The checked arguments of :meth:`Simulation.bind_poses`."""

    bodies: tuple[Body, ...]
    columns: tuple[int, ...]
    arrays: dict[str, wp.array]
    """``(n_envs, n, width)`` each, by the name of the part."""
    places: wp.array | None
    """Places where velocities are taken: ``(n_envs, n, 3)``, in the given frame (``com``) or in the world."""
    place_columns: tuple[int, ...]
    """Index of the place of each body."""
    offsets: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Positions and quaternions (w, x, y, z) of the bodies in the given frames; empty: at their origins."""
    order: str
    at: str
    """Kind of place: ``origin``, ``com`` or ``points``."""

    def without(self, body: Body) -> "BoundPoses | None":
        """Return the same without one body; ``None`` if none is left."""
        kept = [k for k, each in enumerate(self.bodies) if each is not body]
        names = ("bodies", "columns", "place_columns", *(["offsets"] if self.offsets else []))
        rows = {name: tuple(getattr(self, name)[k] for k in kept) for name in names}
        return replace(self, **rows) if kept else None

    def stage(self, context: Context, world: wp.array) -> Stage:
        """Return the stage that converts the arrays, the first of each step."""
        given = [self.arrays.get(name) for name in PARTS] + [self.places]
        types = tuple(None if array is None else array.dtype for array in given)
        at = self.at == "com", self.at == "points"
        kernel, given_struct = convert_kernel(types, self.order == "xyzw", *at, bool(self.offsets))

        def upload(values, dtype) -> wp.array:
            return wp.array(values, dtype=dtype, device=context.device)

        bound, arrays = Bound(), given_struct()
        bound.bodies = upload([body.index for body in self.bodies], wp.int32)
        bound.columns, bound.place_columns = upload(self.columns, wp.int32), upload(self.place_columns, wp.int32)
        bound.offsets = upload([place for place, _ in self.offsets], wp.vec3d)
        bound.turns = upload([np.roll(turn, -1) for _, turn in self.offsets], wp.quatd)
        for name, array in zip(("position", "quaternion", "velocity", "spin", "place"), given):
            if array is not None:
                setattr(arrays, name, array)
        launch = context.record(kernel, (context.n_envs, len(self.bodies)), [bound, arrays], [world])
        words = ", ".join(self.arrays).replace("_", " ")
        reason = f"{words} of {', '.join(body.name for body in self.bodies)}, bound to arrays of another simulator"
        if any(self.arrays[name].dtype is wp.float32 for name in ("position",) if name in self.arrays):
            reason += "; float32 places a body to 0.06 µm at 1 m from the origin, 0.6 µm at 10 m"
        return Stage(name="bound poses", reason=reason, launch=launch)


def make_bound_poses(
    bodies: Sequence[Body],
    context: Context,
    *,
    poses: Any,
    parts: Mapping[str, Any],
    order: str,
    points: VelocityPoints,
    index: Mapping[Any, int] | None,
    offsets: Mapping[Any, tuple[Any, Any]] | None,
) -> BoundPoses:
    """Check the arguments of :meth:`Simulation.bind_poses`, and return them as :class:`BoundPoses`.

    Raises:
        SceneError: an argument is wrong; nothing has been launched then.
    """
    given = {name: value for name, value in parts.items() if value is not None}
    if poses is not None:
        if given or order != "wxyz" or not (isinstance(points.at, str) and points.at == "origin"):
            raise SceneError(
                "bind_poses: one array of poses has position, quaternion (w, x, y, z), velocity of the origin and "
                "angular velocity, 13 numbers; give other layouts as position=, quaternion=, ..."
            )
        starts = dict(zip(PARTS, (0, 3, 7, 10)))
        array = _columns(poses, "poses", context, POSE_WIDTH)
        given = {name: (array, starts[name]) for name in PARTS}
    if not given:
        raise SceneError(f"bind_poses: you gave no array; give poses, or any of {', '.join(PARTS)}")
    rotation.wxyz(None, order, "bind_poses")
    arrays = {name: _columns(value, name, context, PARTS[name]) for name, value in given.items()}
    widths = {name: array.shape[1] for name, array in arrays.items()}
    if len(set(widths.values())) > 1:
        counts = ", ".join(f"{name} {n}" for name, n in widths.items())
        raise SceneError(f"bind_poses: the arrays must be of the same number of bodies, got {counts}")
    n = next(iter(widths.values()))
    at, places = _places(points.at, points.com, arrays, None if points.columns is not None else n, context)
    chosen, columns = _chosen(bodies, index, n)
    return BoundPoses(
        bodies=chosen,
        columns=columns,
        arrays=arrays,
        places=places,
        place_columns=_place_columns(points.columns, columns, n, places),
        offsets=_offsets(bodies, chosen, offsets, arrays),
        order=order,
        at=at,
    )


def _columns(value: Any, name: str, context: Context, width: int, n_envs: int | None = None) -> wp.array:
    """Return an array, or ``(array, first number)``, as ``(n_envs, n, width)`` numbers over the same memory."""
    what, first = f"bind_poses: {name}", 0
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], int) and not isinstance(value[0], int):
        value, first = value
    array = scalar_view(as_warp_array(value, what))
    check_device(array, context.device, what)
    if array.dtype not in FLOATS:
        raise SceneError(f"{what}: numbers must be float32 or float64, got {array.dtype.__name__}")
    n_envs, got = context.n_envs, array.shape
    exact = first == 0 and not isinstance(value, wp.array)
    enough = array.ndim in (2, 3) and (got[-1] == width if exact else got[-1] >= first + width)
    if array.ndim == 2 and enough and got[0] % n_envs == 0:  # bodies of one environment after those of another
        n = got[0] // n_envs
        row, number = array.strides
        array = view(array, (n_envs, n, got[1]), (n * row, row, number), array.dtype)
    if not enough or array.ndim != 3 or array.shape[0] != n_envs or not array.shape[1]:
        raise SceneError(
            f"{what}: expected shape ({n_envs}, n, {width}) for n bodies, or ({n_envs} n, {width}) with those of one "
            f"environment after those of another, got {got}" + (f" from number {first} on" if first else "")
        )
    size = array.strides[2]
    return view(array, (*array.shape[:2], width), array.strides, array.dtype, first * size)


def _places(velocity_at: Any, com: Any, arrays: Mapping[str, wp.array], n: int | None, context: Context):
    """Return the kind of place where velocities are taken and its array, ``(word, array)``; ``n`` is the required
    number of places."""
    if isinstance(velocity_at, str):
        if velocity_at not in ("origin", "com"):
            raise SceneError(
                "bind_poses: velocity_at must be 'origin', 'com' or an array of points in the world, got "
                f"{velocity_at!r}"
            )
        if velocity_at == "origin":
            return "origin", None
        if com is None:
            raise SceneError("bind_poses: velocity_at='com' needs com=, the centres of mass in the bodies' frames [m]")
        places, at, name = com, "com", "com"
    else:
        places, at, name = velocity_at, "points", "velocity_at"
    if "linear_velocity" in arrays and "angular_velocity" not in arrays:
        raise SceneError("bind_poses: a velocity that is not the origin's needs angular_velocity= too")
    if isinstance(places, (list, tuple)) and not (len(places) == 2 and isinstance(places[1], int)):
        places = np.asarray(places, np.float64)
    if (isinstance(places, np.ndarray) and not context.device.is_cpu) or _one_for_all(places, n):
        host = np.asarray(places, np.float64).reshape(-1, n, 3)
        places = wp.array(np.broadcast_to(host, (context.n_envs, n, 3)).copy(), dtype=wp.float64, device=context.device)
    found = _columns(places, name, context, 3)
    if n is not None and found.shape[1] != n:
        raise SceneError(f"bind_poses: {name} is of {found.shape[1]} bodies, the other arrays are of {n}")
    return at, found


def _one_for_all(places: Any, n: int | None) -> bool:
    return isinstance(places, np.ndarray) and places.shape == (n, 3)


def _place_columns(
    index: Sequence[int] | np.ndarray | None, columns: tuple[int, ...], n: int, places: wp.array | None
) -> tuple[int, ...]:
    """Return the index of the place of each body."""
    if index is None:
        return columns
    chosen = np.asarray(index)
    if places is None:
        raise SceneError("bind_poses: velocity_at_index= selects points of velocity_at=; give that too")
    if chosen.shape != (n,) or chosen.dtype.kind not in "iu" or not ((chosen >= 0) & (chosen < places.shape[1])).all():
        raise SceneError(
            f"bind_poses: velocity_at_index must be {n} whole numbers in 0..{places.shape[1] - 1}, got {index!r}"
        )
    return tuple(int(chosen[column]) for column in columns)


def _offsets(
    bodies: Sequence[Body],
    chosen: Sequence[Body],
    offsets: Mapping[Any, tuple[Any, Any]] | None,
    arrays: Mapping[str, wp.array],
) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return each body's position and quaternion in the frame that is given for it."""
    if not offsets:
        return ()
    if not {"position", "quaternion"} <= arrays.keys():
        raise SceneError("bind_poses: offsets= are in frames, which need position= and quaternion=")
    if "linear_velocity" in arrays and "angular_velocity" not in arrays:
        raise SceneError("bind_poses: with offsets= a linear_velocity= needs angular_velocity= too")
    found = {}
    for which, (position, quaternion) in offsets.items():
        body = find_body(bodies, which)
        place, turn = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
        length = np.linalg.norm(turn)
        if place.shape != (3,) or turn.shape != (4,) or not (np.isfinite(place).all() and 0 < length < np.inf):
            raise SceneError(
                f"bind_poses: offset of body {body.name!r}: expected 3 finite numbers [m] and a quaternion "
                f"(w, x, y, z), got {position!r} and {quaternion!r}"
            )
        if body not in chosen:
            raise SceneError(f"bind_poses: offset of body {body.name!r}: this body is not bound; add it to index=")
        found[body] = place, turn / length
    nowhere = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    return tuple(found.get(body, nowhere) for body in chosen)


def _chosen(
    bodies: Sequence[Body], index: Mapping[Any, int] | None, n: int
) -> tuple[tuple[Body, ...], tuple[int, ...]]:
    """Return the bodies whose poses are bound, and the index of each in the arrays."""
    if index is None:
        if n != len(bodies):
            raise SceneError(
                f"bind_poses: the arrays are of {n} bodies, the scene has {len(bodies)}; map bodies to rows with "
                "index={body: place}"
            )
        pairs = [(body, k) for k, body in enumerate(bodies) if not body.fixed]
    else:
        pairs = [(find_body(bodies, body), k) for body, k in index.items()]
    for body, k in pairs:
        if body.fixed:
            raise SceneError(f"bind_poses: body {body.name!r} is fixed; add it with fixed=False to move it")
        if isinstance(k, bool) or not isinstance(k, int) or not 0 <= k < n:
            raise SceneError(f"bind_poses: index of body {body.name!r} must be in 0..{n - 1}, got {k!r}")
    if not pairs:
        raise SceneError("bind_poses: there is no body to bind: all are fixed, or index is empty")
    return tuple(body for body, _ in pairs), tuple(k for _, k in pairs)
