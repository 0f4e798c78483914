"""Charts of the last seconds of chosen taxels: ideal, measured, sent."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import viser
import viser.uplot

from tactemu.truth.entries import Sample
from tactemu.view.page.feed import magnitudes

_SECONDS = 10.0
_MAX_POINTS = 300
MAX_TAXELS = 4
"""Maximum number of taxels with curves at a time; of more, the latest chosen stay."""
_COLOURS = ("#1c7ed6", "#e8590c", "#2f9e44", "#9c36b5")


class Curves:
    """Two charts of the taxels that viewers clicked last: their readings, and their counts relative to baseline."""

    def __init__(self, gui: viser.GuiApi):
        self._gui = gui
        self.chosen: list[tuple[str, int]] = []
        self._times: deque[float] = deque(maxlen=_MAX_POINTS)
        self._rows: deque[list[float]] = deque(maxlen=_MAX_POINTS)
        self._charts: list[Any] = []
        self._title = gui.add_html("")
        self._make()

    def choose(self, skin: str, taxel: int) -> None:
        """Add the taxel to the charts, or remove it if it is shown."""
        if (skin, taxel) in self.chosen:
            self.chosen.remove((skin, taxel))
        else:
            self.chosen = [*self.chosen, (skin, taxel)][-MAX_TAXELS:]
        self._times.clear()
        self._rows.clear()
        self._make()

    def add(self, t_s: float, samples: dict[str, Sample], deviations: dict[str, np.ndarray | None]) -> None:
        """Add the readings of a time [s]; ``deviations`` has how far each skin's counts are from baseline."""
        if self._times and t_s <= self._times[-1]:
            self._times.clear()
            self._rows.clear()
        row: list[float] = []
        for name, taxel in self.chosen:
            sample = samples.get(name)
            if sample is None or taxel >= len(sample.ideal):
                row += [np.nan] * 3
                continue
            sent = deviations.get(name)
            one = slice(taxel, taxel + 1)
            values = (magnitudes(sample.ideal[one])[0], magnitudes(sample.measured[one])[0], np.nan)
            row += [values[0], values[1], np.nan if sent is None else float(sent[taxel])]
        self._times.append(t_s)
        self._rows.append(row)

    def draw(self) -> None:
        """Show the last :data:`_SECONDS`."""
        if not self.chosen or len(self._times) < 2:
            return
        times, rows = np.array(self._times), np.array(self._rows)
        inside = times > times[-1] - _SECONDS
        times, rows = times[inside] - times[-1], rows[inside]
        read = [rows[:, 3 * k + j] for k in range(len(self.chosen)) for j in (0, 1)]
        sent = [rows[:, 3 * k + 2] for k in range(len(self.chosen))]
        for chart, columns in zip(self._charts, (read, sent)):
            chart.data = (times, *columns)

    def _make(self) -> None:
        for chart in self._charts:
            chart.remove()
        self._charts = []
        if not self.chosen:
            self._title.content = "<p>Click taxels in the picture to see their curves.</p>"
            return
        names = ", ".join(f"{skin} {taxel}" for skin, taxel in self.chosen)
        self._title.content = f"<p>taxels {names}: dashed ideal, solid measured; below, counts relative to baseline</p>"
        none = np.zeros(1)
        read, sent = [viser.uplot.Series(label="s")], [viser.uplot.Series(label="s")]
        for colour, (_, taxel) in zip(_COLOURS, self.chosen):
            read.append(viser.uplot.Series(label=f"{taxel} ideal", stroke=colour, width=1, dash=(4.0, 4.0)))
            read.append(viser.uplot.Series(label=f"{taxel} measured", stroke=colour, width=2))
            sent.append(viser.uplot.Series(label=f"{taxel} sent", stroke=colour, width=2))
        for series in (read, sent):
            self._charts.append(
                self._gui.add_uplot(
                    (none,) * len(series), tuple(series), height=190, legend=viser.uplot.Legend(show=series is read),
                    scales={"x": viser.uplot.Scale(time=False, range=(-_SECONDS, 0.0))},
                )
            )  # fmt: skip
