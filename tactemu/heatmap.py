"""Taxels as a picture in a terminal: grids as grids, free layouts by position."""

from __future__ import annotations

import numpy as np
from rich.style import Style
from rich.text import Text

from firmware_protocols.device import Layout, Patch

SHADES = "·░▒▓█"
RAMP = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], float)
"""Dark to light, evenly spaced: readable for colour-blind eyes (viridis at five places)."""
MAX_COLUMNS = 40
"""A free layout is drawn no wider than this many cells."""


def felt(layout: Layout, senses: str, values: np.ndarray) -> np.ndarray:
    """One number per taxel, larger where more is felt, shape ``(n_taxels,)``: push [N], pressure [Pa], depth [m] ..."""
    values = np.asarray(values, float)
    if senses == "force":
        return 0.0 - (values * layout.normals).sum(axis=-1)
    return np.linalg.norm(values, axis=-1) if values.ndim == 2 else values


def draw(layout: Layout, values: np.ndarray, peak: float, *, patch: Patch | None = None) -> Text:
    """A heat map of one patch (default: the first), ``values`` of shape ``(n_taxels,)`` from 0 to ``peak``."""
    patch = patch or layout.patches[0]
    cells = _cells(layout, patch)
    level = np.clip(values[patch.taxels] / peak, 0.0, 1.0) if peak > 0 else np.zeros(len(cells))
    picture: dict[tuple[int, int], float] = {}
    for place, value in zip(cells, level, strict=True):  # where taxels share a cell, the strongest shows
        picture[place] = max(value, picture.get(place, 0.0))
    rows, cols = max(r for r, _ in picture) + 1, max(c for _, c in picture) + 1
    text = Text(no_wrap=True)
    for row in range(rows):
        for col in range(cols):
            value = picture.get((row, col))
            text.append("  " if value is None else _shade(value) * 2, style="" if value is None else _style(value))
        text.append("\n" if row < rows - 1 else "")
    return text


def _cells(layout: Layout, patch: Patch) -> list[tuple[int, int]]:
    """(row, column) of each taxel of a patch."""
    if patch.rows:
        return [divmod(k, patch.cols) for k in range(patch.rows * patch.cols)]
    flat = flattened(layout.positions[patch.taxels], layout.normals[patch.taxels])
    flat -= flat.min(axis=0)
    pitch = max(layout.pitch, flat[:, 0].max() / (MAX_COLUMNS - 1), 1e-9)
    columns, rows = np.rint(flat / pitch).astype(int).T
    return list(zip((rows.max() - rows).tolist(), columns.tolist(), strict=True))


def flattened(positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Positions seen from outside along the mean normal, shape ``(n, 2)`` [m]: x to the right, y up."""
    normal = normals.mean(axis=0)
    normal = normal / np.linalg.norm(normal) if np.linalg.norm(normal) > 1e-6 else np.array([0.0, 0.0, 1.0])
    seed = np.array([0.0, 1.0, 0.0]) if abs(normal[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    right = seed - normal * (seed @ normal)
    right /= np.linalg.norm(right)
    return positions @ np.stack([right, np.cross(normal, right)], axis=1)


def _shade(value: float) -> str:
    return SHADES[0] if value < 0.02 else SHADES[min(1 + int(value * (len(SHADES) - 1)), len(SHADES) - 1)]


def _style(value: float) -> Style:
    place = value * (len(RAMP) - 1)
    low = min(int(place), len(RAMP) - 2)
    red, green, blue = (RAMP[low] + (place - low) * (RAMP[low + 1] - RAMP[low])).round().astype(int)
    return Style(color=f"rgb({red},{green},{blue})")
