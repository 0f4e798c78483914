"""The lines between the joints of a MuJoCo model, by which viewers draw the links of a hand as connected."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactemu.geometry import rotation

_FREE = 0
"""MuJoCo's number for a free joint."""


def skeleton(model: Any, geom: int) -> list[list[float]] | None:
    """Return the lines of a geom's link in the geom's frame, (x, y, z, x, y, z) [m], or None if it is no link.

    A link is a MuJoCo body that a joint moves relative to its parent, or that carries such a body. Its first geom has
    the lines: from its joint to the joints of the links that it carries, or to the middle of the geom if it carries
    none; without a joint of its own, from those joints to the nearest point of the geom.
    """
    body = int(model.geom_bodyid[geom])
    children = [int(k) for k in np.flatnonzero(model.body_parentid == body) if k and _anchor(model, int(k)) is not None]
    anchor = _anchor(model, body)
    if body == 0 or (anchor is None and not children):
        return None
    if geom != int(model.body_geomadr[body]):
        return []
    ends = [
        model.body_pos[child] + rotation.rotate(model.body_quat[child], np.asarray(_anchor(model, child)))
        for child in children
    ]
    back = rotation.conjugate(model.geom_quat[geom])
    here = [rotation.rotate(back, end - model.geom_pos[geom]) for end in ends]
    centre, half = np.split(model.geom_aabb[geom], 2)
    if anchor is None:
        lines = [(end, np.clip(end, centre - half, centre + half)) for end in here]
    else:
        begin = rotation.rotate(back, anchor - model.geom_pos[geom])
        lines = [(begin, end) for end in here or [centre]]
    return [[round(float(value), 7) for value in (*begin, *end)] for begin, end in lines]


def _anchor(model: Any, body: int) -> np.ndarray | None:
    """Return the place of a body's first joint in its frame, or None if it has none or is free."""
    if not model.body_jntnum[body] or model.jnt_type[model.body_jntadr[body]] == _FREE:
        return None
    return np.asarray(model.jnt_pos[model.body_jntadr[body]], float)
