"""What a log says of where things are, as arrays; and the values of a sample as a table of taxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tactemu.truth.entries import Header, Sample

WORLD = "world"
_STEP_M = 0.002
"""Between the taxels of a skin of which nobody says where it is: they are drawn in a row."""


@dataclass(frozen=True)
class Part:
    """Taxels on one body."""

    name: str
    body: str
    position: np.ndarray
    """Of the frame that ``positions`` are in, on the body [m]."""
    quaternion: np.ndarray
    """(w, x, y, z)."""
    taxels: np.ndarray
    """Their places in the readings."""
    positions: np.ndarray
    """[m], shape ``(n, 3)``."""
    normals: np.ndarray
    draw: Mapping[str, Any] | None = None
    """How its probes are drawn; ``None``: they are not."""


@dataclass(frozen=True)
class Body:
    """A body and where it starts."""

    name: str
    shape: str
    outline: Mapping[str, Any]
    position: Sequence[float]
    quaternion: Sequence[float]
    points: Mapping[str, Any] | None = None
    """``positions`` that a sensor has sampled on it, in its frame [m], ``color``, ``radius``; ``None``: not drawn."""


class Described:
    """The scene of a log.

    Args:
        header: of the log; one that says nothing of the scene leaves bodies out, and taxels in rows.

    Raises:
        ValueError: the description is not one.
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
        """Where the points of a sample are; by themselves, in a row, where nobody says it."""
        parts = self._parts.get(sample.device) or self._lone.get(sample.device) or []
        n = len(np.atleast_1d(sample.ideal))
        if sum(len(part.taxels) for part in parts) == n:
            return parts
        name = "/".join(filter(None, (sample.device, sample.sense)))
        x = (np.arange(n) - (n - 1) / 2) * _STEP_M
        return [_bare(name, np.stack([x, 0 * x, 0 * x], axis=1))]

    def columns(self, device: str, sense: str) -> list[str]:
        """Return names of what a device decodes of a point, as far as it says."""
        columns = self.skins.get(device, {}).get("columns", ())
        return [each["name"] for each in columns if each["sense"] in ("", sense) or not sense]

    def patches(self, device: str) -> Sequence[Mapping[str, Any]]:
        """Of a skin: ``name``, ``start``, ``rows``, ``cols``."""
        return self.skins.get(device, {}).get("patches", ())


def _body(given: Mapping[str, Any]) -> Body:
    names = ("name", "shape", "outline", "position", "quaternion")
    return Body(**{name: given[name] for name in names}, points=given.get("points"))


def _part(given: Mapping[str, Any]) -> Part:
    pose = {name: np.array(given[name], float) for name in ("position", "quaternion")}
    points = {name: np.array(given[name], float).reshape(-1, 3) for name in ("positions", "normals")}
    taxels = np.array(given["taxels"], int)
    if len(points["positions"]) != len(taxels):
        raise ValueError(f"{given['name']}: {len(points['positions'])} positions of {len(taxels)} taxels")
    return Part(given["name"], given["body"], **pose, taxels=taxels, **points, draw=given.get("draw"))


def _lone(name: str, skin: Mapping[str, Any]) -> list[Part]:
    """Return a skin that is on no body."""
    positions = np.array(skin["positions"], float).reshape(-1, 3)
    return [_bare(name, positions)] if len(positions) else []


def _bare(name: str, positions: np.ndarray) -> Part:
    n = len(positions)
    return Part(
        name, WORLD, np.zeros(3), np.array([1.0, 0, 0, 0]), np.arange(n), positions, np.tile((0.0, 0.0, 1.0), (n, 1))
    )


class TaxelTable:
    """How the values of samples of one kind lie in memory, a row for each taxel: what point clouds are made of.

    Args:
        sample: one of them.
        part: the taxels.
        columns: names of the counts.
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
        """Bytes of a row."""
        return self.dtype.itemsize


def _named(name: str, count: int, columns: Sequence[str]) -> list[str]:
    """Return names of the numbers of a taxel: ``ideal``, ``ideal_x`` ..., ``counts_Bx`` ..."""
    if name == "counts" and len(set(columns)) == count:
        return [f"{name}_{each.replace(' ', '_')}" for each in columns]
    if count == 1:
        return [name]
    return [f"{name}_{axis}" for axis in ("xyz" if count == 3 and name != "counts" else range(count))]


def _portable(dtype: np.dtype) -> np.dtype:
    """Return the nearest type that point clouds have: no truth values, no integers of 64 bits."""
    if dtype.kind == "b":
        return np.dtype("u1")
    if dtype.kind in "iu" and dtype.itemsize == 8:
        return np.dtype("<f8")
    return dtype.newbyteorder("<")
