"""Pictures of skins: a square of colour for each taxel, skins side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from firmware_protocols.layouts import Layout, Patch
from tactemu.base.style import colours
from tactemu.session.heatmap import cells

if TYPE_CHECKING:
    from tactemu.envs.observations import SkinField
    from tactemu.envs.task import SkinTask
    from tactemu.sensors.sensor import Sensor

_TAXEL_PIXELS = 16
"""Side of a taxel's square [pixels]."""
_GAP_PIXELS = 8
"""Width of the gaps around skins [pixels]."""


class SkinPictures:
    """Pictures of the first observed field of each skin.

    Args:
        task: the task whose skins are drawn.
    """

    def __init__(self, task: SkinTask):
        self._task = task
        self._fields: dict[str, SkinField] = {}
        for field in task.fields:
            self._fields.setdefault(field.skin, field)
        self._places = {name: _places(task.skin(name)) for name in self._fields}
        self._largest = dict.fromkeys(self._fields, 0.0)
        """The largest magnitude so far, which has the brightest colour."""

    def draw(self) -> tuple[np.ndarray, ...]:
        """Return a picture of each environment, RGB, uint8, ``(height, width, 3)``."""
        sizes = {name: self._magnitudes(field) for name, field in self._fields.items()}
        for name, size in sizes.items():
            self._largest[name] = max(self._largest[name], float(np.nanmax(size, initial=0.0)))
        return tuple(self._draw({name: size[e] for name, size in sizes.items()}) for e in range(self._task.num_envs))

    def _magnitudes(self, field: SkinField) -> np.ndarray:
        """Return the magnitude at each taxel, ``(n_envs, n_taxels)``; of a history the newest."""
        values = getattr(self._task.skin(field.skin).arrays, field.field).numpy()
        vector = len(field.space.shape) > len(field.taxels)
        values = values.reshape(len(values), *field.taxels, -1) if not vector else values
        size = np.linalg.norm(values, axis=-1)
        return (size[:, 0] if field.history else size).reshape(len(values), -1)

    def _draw(self, sizes: dict[str, np.ndarray]) -> np.ndarray:
        tiles = []
        for name, size in sizes.items():
            places = self._places[name]
            rows, cols = places.max(axis=0) + 1
            pixels = np.zeros((rows, cols, 3), np.uint8)
            shares = size / (self._largest[name] or 1.0)
            pixels[places[:, 0], places[:, 1]] = (255 * colours(shares)).round()
            tiles.append(pixels.repeat(_TAXEL_PIXELS, axis=0).repeat(_TAXEL_PIXELS, axis=1))
        height = max((tile.shape[0] for tile in tiles), default=0) + 2 * _GAP_PIXELS
        width = sum(tile.shape[1] + _GAP_PIXELS for tile in tiles) + _GAP_PIXELS
        picture = np.zeros((height, width, 3), np.uint8)
        left = _GAP_PIXELS
        for tile in tiles:
            picture[_GAP_PIXELS : _GAP_PIXELS + tile.shape[0], left : left + tile.shape[1]] = tile
            left += tile.shape[1] + _GAP_PIXELS
        return picture


def _places(sensor: Sensor) -> np.ndarray:
    """Return row and column of each taxel in the picture, ``(n_taxels, 2)``."""
    rows, cols = sensor.layout if len(sensor.layout) == 2 else (0, sensor.n_taxels)
    patch = Patch(name=sensor.name, start=0, rows=rows, cols=cols)
    positions, normals = sensor.positions.reshape(-1, 3), sensor.normals.reshape(-1, 3)
    return cells(Layout(positions=positions, normals=normals, patches=(patch,)), patch)
