"""What a page knows of a running emulator: what is there, once, and then one state after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols.layouts import Layout, Patch
from tactemu.truth.entries import Header, Sample
from tactemu.view.conversions.surroundings import Described


@dataclass(frozen=True)
class Skin:
    """A skin as the emulator describes it."""

    name: str
    device: str
    title: str
    layout: Layout
    rest: np.ndarray
    """Counts of a taxel that nobody touches, one for each column."""
    about: Mapping[str, Any]
    """The rest of what is said of its device."""


class Known:
    """What is there.

    Args:
        description: as the command `describe` gives it.

    Raises:
        ValueError: it is none.
    """

    def __init__(self, description: Mapping[str, Any]):
        scene = description.get("scene", {})
        self.described = Described(Header(scene=scene))
        devices = description.get("devices", {})
        self.skins = {name: _skin(name, each, devices.get(name, {})) for name, each in scene.get("skins", {}).items()}


def _skin(name: str, described: Mapping[str, Any], about: Mapping[str, Any]) -> Skin:
    patches = tuple(Patch(**each) for each in described["patches"])
    layout = Layout(
        positions=np.array(described["positions"], float).reshape(-1, 3),
        normals=_unit(np.array(described["normals"], float).reshape(-1, 3)),
        patches=patches,
    )
    rest = np.array([column["rest"] for column in about.get("columns", ())], float)
    return Skin(name, described["device"], described["title"], layout, rest, about)


def _unit(normals: np.ndarray) -> np.ndarray:
    """They were rounded on their way."""
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)


@dataclass
class Moment:
    """A state, made ready to be drawn."""

    t_s: float
    bodies: Mapping[str, Mapping[str, Any]]
    samples: dict[str, Sample] = field(default_factory=dict)
    """Of each skin, of the sense that has a value for each taxel."""
    wire: list[Mapping[str, Any]] = field(default_factory=list)
    missing: int = 0
    """Frames, faults and events that were too many to come along."""


def moment_of(state: Mapping[str, Any], known: Known) -> Moment:
    """Return a state as the subscription gives it; one of a recording that is played has neither bodies nor skins."""
    samples = {}
    for name, entry in state.get("skins", {}).items():
        senses = entry.get("senses") or {"": entry.get("sample")}
        whole = [each for each in senses.values() if each is not None and np.ndim(each["ideal"])]
        taxels = len(known.skins[name].layout) if name in known.skins else 0
        fit = [each for each in whole if len(each["ideal"]) == taxels] or whole
        if fit:
            samples[name] = Sample(
                fit[0]["t_ns"], name, fit[0]["ideal"], fit[0]["measured"], fit[0]["counts"],
                fit[0]["number"], fit[0]["sense"],
            )  # fmt: skip
    wire, missing = state.get("wire", []), state.get("wire_missing", 0)
    return Moment(state["t_s"], state.get("bodies", {}), samples, wire, missing)


def size_of(values: np.ndarray) -> np.ndarray:
    """Return one number for each taxel: how much is felt, in whichever direction; shape ``(n,)``."""
    values = np.asarray(values, float)
    return np.abs(values) if values.ndim == 1 else np.linalg.norm(values.reshape(len(values), -1), axis=1)


class Rest:
    """The counts of each taxel of a skin when it was seen first without anybody touching it; till then, those that its
    datasheet gives."""

    def __init__(self, skin: Skin):
        self._rest = skin.rest
        self._known = np.zeros((0, 0))
        self._seen = np.zeros(0, bool)

    def away(self, sample: Sample) -> np.ndarray | None:
        """How far the counts are from that, shape ``(n,)``; ``None``: they are not by taxels."""
        counts = np.asarray(sample.counts, float)
        if counts.ndim == 0 or len(counts) != len(sample.ideal):
            return None
        columns = counts.reshape(len(counts), -1)
        if columns.shape != self._known.shape:
            given = self._rest if self._rest.shape == columns.shape[1:] else np.zeros(columns.shape[1])
            self._known, self._seen = np.tile(given, (len(columns), 1)), np.zeros(len(columns), bool)
        new = ~self._seen & (size_of(sample.ideal) == 0)
        self._known[new] = columns[new]
        self._seen |= new
        return np.linalg.norm(columns - self._known, axis=1)
