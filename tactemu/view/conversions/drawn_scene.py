"""The bodies and skins that a log describes, as arrays; and the values of a sample as a table of taxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tactemu.truth.entries import Header, Sample

WORLD = "world"
_ROW_PITCH_M = 0.002
"""The distance between the taxels of a skin without positions, which are drawn in a row."""


@dataclass(frozen=True)
class Part:
    """Taxels on one body."""

    name: str
    body: str
    position: np.ndarray
    """Position of the part's frame on the body [m]."""
    quaternion: np.ndarray
    """Orientation of the part's frame on the body (w, x, y, z)."""
    taxels: np.ndarray
    """The indices of the taxels in the readings."""
    positions: np.ndarray
    """Positions of the taxels in the part's frame [m], shape ``(n, 3)``."""
    normals: np.ndarray
    draw: Mapping[str, Any] | None = None
    """The colours and radii of its probes; None: they are not drawn."""


@dataclass(frozen=True)
class DrawnBody:
    """A body and its initial pose."""

    name: str
    shape: str
    outline: Mapping[str, Any]
    position: Sequence[float]
    quaternion: Sequence[float]
    points: Mapping[str, Any] | None = None
    """``positions`` that a sensor has sampled on it, in its frame [m], ``color``, ``radius``; None: not drawn."""


class DrawnScene:
    """The bodies and skins of a log.

    Args:
        header: the header of the log; without a scene there are no bodies, and taxels lie in rows.

    Raises:
        ValueError: the description is malformed.
    """

    def __init__(self, header: Header):
        scene = header.scene or {}
        try:
            self.bodies = [_body(each) for each in scene.get("bodies", ())]
            self.skins: dict[str, Mapping[str, Any]] = dict(scene.get("skins", {}))
            self._parts = {name: [_part(each) for each in skin["parts"]] for name, skin in self.skins.items()}
            self._lone = {name: _lone(name, skin) for name, skin in self.skins.items()}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"the description of the scene: {error!r}") from None

    def parts(self, sample: Sample) -> list[Part]:
        """Return the parts of a sample's skin; one part in a row, if the log has no positions for it."""
        parts = self._parts.get(sample.device) or self._lone.get(sample.device) or []
        n = len(np.atleast_1d(sample.ideal))
        if sum(len(part.taxels) for part in parts) == n:
            return parts
        name = "/".join(filter(None, (sample.device, sample.sense)))
        x = (np.arange(n) - (n - 1) / 2) * _ROW_PITCH_M
        return [_bare(name, np.stack([x, 0 * x, 0 * x], axis=1))]

    def columns(self, device: str, sense: str) -> list[str]:
        """Return the names of the counts of a taxel, as far as the device names them."""
        columns = self.skins.get(device, {}).get("columns", ())
        return [each["name"] for each in columns if each["sense"] in ("", sense) or not sense]

    def patches(self, device: str) -> Sequence[Mapping[str, Any]]:
        """Return the patches of a skin: ``name``, ``start``, ``rows``, ``cols``."""
        return self.skins.get(device, {}).get("patches", ())


def _body(given: Mapping[str, Any]) -> DrawnBody:
    names = ("name", "shape", "outline", "position", "quaternion")
    return DrawnBody(**{name: given[name] for name in names}, points=given.get("points"))


def _part(given: Mapping[str, Any]) -> Part:
    pose = {name: np.array(given[name], float) for name in ("position", "quaternion")}
    points = {name: np.array(given[name], float).reshape(-1, 3) for name in ("positions", "normals")}
    taxels = np.array(given["taxels"], int)
    if len(points["positions"]) != len(taxels):
        raise ValueError(f"{given['name']}: {len(points['positions'])} positions of {len(taxels)} taxels")
    return Part(given["name"], given["body"], **pose, taxels=taxels, **points, draw=given.get("draw"))


def _lone(name: str, skin: Mapping[str, Any]) -> list[Part]:
    """Return the part of a skin that is on no body, in a list; an empty one without positions."""
    positions = np.array(skin["positions"], float).reshape(-1, 3)
    return [_bare(name, positions)] if len(positions) else []


def _bare(name: str, positions: np.ndarray) -> Part:
    n = len(positions)
    return Part(
        name, WORLD, np.zeros(3), np.array([1.0, 0, 0, 0]), np.arange(n), positions, np.tile((0.0, 0.0, 1.0), (n, 1))
    )


class TaxelTable:
    """The memory layout of the values of one skin's samples, a row for each taxel, for point clouds.

    Args:
        sample: a sample of the skin.
        part: the taxels.
        columns: the names of the counts.
    """

    def __init__(self, sample: Sample, part: Part, columns: Sequence[str]):
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
