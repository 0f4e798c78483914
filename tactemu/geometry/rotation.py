"""Operations on unit quaternions (w, x, y, z) in float64, as poses and motions need them.

``trimesh.transformations`` has them too, but takes 1 s to import and ten times as long for a matrix, of which every
step needs several; and it rounds in another order, which would change readings.
"""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

import numpy as np

from tactemu.base.errors import SceneError

IDENTITY = (1.0, 0.0, 0.0, 0.0)
Order = Literal["wxyz", "xyzw"]
"""An order in which a quaternion's numbers may be given."""
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def wxyz(quaternion: Any, order: str, where: str) -> Any:
    """Return quaternions ``(..., 4)`` given in another order of their numbers as w, x, y, z.

    Args:
        quaternion: numbers of any shape ``(..., 4)``; ``None`` and what is no numbers is returned as it is.
        order: ``wxyz`` or ``xyzw``.
        where: the place for the message.

    Raises:
        SceneError: there is no such order.
    """
    if order not in get_args(Order):
        raise SceneError(f"{where}: order must be one of {', '.join(get_args(Order))}, got {order!r}")
    if quaternion is None or order == "wxyz":
        return quaternion
    try:
        return np.roll(np.asarray(quaternion, np.float64), 1, axis=-1)
    except (TypeError, ValueError):  # the caller's own message says what is wrong
        return quaternion


def normalised(quaternion) -> np.ndarray:
    """Return the unit quaternion along ``quaternion``.

    Raises:
        ValueError: ``quaternion`` is not four finite numbers, or has length zero.
    """
    q = np.asarray(quaternion, np.float64)
    largest = np.abs(q).max() if q.shape == (4,) else math.nan
    if not 0.0 < largest < math.inf:
        raise ValueError(f"expected a quaternion (w, x, y, z) that is finite and not zero, got {quaternion}")
    if not 1e-100 < largest < 1e100:  # so that no square under- or overflows
        q = q / largest
    return q / math.sqrt(float(q @ q))


def multiply(a, b) -> np.ndarray:
    """Return the rotation ``b`` followed by ``a``, both in the same fixed axes."""
    aw, ax, ay, az = map(float, a)
    bw, bx, by, bz = map(float, b)
    return np.array(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        )
    )


def multiply_many(a, b) -> np.ndarray:
    """Return the products of many pairs of quaternions, ``(n, 4)``; either argument may be a single one."""
    a, b = np.broadcast_arrays(np.atleast_2d(a), np.atleast_2d(b))
    real = a[:, 0] * b[:, 0] - np.einsum("ij,ij->i", a[:, 1:], b[:, 1:])
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + cross_many(a[:, 1:], b[:, 1:])
    return np.concatenate([real[:, None], vector], axis=1)


def rotate_many(q, v) -> np.ndarray:
    """Return vectors turned each by its own unit quaternion, ``(n, 3)``; either argument may be a single one."""
    q, v = np.atleast_2d(q), np.atleast_2d(v)
    twice = 2.0 * cross_many(q[:, 1:], v)
    return v + q[:, :1] * twice + cross_many(q[:, 1:], twice)


def between_many(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the rotation vectors [rad] from one orientation to another, the shorter way, ``(n, 3)``."""
    q = multiply_many(after, before * (1.0, -1.0, -1.0, -1.0))
    q = np.where(q[:, :1] < 0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
    return np.where(sine < 1e-12, 2.0, 2.0 * np.arctan2(sine, q[:, :1]) / np.maximum(sine, 1e-12)) * q[:, 1:]


def cross_many(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products of vectors, ``(n, 3)``; for few of them ``np.cross`` is slow, since it handles axes."""
    return a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]


def conjugate(q) -> np.ndarray:
    """Return the inverse of a unit quaternion."""
    return np.array((q[0], -q[1], -q[2], -q[3]))


def matrix(q) -> np.ndarray:
    """Return the rotation matrix of a unit quaternion, shape ``(3, 3)``."""
    w, x, y, z = map(float, q)
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )


def rotate(q, v) -> np.ndarray:
    """Return vectors ``v``, shape ``(..., 3)``, turned by the unit quaternion ``q``."""
    return np.asarray(v, np.float64) @ matrix(q).T


def from_rotation_vector(vector) -> np.ndarray:
    """Return the rotation by ``|vector|`` [rad] about ``vector``."""
    vector = np.asarray(vector, np.float64)
    angle = math.sqrt(float(vector @ vector))
    scale = 0.5 if angle < 1e-12 else math.sin(angle / 2) / angle
    return np.array((math.cos(angle / 2), *(scale * vector)))


def to_rotation_vector(q) -> np.ndarray:
    """Return the axis of a rotation times its angle [rad], the shorter way round: the angle is in 0..pi."""
    q = np.asarray(q, np.float64)
    q = -q if q[0] < 0 else q
    sine = math.sqrt(float(q[1:] @ q[1:]))
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, q[0]) / sine
    return scale * q[1:]
