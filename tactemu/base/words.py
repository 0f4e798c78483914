"""Genesis's words for our keywords: the one table, and the functions that apply it.

``Scene(names="genesis")``, and ``names = "genesis"`` in the table ``[scene]`` of a scene file, take these words beside
ours. Elsewhere they are unknown, and the message says ours.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal

import numpy as np

from tactemu.base.errors import SceneError, nearest, shown

Names = Literal["tactemu", "genesis"]
"""The words that a scene takes: ours, or Genesis's too."""


def quaternion_of_euler(degrees: Any) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of a rotation about the fixed axes x, then y, then z [degrees].

    Raises:
        SceneError: the angles are not three numbers.
    """
    try:
        half = np.radians(np.asarray(degrees, float)) / 2
    except (TypeError, ValueError):
        half = np.zeros(0)
    if half.shape != (3,):
        raise SceneError(f"expected three angles [degrees], got {shown(degrees)}")
    (cx, cy, cz), (sx, sy, sz) = np.cos(half).tolist(), np.sin(half).tolist()
    return (
        cx * cy * cz + sx * sy * sz,
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
    )


GENESIS: dict[str, str] = {
    "pos": "position",
    "quat": "quaternion",
    "euler": "quaternion",
    "envs_idx": "envs",
    "entity_idx": "link",
    "pos_offset": "position",
    "euler_offset": "quaternion",
    "probe_local_pos": "positions",
    "probe_local_normal": "normals",
    "probe_radius": "radius",
    "probe_radius_noise": "radius_noise",
    "probe_gain": "gain",
    "probe_gain_resample_range": "gain_range",
    "track_link_idx": "sense",
    "filter_link_idx": "ignore",
    "contact_depth_query": "depth_query",
}
"""Genesis's words, each with ours."""
CONVERTED: dict[str, Callable[[Any], Any]] = {"euler": quaternion_of_euler, "euler_offset": quaternion_of_euler}
"""The words whose values are written in another way, too."""
ONLY_LINK = "link_idx_local"
"""Genesis's number of a link within its entity; our bodies have one link each, so it may only be 0."""


def in_our_words(given: Mapping[str, Any], known: Collection[str] = tuple(GENESIS.values())) -> dict[str, Any]:
    """Return keywords and their values with Genesis's words replaced by ours, as far as ours are ``known``.

    Raises:
        SceneError: a value is given in both words, or cannot be written in ours.
    """
    found: dict[str, Any] = {}
    for word, value in given.items():
        if word == ONLY_LINK and "link" in known:
            if value != 0:
                raise SceneError(f"{word}: a body has one link, so it can only be 0, got {shown(value)}")
            continue
        ours = GENESIS.get(word, word)
        if word in known or ours not in known:
            ours = word
        elif word in CONVERTED:
            if given.get("order", "wxyz") != "wxyz":
                raise SceneError(f"{word}: angles have no order of a quaternion's numbers; leave out `order`")
            try:
                value = CONVERTED[word](value)
            except SceneError as error:
                raise SceneError(f"{word}: {error}") from None
        if ours in found or (ours != word and ours in given):
            raise SceneError(f"{ours} is given twice, also as {word!r}; give it once")
        found[ours] = value
    return found


def hint(word: object, known: Collection[str]) -> str:
    """Return the hint of a message about an unknown word: ours if it is Genesis's, else the nearest known one."""
    ours = GENESIS.get(word) if isinstance(word, str) else None
    if ours in known:
        return f'; {word!r} is Genesis\'s word for {ours!r} (a scene with names="genesis" takes it)'
    return nearest(word, known)
