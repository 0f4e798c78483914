"""The picture of taxels in a terminal: grids as grids, free layouts by position, as large as the screen allows."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from rich.console import Group, RenderableType
from rich.style import Style
from rich.table import Table
from rich.text import Text

from firmware_protocols.layouts import Layout, Patch
from tactemu.base.style import colours

SHADES = "·░▒▓█"
GAP = 3
"""Characters between two patches."""
MAX_COLUMNS = 24
"""Maximum number of columns, and of rows, of the picture of a patch that is no grid."""


def taxel_magnitudes(layout: Layout, senses: str, values: np.ndarray) -> np.ndarray:
    """Return the magnitude of each taxel's reading, shape ``(n_taxels,)``: normal force [N], pressure [Pa], depth
    [m] ...
    """
    values = np.asarray(values, float)
    if senses == "force":
        return 0.0 - (values * layout.normals).sum(axis=-1)
    return np.linalg.norm(values, axis=-1) if values.ndim == 2 else values


def draw(layout: Layout, values: np.ndarray, peak: float, *, patch: Patch | None = None, pool: int = 1) -> Text:
    """Return a heat map of one patch (default: the first), ``values`` of shape ``(n_taxels,)`` from 0 to ``peak``.

    Blocks of ``pool`` by ``pool`` cells are drawn as one.
    """
    patch = patch or layout.patches[0]
    places = cells(layout, patch) // pool
    level = np.clip(values[patch.taxels] / peak, 0.0, 1.0) if peak > 0 else np.zeros(len(values[patch.taxels]))
    picture = np.full(places.max(axis=0) + 1, EMPTY)
    np.maximum.at(picture, tuple(places.T), np.rint(level * (LEVELS - 1)).astype(int))  # a block has its largest value
    text = Text(no_wrap=True)
    for number, row in enumerate(picture.tolist()):
        text.append("\n" if number else "")
        for step, run in itertools.groupby(row):
            character, style = INK[step]
            text.append(character * (2 * len(list(run))), style)
    return text


def draw_all(layout: Layout, values: np.ndarray, peak: float, width: int, height: int) -> RenderableType:
    """Return heat maps of all patches with their names, side by side, pooled until they fit ``width`` by ``height``
    characters.

    If even one character per patch is too large, the first patches are drawn and the others counted.
    """
    sizes = [cells(layout, patch).max(axis=0) + 1 for patch in layout.patches]
    pool, most = 1, max(int(size.max()) for size in sizes)
    rows = _rows(layout, sizes, pool, width)
    while pool < most and (_height(rows) > height or any(block.width > width for row in rows for block in row)):
        pool += 1
        rows = _rows(layout, sizes, pool, width)
    if len(layout.patches) == 1:
        return draw(layout, values, peak, pool=pool) if height > 0 else Text()
    shown = list(rows)
    while shown and _height(shown) + (len(shown) < len(rows)) > height:
        shown.pop()
    lines: list[RenderableType] = []
    for row in shown:
        line = Table.grid(padding=(0, GAP))
        line.add_row(
            *(
                Group(draw(layout, values, peak, patch=each.patch, pool=pool), Text(each.patch.name, style="dim"))
                for each in row
            )
        )
        lines.append(line)
    left = sum(map(len, rows)) - sum(map(len, shown))
    return Group(*lines, *([Text(f"and {left} more patches", style="dim")] if left and height > 0 else []))


class _Block(NamedTuple):
    """The size of a drawn patch, including its name, in characters."""

    patch: Patch
    width: int
    height: int


def _rows(layout: Layout, sizes: list[np.ndarray], pool: int, width: int) -> list[list[_Block]]:
    """Return the patches in rows that are no wider than ``width``."""
    rows: list[list[_Block]] = []
    named = len(layout.patches) > 1
    free = 0
    for patch, size in zip(layout.patches, sizes, strict=True):
        high, wide = (-(-int(extent) // pool) for extent in size)
        block = _Block(patch, max(2 * wide, len(patch.name) * named), high + named)
        if not rows or free < block.width:
            rows.append([])
            free = width
        rows[-1].append(block)
        free -= block.width + GAP
    return rows


def _height(rows: list[list[_Block]]) -> int:
    return sum(max(block.height for block in row) for row in rows)


def cells(layout: Layout, patch: Patch) -> np.ndarray:
    """Return row and column of each taxel of a patch in its picture, shape ``(n, 2)``."""
    if patch.rows:
        return np.stack(np.divmod(np.arange(patch.rows * patch.cols), patch.cols), axis=1)
    flat = flattened(layout.positions[patch.taxels], layout.normals[patch.taxels])
    flat -= flat.min(axis=0)
    step = max(patch.pitch, float(flat.max(initial=0.0)) / (MAX_COLUMNS - 1), 1e-9)
    columns, rows = np.rint(flat / step).astype(int).T
    return np.stack([rows.max() - rows, columns], axis=1)


def flattened(positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return positions seen from outside along the mean normal, shape ``(n, 2)`` [m]: x to the right, y up."""
    normal = normals.mean(axis=0)
    normal = normal / np.linalg.norm(normal) if np.linalg.norm(normal) > 1e-6 else np.array([0.0, 0.0, 1.0])
    seed = np.array([0.0, 1.0, 0.0]) if abs(normal[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    right = seed - normal * (seed @ normal)
    right /= np.linalg.norm(right)
    return positions @ np.stack([right, np.cross(normal, right)], axis=1)


def _ink(step: int) -> tuple[str, Style]:
    value = step / (LEVELS - 1)
    shade = SHADES[0] if step == 0 else SHADES[min(1 + int(value * (len(SHADES) - 1)), len(SHADES) - 1)]
    red, green, blue = (255 * colours(value)).round().astype(int)
    return shade, Style(color=f"rgb({red},{green},{blue})")


LEVELS = 33
EMPTY = -1
INK: dict[int, tuple[str, Style]] = {EMPTY: (" ", Style()), **{step: _ink(step) for step in range(LEVELS)}}
"""Character and colour of each level, and of a cell without taxel."""
