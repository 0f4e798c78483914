"""Charts of the last seconds of chosen taxels: ideal, measured, sent."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import numpy as np
import viser
import viser.uplot

from tactemu.base.style import SERIES
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import prefixed
from tactemu.view.page.feed import PageSkin, deviation_unit, magnitudes
from tactemu.view.page.readings import taxel_name

_SECONDS = 10.0
_MAX_POINTS = 300
_CHART_PX = 118
MAX_TAXELS = len(SERIES)
"""Maximum number of taxels with curves at a time; of more, the latest chosen stay."""
_ORDERS = (1e10, 2e10, 3e10, 4e10)
"""The order of legend, chart, legend, chart in the tab; that of other controls counts up from 1."""
_IDEAL_ALPHA = "55"
"""The opacity of ideal curves, in hex: broad and pale, so that the measured one is seen upon it."""


class Curves:
    """Two charts of the taxels that viewers clicked last: their readings, and their counts relative to baseline.

    Args:
        gui: viser's controls; the charts are added where its context is now.
        skins: the skins, by name.
        selected: returns the selected skin and taxel.
    """

    def __init__(self, gui: viser.GuiApi, skins: Mapping[str, PageSkin], selected: Callable[[], tuple[str, int]]):
        self._gui, self._skins = gui, skins
        self.chosen: list[tuple[str, int]] = []
        """The taxels that viewers have chosen. Their callbacks replace the list, in a thread of viser's."""
        self._drawn: list[tuple[str, int]] = []
        """The taxels of the charts, which the page's thread fills."""
        self._is_automatic = True
        """True until a viewer has chosen a taxel: the first one that is touched is shown."""
        self._times: deque[float] = deque(maxlen=_MAX_POINTS)
        self._rows: deque[list[float]] = deque(maxlen=_MAX_POINTS)
        self._units: dict[str, tuple[str, str]] = {}
        """The unit of the reading, and that of the counts, by skin."""
        self._largest = [0.0, 0.0]
        """The largest reading, and the largest change of the counts, since the taxels were chosen."""
        self._labels: list[str] = []
        """The labels of the charts that are visible."""
        add = gui.add_button_group("curves", ("Add taxel", "Clear"), hint=_CURVES_HINT)
        self._legends = [gui.add_html(_HINT, order=_ORDERS[0]), gui.add_html("", order=_ORDERS[2])]
        self._charts = [[self._chart(n, part) for part in (0, 1)] for n in range(1, MAX_TAXELS + 1)]
        """The two charts for each number of taxels; one pair is visible. None is ever removed, because a browser may
        still have to draw what was sent for it."""

        @add.on_click
        async def _(_: viser.GuiEvent) -> None:
            if add.value == "Clear":
                self._is_automatic = True
                self.chosen = []
            elif (one := selected()) not in self.chosen:
                self.choose(*one)

    def choose(self, skin: str, taxel: int) -> None:
        """Add the taxel to the charts, or remove it if it is shown."""
        self._is_automatic = False
        others = [each for each in self.chosen if each != (skin, taxel)]
        self.chosen = others if len(others) < len(self.chosen) else [*others, (skin, taxel)][-MAX_TAXELS:]

    def add(self, t_s: float, samples: dict[str, Sample], deviations: dict[str, np.ndarray | None]) -> None:
        """Add the readings of a time [s]; ``deviations`` has how far each skin's counts are from baseline."""
        if self._is_automatic and not self.chosen:
            self._choose_touched(samples)
        if self._drawn != self.chosen:
            self._begin()
        if self._times and t_s <= self._times[-1]:
            self._times.clear()
            self._rows.clear()
        row: list[float] = []
        for name, taxel in self._drawn:
            sample = samples.get(name)
            if sample is None or taxel >= len(sample.ideal):
                row += [np.nan] * 3
                continue
            if name not in self._units:
                self._units[name] = self._units_of(sample, name)
            sent = deviations.get(name)
            one = slice(taxel, taxel + 1)
            values = (magnitudes(sample.ideal[one])[0], magnitudes(sample.measured[one])[0])
            row += [*values, np.nan if sent is None else float(sent[taxel])]
        if self._rows or not np.isnan(row).any():  # uPlot finds no range where the first value is none
            self._times.append(t_s)
            self._rows.append(row)

    def draw(self) -> None:
        """Show the last :data:`_SECONDS`."""
        if not self._drawn or len(self._times) < 2:
            return
        times, rows = np.array(self._times), np.array(self._rows)
        inside = times > times[-1] - _SECONDS
        times, rows = times[inside] - times[-1], rows[inside]
        read = np.delete(rows, slice(2, None, 3), axis=1)
        sent = rows[:, 2::3]
        units = [self._units.get(name, ("", "")) for name, _ in self._drawn]
        self._largest = [
            max(largest, float(np.nanmax(part, initial=0.0))) for largest, part in zip(self._largest, (read, sent))
        ]
        shown = [_shared(largest, [unit[k] for unit in units]) for k, largest in enumerate(self._largest)]
        labels = [unit for _, unit in shown]
        charts = self._charts[len(self._drawn) - 1]
        for chart, part, (factor, _), label in zip(charts, (read, sent), shown, labels):
            chart.data = (times, *(part * factor).T)
            if labels != self._labels:
                chart.axes = _axes(label)
                chart.visible = True
        self._labels = labels
        _show(
            self._legends[0], self._legend(rows[-1], (0, 1), shown[0], "Reading: broad line ideal, thin line measured")
        )
        _show(self._legends[1], self._legend(rows[-1], (2,), shown[1], "Sent: change of the counts from baseline"))

    def _choose_touched(self, samples: Mapping[str, Sample]) -> None:
        for name, sample in samples.items():
            size = np.nan_to_num(magnitudes(sample.ideal)) if np.ndim(sample.ideal) else np.zeros(0)
            if size.any() and name in self._skins and len(size) == len(self._skins[name].layout):
                self.chosen = [(name, int(size.argmax()))]
                return

    def _units_of(self, sample: Sample, name: str) -> tuple[str, str]:
        skin = self._skins.get(name)
        if skin is None:
            return "", ""
        columns = np.asarray(sample.counts).reshape(len(sample.counts), -1).shape[1] if np.ndim(sample.counts) else 0
        return skin.unit(sample.sense), deviation_unit(skin.channels(sample.sense, columns))

    def _begin(self) -> None:
        """Hide the charts and drop what they showed; :meth:`draw` shows those of the chosen taxels."""
        if self._labels:
            for chart in self._charts[len(self._drawn) - 1]:
                chart.visible = False
        self._drawn, self._labels, self._largest = self.chosen, [], [0.0, 0.0]
        self._times.clear()
        self._rows.clear()
        if not self._drawn:
            _show(self._legends[0], _HINT)
            _show(self._legends[1], "")

    def _chart(self, taxels: int, part: int) -> Any:
        """Return a hidden chart; part 0: of ideal and measured readings, 1: of what is sent."""
        lines = [
            line
            for colour in SERIES[:taxels]
            for line in ((_line(colour + _IDEAL_ALPHA, 6), _line(colour, 1.5)) if part == 0 else (_line(colour, 1.5),))
        ]
        return self._gui.add_uplot(
            (np.zeros(1),) * (len(lines) + 1), (viser.uplot.Series(label="time"), *lines), height=_CHART_PX,
            order=_ORDERS[1 + 2 * part], legend=viser.uplot.Legend(show=False), cursor=viser.uplot.Cursor(show=False),
            scales={"x": viser.uplot.Scale(time=False, range=(-_SECONDS, 0.0))}, padding=(8, 12, 0, 0),
            axes=_axes(""), visible=False,
        )  # fmt: skip

    def _legend(self, row: np.ndarray, parts: tuple[int, ...], shown: tuple[float, str], title: str) -> str:
        entries = []
        for k, (colour, (skin, taxel)) in enumerate(zip(SERIES, self._drawn)):
            known = self._skins.get(skin)
            name = taxel_name(known.layout, taxel) if known is not None else str(taxel)
            where = f"{skin} {name}" if len(self._skins) > 1 else f"taxel {name}"
            values = [f"{row[3 * k + part] * shown[0]:.3g} {shown[1]}" for part in parts]
            words = values[0] if len(parts) == 1 else f"ideal {values[0]}, measured {values[1]}"
            swatch = _swatch(colour, has_ideal=len(parts) > 1)
            entries.append(f"<span>{swatch}{escape(where)}: {escape(words)}</span>")
        return f'<div class="tt"><h4>{title}</h4><div class="tt-legend">{"".join(entries)}</div></div>'


_CURVES_HINT = (
    f"Add taxel: also show the selected taxel, up to {MAX_TAXELS}. Clear: show the next taxel that is touched."
)
_HINT = '<div class="tt"><p>No taxel is touched yet. Click taxels in the scene to see their curves.</p></div>'


def _axes(label: str) -> tuple[viser.uplot.Axis, ...]:
    style: dict[str, Any] = {"labelSize": 18, "labelFont": "11px sans-serif", "font": "11px sans-serif"}
    return (
        viser.uplot.Axis(label="time before now [s]", size=28, **style),
        viser.uplot.Axis(label=label, size=46, **style),
    )


def _line(colour: str, width: float) -> viser.uplot.Series:
    return viser.uplot.Series(label="", stroke=colour, width=width)


def _swatch(colour: str, *, has_ideal: bool) -> str:
    line = '<line x1="0" y1="4" x2="22" y2="4" stroke="{}" stroke-width="{}"/>'
    broad = line.format(colour + _IDEAL_ALPHA, 6) if has_ideal else ""
    return f'<svg width="22" height="8" aria-hidden="true">{broad}{line.format(colour, 1.5)}</svg>'


def _shared(largest: float, units: list[str]) -> tuple[float, str]:
    """Return factor and unit of an axis; where skins have several units, their SI units."""
    return prefixed(largest, units[0]) if len(set(units)) == 1 else (1.0, " or ".join(dict.fromkeys(units)))


def _show(handle: Any, content: str) -> None:
    if handle.content != content:
        handle.content = content
