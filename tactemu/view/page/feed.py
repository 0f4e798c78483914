"""The data that a page receives from a running emulator: its description once, then one state after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols.layouts import Layout
from tactemu.scene.description import SceneDescription, SkinDescription
from tactemu.truth.entries import Sample


@dataclass(frozen=True)
class PageSkin:
    """A skin as the emulator describes it."""

    name: str
    described: SkinDescription
    about: Mapping[str, Any]
    """The full description of its device: columns, tables, commands, adjustable options."""

    @property
    def layout(self) -> Layout:
        """The taxels in the device's frame."""
        return self.described.layout


class DescribedRun:
    """The bodies and skins of a running emulator.

    Args:
        description: the answer to the command `describe`.

    Raises:
        ValueError: the description is malformed.
    """

    def __init__(self, description: Mapping[str, Any]):
        self.scene = SceneDescription.from_json(description.get("scene"))
        devices = description.get("devices", {})
        self.skins = {name: PageSkin(name, skin, devices.get(name, {})) for name, skin in self.scene.skins.items()}


@dataclass
class PageState:
    """A state of the emulator, ready to be drawn."""

    t_s: float
    bodies: Mapping[str, Mapping[str, Any]]
    samples: dict[str, Sample] = field(default_factory=dict)
    """The latest sample of each skin, of a sense that has a value for each taxel."""
    wire: list[Mapping[str, Any]] = field(default_factory=list)
    missing: int = 0
    """The number of frames, faults and events that exceeded the limit of entries per state."""


def page_state(state: Mapping[str, Any], run: DescribedRun) -> PageState:
    """Return a :class:`PageState` of a state of the subscription; a replayed recording has neither bodies nor skins."""
    samples = {}
    for name, entry in state.get("skins", {}).items():
        senses = entry.get("senses") or {"": entry.get("sample")}
        arrays = [each for each in senses.values() if each is not None and np.ndim(each["ideal"])]
        taxels = len(run.skins[name].layout) if name in run.skins else 0
        fit = [each for each in arrays if len(each["ideal"]) == taxels] or arrays
        if fit:
            samples[name] = Sample(
                fit[0]["t_ns"], name, fit[0]["ideal"], fit[0]["measured"], fit[0]["counts"],
                fit[0]["number"], fit[0]["sense"],
            )  # fmt: skip
    wire, missing = state.get("wire", []), state.get("wire_missing", 0)
    return PageState(state["t_s"], state.get("bodies", {}), samples, wire, missing)


def magnitudes(values: np.ndarray) -> np.ndarray:
    """Return the magnitude of each taxel's reading, whatever its direction; shape ``(n,)``."""
    values = np.asarray(values, float)
    return np.abs(values) if values.ndim == 1 else np.linalg.norm(values.reshape(len(values), -1), axis=1)


class Baseline:
    """The baseline counts of a skin's taxels: those of a taxel's first sample without contact; until then, those of
    the datasheet."""

    def __init__(self, skin: PageSkin):
        self._datasheet_counts = np.array([column["rest"] for column in skin.about.get("columns", ())], float)
        self._baseline = np.zeros((0, 0))
        self._seen = np.zeros(0, bool)

    def deviation(self, sample: Sample) -> np.ndarray | None:
        """Return how far the counts are from the baseline, shape ``(n,)``, or None if they are not by taxels."""
        counts = np.asarray(sample.counts, float)
        if counts.ndim == 0 or len(counts) != len(sample.ideal):
            return None
        columns = counts.reshape(len(counts), -1)
        if columns.shape != self._baseline.shape:
            given = (
                self._datasheet_counts
                if self._datasheet_counts.shape == columns.shape[1:]
                else np.zeros(columns.shape[1])
            )
            self._baseline, self._seen = np.tile(given, (len(columns), 1)), np.zeros(len(columns), bool)
        new = ~self._seen & (magnitudes(sample.ideal) == 0)
        self._baseline[new] = columns[new]
        self._seen |= new
        return np.linalg.norm(columns - self._baseline, axis=1)
