"""The outline of a hand around patches that lie on its fingers: capsules and a palm.

Devices say where their taxels are, and scenes without a physics engine say no more of a hand. These links show which
patch is on which finger; they are a drawing, and touch nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tactemu.view.page.shapes import Mesh, capsule, joined, rounded

_FINGER = re.compile(r"(thumb|index|middle|ring|little|pinky|finger[ _]?\d+)(?![a-z])", re.IGNORECASE)
_PALM = re.compile(r"(palm|back|thenar|hypothenar)", re.IGNORECASE)
MIN_FINGERS = 3
_UP = 0.35
"""The least mean z of the normals of a finger's taxels: layouts of hands have the palm's side up, fingers along y."""
_LENGTHS = {"thumb": 2.6, "index": 3.2, "middle": 3.5, "ring": 3.3, "little": 2.7, "pinky": 2.7}
"""Usual lengths of fingers, in distances between neighbours."""
_JOINTS = {"thumb": (0.5,)}
"""The places of a finger's joints on its length, from the palm on."""
_TAPER = 0.2
"""The share by which the palm is narrower at the wrist than at the knuckles."""
_USUAL_JOINTS = (0.45, 0.74)


@dataclass(frozen=True)
class Finger:
    """A finger: its axis from the palm to its end [m], and its radius [m]."""

    name: str
    begin: np.ndarray
    end: np.ndarray
    radius: float

    def links(self) -> list[Mesh]:
        """Return a capsule for each link; joints are narrower."""
        places = [0.0, *_JOINTS.get(self.name, _USUAL_JOINTS), 1.0]
        points = [self.begin + share * (self.end - self.begin) for share in places]
        gap = 0.55 * self.radius * (self.end - self.begin) / np.linalg.norm(self.end - self.begin)
        meshes = [capsule(a + gap, b - gap, self.radius) for a, b in pairwise(points)]
        return [*meshes, *(capsule(point, point, 0.8 * self.radius) for point in points[:-1])]


def finger_of(patch: str) -> str | None:
    """Return the name of the finger in a patch's name, or None."""
    found = _FINGER.search(patch)
    return found.group(1).lower() if found else None


def hand(patches: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Mesh | None:
    """Return the outline of a hand, or None if the patches are not those of a hand.

    Args:
        patches: positions [m] and normals of the taxels of each patch, in one frame.
    """
    groups: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    palm = [taxels[0] for name, taxels in patches.items() if _PALM.search(name)]
    for name, taxels in patches.items():
        if (finger := finger_of(name)) and len(taxels[0]):
            groups.setdefault(finger, []).append(taxels)
    if len(groups) < MIN_FINGERS:
        return None
    places = {name: np.concatenate([each[0] for each in group]) for name, group in groups.items()}
    if any(np.concatenate([n for _, n in group])[:, 2].mean() < _UP for group in groups.values()):
        return None
    fingers = [name for name in places if name != "thumb"]
    x = np.sort([places[name][:, 0].mean() for name in fingers])
    spacing = float(np.median(np.diff(x))) if len(x) > 1 else 0.022
    if spacing <= 1e-3:
        return None
    return _drawn(places, palm, fingers, spacing)


def _drawn(places: dict[str, np.ndarray], palm: list[np.ndarray], fingers: list[str], spacing: float) -> Mesh:
    least = max((float(each[:, 1].max()) for each in palm), default=-np.inf) + 0.35 * spacing
    drawn = [_finger(name, places[name], spacing, least) for name in fingers]
    x = [each.begin[0] for each in drawn]
    knuckles = min(float(each.begin[1]) for each in drawn)
    radius = float(np.median([each.radius for each in drawn]))
    depth = float(np.median([each.begin[2] for each in drawn]))
    width = (max(x) - min(x)) / 2 + 1.25 * radius
    low = min([knuckles - 3.1 * spacing, *(float(each[:, 1].min()) - 0.5 * spacing for each in palm)])
    centre = np.array([(max(x) + min(x)) / 2, (low + knuckles) / 2 + 0.3 * radius, depth])
    half = (width, (knuckles - low) / 2 + 0.3 * radius, 1.05 * radius)
    meshes = [link for each in drawn for link in each.links()]
    meshes.append(_palm(half, 1.04 * radius).moved(np.eye(3), centre))
    if "thumb" in places:
        taxels = places["thumb"]
        end = _finger("thumb", taxels, spacing, -np.inf)
        side = np.sign(taxels[:, 0].mean() - centre[0]) or 1.0
        root = np.array(
            [centre[0] + side * (0.9 * width - 0.9 * radius), low + 0.9 * spacing, end.end[2] - 0.25 * radius]
        )
        base = np.array(
            [end.end[0], max(float(taxels[:, 1].min()) - 1.2 * radius, low + spacing), end.end[2] - 0.25 * radius]
        )
        meshes += [
            capsule(root, base, 1.15 * radius),
            capsule(base + np.array([0.0, 0.0, 0.25 * radius]), end.end, end.radius),
        ]
    return joined(meshes)


def _palm(half: tuple[float, float, float], radius: float) -> Mesh:
    """Return a rounded box that is narrower at the wrist."""
    mesh = rounded(half, radius, 3)
    x, y, z = mesh.vertices.T
    return Mesh(np.stack([x * (1 - _TAPER * (1 - y / half[1]) / 2), y, z], axis=1), mesh.faces)


def _finger(name: str, taxels: np.ndarray, spacing: float, least: float) -> Finger:
    """Return a finger below its taxels: they lie on its skin."""
    wide = float(np.ptp(taxels[:, 0])) / 2 + 0.0015
    radius = min(max(0.95 * wide, 0.27 * spacing), 0.44 * spacing)
    thick = float(np.ptp(taxels[:, 2]))
    is_wrapped = thick > 0.3 * radius
    z = float(taxels[:, 2].max()) - radius - 0.0007
    if is_wrapped:  # the finger ends inside its taxels
        z = float(taxels[:, 2].min()) + 0.25 * thick
        across = np.hypot(taxels[:, 0] - taxels[:, 0].mean(), taxels[:, 2] - z)
        radius = max(0.9 * float(np.percentile(across, 20)), 0.2 * spacing)
    x, tip = float(taxels[:, 0].mean()), float(taxels[:, 1].max()) + 0.25 * radius
    length = _LENGTHS.get(name, 3.2) * spacing
    begin = min(max(tip - length, least), float(taxels[:, 1].min()) - 0.6 * spacing)
    end = tip - (1.9 if is_wrapped else 1.0) * radius
    return Finger(name, np.array([x, begin, z]), np.array([x, max(end, begin + 1e-3), z]), radius)
