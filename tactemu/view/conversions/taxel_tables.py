"""The parts of a described skin that a sample belongs to, and the values of a sample as a table of taxels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from firmware_protocols.layouts import Patch
from tactemu.scene.description import PartDescription, SceneDescription, SkinDescription
from tactemu.truth.entries import Sample

WORLD = "world"
_ROW_PITCH_M = 0.002
"""The distance between the taxels of a skin without positions, which are drawn in a row."""


def parts_of(scene: SceneDescription, sample: Sample) -> list[PartDescription]:
    """Return the parts of a sample's skin; one part in a row, if the log has no positions for it."""
    skin = scene.skins.get(sample.device, SkinDescription())
    parts = skin.parts or ([_on_no_body(sample.device, skin.positions)] if len(skin.positions) else [])
    n = len(np.atleast_1d(sample.ideal))
    if sum(len(part.taxels) for part in parts) == n:
        return parts
    name = "/".join(filter(None, (sample.device, sample.sense)))
    x = (np.arange(n) - (n - 1) / 2) * _ROW_PITCH_M
    return [_on_no_body(name, np.stack([x, 0 * x, 0 * x], axis=1))]


def _on_no_body(name: str, positions: np.ndarray) -> PartDescription:
    n, normals = len(positions), np.tile((0.0, 0.0, 1.0), (len(positions), 1))
    return PartDescription(name, WORLD, np.zeros(3), np.array([1.0, 0, 0, 0]), np.arange(n), positions, normals)


def tables_of(scene: SceneDescription, sample: Sample) -> list[TaxelTable]:
    """Return a table for each part of a sample's skin."""
    names = scene.skins.get(sample.device, SkinDescription()).column_names(sample.sense)
    return [TaxelTable(sample, part, names) for part in parts_of(scene, sample)]


def grids_of(scene: SceneDescription, device: str) -> list[Patch]:
    """Return the patches of a skin that have more than one row and column."""
    patches = scene.skins.get(device, SkinDescription()).patches
    return [patch for patch in patches if patch.rows > 1 and patch.cols > 1]


class TaxelTable:
    """The memory layout of the values of one skin's samples, a row for each taxel, for point clouds.

    Args:
        sample: a sample of the skin.
        part: the taxels.
        columns: the names of the counts.
    """

    def __init__(self, sample: Sample, part: PartDescription, columns: Sequence[str]):
        self.part = part
        n = len(sample.ideal)
        self._arrays = [name for name in ("ideal", "measured", "counts") if len(getattr(sample, name)) == n]
        self._names: dict[str, list[str]] = {}
        types = [(axis, np.dtype("<f4")) for axis in "xyz"]
        for name in self._arrays:
            values = np.asarray(getattr(sample, name)).reshape(n, -1)
            self._names[name] = _named(name, values.shape[1], columns)
            types += [(each, _portable(values.dtype)) for each in self._names[name]]
        self.dtype = np.dtype(types)
        self._rows = np.zeros(len(part.taxels), self.dtype)
        for k, axis in enumerate("xyz"):
            self._rows[axis] = part.positions[:, k]

    @property
    def fields(self) -> list[tuple[str, int, np.dtype]]:
        """Name, offset and type of each number of a row."""
        described: Any = self.dtype.fields
        return [(name, each[1], each[0]) for name, each in described.items()]

    def rows(self, sample: Sample) -> np.ndarray:
        """Return the table of a sample; the next call overwrites it."""
        for name in self._arrays:
            values = np.asarray(getattr(sample, name))
            values = values.reshape(len(values), -1)[self.part.taxels]
            for k, each in enumerate(self._names[name]):
                self._rows[each] = values[:, k]
        return self._rows

    @cached_property
    def stride(self) -> int:
        """The size of a row [bytes]."""
        return self.dtype.itemsize


def _named(name: str, count: int, columns: Sequence[str]) -> list[str]:
    """Return the names of the numbers of a taxel: ``ideal``, ``ideal_x`` ..., ``counts_Bx`` ..."""
    if name == "counts" and len(set(columns)) == count:
        return [f"{name}_{each.replace(' ', '_')}" for each in columns]
    if count == 1:
        return [name]
    return [f"{name}_{axis}" for axis in ("xyz" if count == 3 and name != "counts" else range(count))]


def _portable(dtype: np.dtype) -> np.dtype:
    """Return the nearest type that point clouds have: no booleans, no integers of 64 bits."""
    if dtype.kind == "b":
        return np.dtype("u1")
    if dtype.kind in "iu" and dtype.itemsize == 8:
        return np.dtype("<f8")
    return dtype.newbyteorder("<")
