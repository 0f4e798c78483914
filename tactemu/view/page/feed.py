"""The data that a page receives from a running emulator: its description once, then one state after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols.layouts import Layout
from firmware_protocols.senses import QUANTITY_UNITS
from tactemu.scene.description import SceneDescription, SkinDescription
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import prefixed


@dataclass(frozen=True)
class Channel:
    """One of the numbers that a device sends for each taxel."""

    name: str
    axis: str = ""
    unit: str = ""
    """The unit of a count: ``µT``, ``10 mN``, or ``counts`` where the device has no published scale."""
    rest: float = 0.0
    """The count without contact, by the datasheet."""


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

    def quantity(self, sense: str) -> str:
        """Return the quantity of a sense; without a name: of the first."""
        senses = self.described.senses
        found = senses.get(sense) or next(iter(senses.values()), None)
        return found.quantity if found is not None else ""

    def unit(self, sense: str) -> str:
        """Return the SI unit of a sense's readings; "" if it has none."""
        return QUANTITY_UNITS.get(self.quantity(sense), "")

    def channels(self, sense: str, columns: int) -> list[Channel]:
        """Return the channels of a taxel's counts; if the device does not name as many as there are, they have numbers
        for names."""
        about = [each for each in self.about.get("columns", ()) if not each.get("shared")]
        of_sense = [each for each in about if not sense or each.get("sense", "") in ("", sense)]
        for each in (of_sense, about):
            if len(each) == columns:
                return [_channel(one) for one in each]
        return [Channel(f"channel {k}" if columns > 1 else "count", unit="counts") for k in range(columns)]


def _channel(column: Mapping[str, Any]) -> Channel:
    scale, unit = column.get("counts_per_unit"), column.get("unit", "")
    step = "counts"
    if scale and unit:
        factor, shown = prefixed(1 / scale, unit)
        size = factor / scale
        step = shown if abs(size - 1) < 1e-6 else f"{size:.4g} {shown}"
    return Channel(column["name"], column.get("axis", ""), step, float(column["rest"]))


def deviation_channels(channels: Sequence[Channel]) -> list[int]:
    """Return the channels in which contact shows: those with an axis that have the unit of the first of these; if none
    has an axis, all."""
    axes = [channel for channel in channels if channel.axis]
    return [k for k, each in enumerate(channels) if not axes or (each.axis and each.unit == axes[0].unit)]


def deviation_unit(channels: Sequence[Channel]) -> str:
    """Return the unit of :meth:`Baseline.deviation`: that of its channels if they share one, else counts."""
    units = {channels[k].unit for k in deviation_channels(channels)}
    unit = units.pop() if len(units) == 1 else "counts"
    return unit if not unit[:1].isdigit() else f"counts of {unit}"


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
        self._skin = skin
        self._columns: list[int] = []
        self._baseline = np.zeros((0, 0))
        self._seen = np.zeros(0, bool)

    def deviation(self, sample: Sample) -> np.ndarray | None:
        """Return how far the counts of :func:`deviation_channels` are from the baseline, shape ``(n,)``, or None if
        they are not by taxels."""
        counts = np.asarray(sample.counts, float)
        if counts.ndim == 0 or len(counts) != len(sample.ideal):
            return None
        columns = counts.reshape(len(counts), -1)
        if columns.shape != self._baseline.shape:
            channels = self._skin.channels(sample.sense, columns.shape[1])
            self._columns = deviation_channels(channels)
            self._baseline = np.tile([channel.rest for channel in channels], (len(columns), 1))
            self._seen = np.zeros(len(columns), bool)
        new = ~self._seen & (magnitudes(sample.ideal) == 0)
        self._baseline[new] = columns[new]
        self._seen |= new
        return np.linalg.norm((columns - self._baseline)[:, self._columns], axis=1)
