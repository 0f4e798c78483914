"""Poses from arrays that another simulator writes on the device: declared once, converted by one launch a step."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.physics.device_arrays import numbers_of, on_device, taken, view
from tactemu.physics.poses import POSE_WIDTH
from tactemu.plan.plan import Context, Stage
from tactemu.scene.bodies import Body, find

ORDERS = ("wxyz", "xyzw")
FLOATS = (wp.float32, wp.float64)
PARTS = {"position": 3, "quaternion": 4, "linear_velocity": 3, "angular_velocity": 3}
"""What may be bound, and its width."""


@functools.cache
def convert_kernel(types: tuple, scalar_last: bool, at_com: bool, at_points: bool):
    """Copies what is given into the world's poses. ``types``: of the four parts and of the places of the velocities,
    ``None`` for what is not given."""
    has_position, has_quaternion, has_velocity, has_spin, _ = (kind is not None for kind in types)
    position_t, quaternion_t, velocity_t, spin_t, place_t = (kind or wp.float32 for kind in types)
    f64 = wp.float64

    @wp.kernel(module="unique", enable_backward=False)
    def convert_poses(
        first_env: int,
        bodies: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        position: wp.array3d(dtype=position_t),
        quaternion: wp.array3d(dtype=quaternion_t),
        velocity: wp.array3d(dtype=velocity_t),
        spin: wp.array3d(dtype=spin_t),
        place: wp.array3d(dtype=place_t),
        # outputs
        world: wp.array3d(dtype=wp.float64),
    ):
        e, k = wp.tid()
        e += first_env
        b = bodies[k]
        c = columns[k]
        if wp.static(has_position):
            for i in range(3):
                world[b, e, i] = f64(position[e, c, i])
        if wp.static(has_quaternion):
            for i in range(4):
                world[b, e, 3 + i] = f64(quaternion[e, c, (i + wp.static(3 if scalar_last else 0)) % 4])
        if wp.static(has_spin):
            for i in range(3):
                world[b, e, 10 + i] = f64(spin[e, c, i])
        if wp.static(has_velocity):
            v = wp.vec3d(f64(velocity[e, c, 0]), f64(velocity[e, c, 1]), f64(velocity[e, c, 2]))
            if wp.static(at_com or at_points):  # of the body, at another place than its origin
                away = wp.vec3d(f64(place[e, c, 0]), f64(place[e, c, 1]), f64(place[e, c, 2]))
                if wp.static(at_com):
                    q = wp.quatd(world[b, e, 4], world[b, e, 5], world[b, e, 6], world[b, e, 3])
                    away = wp.quat_rotate(wp.normalize(q), away)
                else:
                    away = away - wp.vec3d(world[b, e, 0], world[b, e, 1], world[b, e, 2])
                w = wp.vec3d(world[b, e, 10], world[b, e, 11], world[b, e, 12])
                v = v - wp.cross(w, away)
            for i in range(3):
                world[b, e, 7 + i] = v[i]

    return convert_poses


@dataclass(kw_only=True)
class BoundPoses:
    """What :meth:`Simulation.bind_poses` was told, checked."""

    bodies: tuple[Body, ...]
    columns: tuple[int, ...]
    arrays: dict[str, wp.array]
    """``(n_envs, n, width)`` each, by the name of the part."""
    places: wp.array | None
    """Where velocities are taken: ``(n_envs, n, 3)``, in the body's frame (``com``) or in the world."""
    order: str
    at: str
    """``origin``, ``com`` or ``points``."""

    def stage(self, context: Context, world: wp.array) -> Stage:
        """What converts them, before all else."""
        given = [self.arrays.get(name) for name in PARTS] + [self.places]
        types = tuple(None if array is None else array.dtype for array in given)
        none = {kind: wp.zeros((0, 0, 0), dtype=kind, device=context.device) for kind in FLOATS}
        inputs = [
            wp.array([body.index for body in self.bodies], dtype=wp.int32, device=context.device),
            wp.array(self.columns, dtype=wp.int32, device=context.device),
            *(none[wp.float32] if array is None else array for array in given),
        ]
        kernel = convert_kernel(types, self.order == "xyzw", self.at == "com", self.at == "points")
        launch = context.record(kernel, (context.n_envs, len(self.bodies)), inputs, [world])
        words = ", ".join(self.arrays).replace("_", " ")
        reason = f"{words} of {', '.join(body.name for body in self.bodies)}, bound to arrays of another simulator"
        if any(self.arrays[name].dtype is wp.float32 for name in ("position",) if name in self.arrays):
            reason += "; float32 places a body to 0.06 µm at 1 m from the origin, 0.6 µm at 10 m"
        return Stage(name="bound poses", reason=reason, launch=launch)


def declared(
    bodies: Sequence[Body],
    context: Context,
    *,
    poses: Any,
    parts: Mapping[str, Any],
    order: str,
    velocity_at: Any,
    com: Any,
    index: Mapping[Any, int] | None,
) -> BoundPoses:
    """Check what :meth:`Simulation.bind_poses` is told.

    Raises:
        SceneError: in words, before anything is launched.
    """
    given = {name: value for name, value in parts.items() if value is not None}
    if poses is not None:
        if given or order != "wxyz" or not (isinstance(velocity_at, str) and velocity_at == "origin"):
            raise SceneError(
                "bind_poses: one array of poses has position, quaternion (w, x, y, z), velocity of the origin and "
                "angular velocity, 13 numbers; what lies otherwise is given as position=, quaternion=, ..."
            )
        starts = dict(zip(PARTS, (0, 3, 7, 10)))
        whole = _columns(poses, "poses", context, POSE_WIDTH)
        given = {name: (whole, starts[name]) for name in PARTS}
    if not given:
        raise SceneError(f"bind_poses: nothing is bound; give poses, or any of {', '.join(PARTS)}")
    if order not in ORDERS:
        raise SceneError(f"bind_poses: order must be one of {', '.join(ORDERS)}, got {order!r}")
    arrays = {name: _columns(value, name, context, PARTS[name]) for name, value in given.items()}
    widths = {name: array.shape[1] for name, array in arrays.items()}
    if len(set(widths.values())) > 1:
        said = ", ".join(f"{name} {n}" for name, n in widths.items())
        raise SceneError(f"bind_poses: the arrays are of different numbers of bodies: {said}")
    n = next(iter(widths.values()))
    at, places = _places(velocity_at, com, arrays, n, context)
    chosen, columns = _chosen(bodies, index, n)
    return BoundPoses(bodies=chosen, columns=columns, arrays=arrays, places=places, order=order, at=at)


def _columns(value: Any, name: str, context: Context, width: int, n_envs: int | None = None) -> wp.array:
    """An array, or ``(array, first number)``, as ``(n_envs, n, width)`` numbers over the same memory."""
    what, first = f"bind_poses: {name}", 0
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], int) and not isinstance(value[0], int):
        value, first = value
    array = numbers_of(taken(value, what))
    on_device(array, context.device, what)
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


def _places(velocity_at: Any, com: Any, arrays: Mapping[str, wp.array], n: int, context: Context):
    """Where velocities are taken, ``(word, array)``."""
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
    if found.shape[1] != n:
        raise SceneError(f"bind_poses: {name} is of {found.shape[1]} bodies, the other arrays are of {n}")
    return at, found


def _one_for_all(places: Any, n: int) -> bool:
    return isinstance(places, np.ndarray) and places.shape == (n, 3)


def _chosen(
    bodies: Sequence[Body], index: Mapping[Any, int] | None, n: int
) -> tuple[tuple[Body, ...], tuple[int, ...]]:
    """Bodies that are posed, and where each stands in the arrays."""
    if index is None:
        if n != len(bodies):
            raise SceneError(
                f"bind_poses: the arrays are of {n} bodies, the scene has {len(bodies)}; say by index={{body: place}} "
                "which of them are whose"
            )
        pairs = [(body, k) for k, body in enumerate(bodies) if not body.fixed]
    else:
        pairs = [(find(bodies, body), k) for body, k in index.items()]
    for body, k in pairs:
        if body.fixed:
            raise SceneError(f"bind_poses: body {body.name!r} is fixed; add it with fixed=False to move it")
        if body.motion is not None:
            raise SceneError(f"bind_poses: body {body.name!r} has a motion already")
        if isinstance(k, bool) or not isinstance(k, int) or not 0 <= k < n:
            raise SceneError(f"bind_poses: index of body {body.name!r} must be in 0..{n - 1}, got {k!r}")
    if not pairs:
        raise SceneError("bind_poses: no body to pose; all are fixed, or index is empty")
    return tuple(body for body, _ in pairs), tuple(k for _, k in pairs)
