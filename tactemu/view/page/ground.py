"""The ground below a scene: a grid of known size, and soft shadows of what stands above it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np
import viser

from tactemu.geometry import rotation
from tactemu.view.page.lights import shown, unlit_model
from tactemu.view.page.shapes import Mesh

_SHADOW_CELLS = 96
_SHADOW_SIZE, _GRID_SIZE = 1.5, 3.0
"""The widths of the picture of the shadows and of the grid [extents of the scene]."""
_MAX_LINES = 34
"""Maximum number of lines of the grid in a direction."""
_PIECES = 24
"""Number of pieces of a line, which fade away from the scene."""
_GRID = np.array([0.5, 0.54, 0.6])
"""The colour of the grid, which is mixed with the page's background, dark or light."""
_LIFT = 2e-3
"""The height of the shadows above the floor [extents of the scene]."""
_INTERVAL_S = 0.2
"""The shortest time between two pictures of the shadows: each is sent to all viewers."""

Points = Mapping[str, np.ndarray]
"""Points on the surface of each body, in its frame [m]."""


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5, 10 ... that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)) * power)


class Ground:
    """The grid, and the shadows on it.

    Args:
        scene: viser's scene.
        points: points of the surfaces that throw shadows.
        places: points in the world that the ground is made for, in groups [m].
        height: height of the floor [m]; default: below the lowest point.
    """

    def __init__(self, scene: viser.SceneApi, points: Points, places: Sequence[np.ndarray], height: float | None):
        self._points = points
        cloud = np.concatenate([np.zeros((0, 3)), *places])
        low, high = (cloud.min(axis=0), cloud.max(axis=0)) if len(cloud) else (np.zeros(3), np.zeros(3))
        self._extent = max(float(np.linalg.norm((high - low)[:2])), 0.6 * float(high[2] - low[2]), 0.01)
        gap = 0.01 * self._extent
        self.height = float(low[2]) - gap if height is None else height
        self._width = _SHADOW_SIZE * self._extent
        self.step = round_length(2 * _GRID_SIZE * self._extent / _MAX_LINES)
        middle = np.round((low + high)[:2] / 2 / self.step) * self.step
        self._corner = middle - self._width / 2
        self._last: np.ndarray | None = None
        self._next_s = 0.0
        self._add_grid(scene, middle)
        self._shadow = scene.add_image(
            "/floor/shadow", np.zeros((_SHADOW_CELLS, _SHADOW_CELLS, 4), np.uint8),
            self._width, self._width, format="png", cast_shadow=False, receive_shadow=False,
            position=(*middle, self.height + _LIFT * self._extent),
        )  # fmt: skip

    def _add_grid(self, scene: viser.SceneApi, middle: np.ndarray) -> None:
        """Draw the lines as narrow strips of one mesh.

        A machine without a GPU takes too long for a picture of the whole floor; instances would be sorted each frame.
        """
        half = _GRID_SIZE * self._extent / 2
        across = self.step * np.arange(-int(half / self.step), int(half / self.step) + 1)
        along = half * (2 * (np.arange(_PIECES) + 0.5) / _PIECES - 1)
        a, b = (each.ravel() for each in np.meshgrid(across, along))
        fade = np.clip(1 - np.hypot(a, b) / half, 0.0, 1.0)
        a, b, fade = a[fade > 0], b[fade > 0], fade[fade > 0]
        places = np.concatenate([np.stack([a, b], axis=1), np.stack([b, a], axis=1)]) + middle
        narrow, long = np.full(len(a), 2.6e-3 * self._extent), np.full(len(a), 2 * half / _PIECES)
        sizes = np.concatenate([np.stack([narrow, long], axis=1), np.stack([long, narrow], axis=1)])
        n = len(places)
        corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        flat = (places[:, None] + sizes[:, None] * corners).reshape(-1, 2)
        vertices = np.column_stack([flat, np.full(4 * n, self.height + 2 * _LIFT * self._extent)])
        faces = (4 * np.arange(n)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        colours = np.column_stack([np.tile(shown(_GRID), (4 * n, 1)), np.repeat(np.tile(0.5 * fade, 2), 4)])
        model = unlit_model(Mesh(vertices, faces), colours)
        scene.add_glb("/floor/grid", model, cast_shadow=False, receive_shadow=False)

    def draw(self, poses: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> None:
        """Draw the shadows anew if a body has moved, but not more often than a viewer needs."""
        now = time.monotonic()
        if now < self._next_s or not self._points:
            return
        known = np.concatenate([np.concatenate(poses[name]) for name in self._points])
        if self._last is not None and np.abs(known - self._last).max() < 1e-3 * self._extent:
            return
        self._next_s, self._last = now + _INTERVAL_S, known
        world = [rotation.rotate(poses[name][1], each) + poses[name][0] for name, each in self._points.items()]
        self._show(self._shadows(np.concatenate(world)))

    def _show(self, pixels: np.ndarray) -> None:
        """Show the part of the picture that has shadows: what one sees through costs time, too."""
        dark = pixels[..., 3] > 1
        if not dark.any():
            self._shadow.visible = False
            return
        (top, bottom), (left, right) = (np.flatnonzero(dark.any(axis=axis))[[0, -1]] for axis in (1, 0))
        cell = self._width / _SHADOW_CELLS
        self._shadow.image = pixels[top : bottom + 1, left : right + 1]
        self._shadow.render_width, self._shadow.render_height = (right + 1 - left) * cell, (bottom + 1 - top) * cell
        x, y = self._corner + cell * np.array([left + right + 1, top + bottom + 1]) / 2
        self._shadow.position = (float(x), float(y), self.height + _LIFT * self._extent)
        self._shadow.visible = True

    def _shadows(self, points: np.ndarray) -> np.ndarray:
        """Return the picture of the shadows of points: sharp where a body is near the floor, else soft."""
        above = np.maximum(points[:, 2] - self.height, 0.0) / self._extent
        cells = (points[:, :2] - self._corner) / self._width
        dark = np.zeros((_SHADOW_CELLS, _SHADOW_CELLS))
        for reach, width, strength in ((0.08, 1.6, 0.34), (0.5, 5.0, 0.34)):
            weights = np.exp(-((above / reach) ** 2))
            density, _, _ = np.histogram2d(
                cells[:, 1], cells[:, 0], bins=_SHADOW_CELLS, range=((0, 1), (0, 1)), weights=weights
            )
            dark += strength * (1 - np.exp(-1.3 * _blurred(np.minimum(density, 3.0), width)))
        pixels = np.zeros((_SHADOW_CELLS, _SHADOW_CELLS, 4), np.uint8)
        pixels[..., 3] = 255 * np.clip(dark, 0.0, 0.75)
        return pixels


def _blurred(cells: np.ndarray, width: float) -> np.ndarray:
    """Return cells blurred by a bell curve of a width [cells]."""
    at = np.arange(-int(3 * width), int(3 * width) + 1)
    kernel = np.exp(-0.5 * (at / width) ** 2)
    kernel /= kernel.sum()
    for _ in range(2):
        cells = np.stack([np.convolve(row, kernel, "same") for row in cells.T])
    return cells
