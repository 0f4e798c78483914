"""``tactemu plot``: pictures of one skin of a truth log, as PNG, SVG, or a page that needs nothing else.

* the readings over time, without imperfections (ideal) and with them (measured);
* the contact patch at the largest reading;
* hysteresis: measured against ideal;
* the delay from sample to wire;
* the spectrum of the error: measured minus ideal.

A log is read once, and a few numbers of each sample are kept.
"""

from __future__ import annotations

import io
import re
import shlex
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import matplotlib  # noqa: TID253  this module is imported only to draw
import numpy as np

from firmware_protocols.senses import QUANTITY_UNITS
from tactemu.base.errors import TactemuError, nearest, reason_of
from tactemu.base.files import check_writable
from tactemu.base.style import IDEAL, LIGHT, MEASURED, PAGE_SIGN, figure, page, plot_colours, plot_style
from tactemu.scene.description import SceneDescription, SenseDescription, SkinDescription
from tactemu.truth.entries import Header, Passage, Sample, belongs_to
from tactemu.truth.log_reader import SkinChoice, records
from tactemu.view.conversions.taxel_tables import parts_of

matplotlib.use("agg")
from matplotlib.figure import Figure  # noqa: TID253

SIGNS = {".png": "matplotlib.org", ".svg": "matplotlib.org", ".html": PAGE_SIGN}
"""A text among the first bytes of each kind of picture, by its suffix; other pictures of Matplotlib have it too."""


@dataclass
class Series:
    """The numbers of one sense of one skin that the pictures show."""

    device: str
    sense: str
    unit: str
    positions: np.ndarray
    t_ns: list[int] = field(default_factory=list)
    ideal: list[float] = field(default_factory=list)
    measured: list[float] = field(default_factory=list)
    to_wire_ms: list[float] = field(default_factory=list)
    patch: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """The ideal reading of each taxel at the largest sum."""
    taken: dict[int, int] = field(default_factory=dict)
    """The times of the latest samples [ns], by their numbers."""

    def add(self, sample: Sample) -> None:
        """Add a sample."""
        each = _magnitudes(sample.ideal)
        if not self.ideal or each.sum() > max(self._most, 0.0):
            self.patch = each
        self.t_ns.append(sample.t_ns)
        self.ideal.append(float(each.sum()))
        self.measured.append(float(_magnitudes(sample.measured).sum()))
        self._most = max(self._most, self.ideal[-1])
        self.taken[sample.number] = sample.t_ns
        if len(self.taken) > 1000:
            del self.taken[next(iter(self.taken))]

    _most: float = 0.0


def series_of(path: Path, skin: str | None = None, sense: str | None = None) -> Series:
    """Return the numbers of a log that are drawn: of the first skin and its first sense, unless you name them.

    Raises:
        TactemuError: the log is missing, or has no samples of this skin.
    """
    scene, found, choice = SceneDescription(), None, SkinChoice(skin, sense)
    for record in records(path):
        if isinstance(record, Header):
            scene = SceneDescription.from_json(record.scene)
        elif isinstance(record, Sample) and choice.takes(record):
            if found is None:
                found = _begun(record, scene)
            if (record.device, record.sense) == (found.device, found.sense):
                found.add(record)
        elif isinstance(record, Passage) and found and record.kind == "tx" and belongs_to(record, found.device):
            if record.sample in found.taken:
                found.to_wire_ms.append((record.t_ns - found.taken.pop(record.sample)) / 1e6)
    choice.check(path)
    if found is None:
        raise TactemuError(f"{path}: no samples in it")
    return found


def _begun(sample: Sample, scene: SceneDescription) -> Series:
    senses = scene.skins.get(sample.device, SkinDescription()).senses
    sense = senses.get(sample.sense or next(iter(senses), ""), SenseDescription())
    positions = np.zeros((len(np.atleast_1d(sample.ideal)), 3))
    for part in parts_of(scene, sample):
        positions[part.taxels] = part.positions
    return Series(sample.device, sample.sense, QUANTITY_UNITS.get(sense.quantity, ""), positions)


def _magnitudes(values: np.ndarray) -> np.ndarray:
    """Return the magnitude of each taxel's reading."""
    values = np.nan_to_num(np.asarray(values, float))
    return np.abs(values) if values.ndim < 2 else np.linalg.norm(values.reshape(len(values), -1), axis=1)


# -- the pictures --------------------------------------------------------------------------------------------------


def _over_time(axes: Any, series: Series) -> None:
    t_s = np.array(series.t_ns) / 1e9
    axes.plot(t_s, series.measured, color=MEASURED, label="measured")
    axes.plot(t_s, series.ideal, color=IDEAL, label="ideal")
    axes.set(xlabel="time [s]", ylabel=f"sum over taxels [{series.unit}]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.1)


def _patch(axes: Any, series: Series) -> None:
    x, y = series.positions[:, 0] * 1e3, series.positions[:, 1] * 1e3
    dots = axes.scatter(x, y, c=series.patch, s=max(6, min(160, 6000 / max(len(x), 1))), cmap=plot_colours())
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.margins(0.15)
    axes.figure.colorbar(dots, ax=axes, label=f"ideal [{series.unit}]")


def _hysteresis(axes: Any, series: Series) -> None:
    axes.plot(series.ideal, series.measured, color=MEASURED, lw=0.8)
    most = max(*series.ideal, 1e-12)
    axes.plot([0, most], [0, most], color=LIGHT["muted"], lw=0.8, ls="--")
    axes.set(xlabel=f"ideal [{series.unit}]", ylabel=f"measured [{series.unit}]")


def _to_wire(axes: Any, series: Series) -> None:
    if series.to_wire_ms:
        axes.hist(series.to_wire_ms, bins=60, color=IDEAL)
    axes.set(xlabel="from the sample to the wire [ms]", ylabel="frames")


def _spectrum(axes: Any, series: Series) -> None:
    error, t_s = np.subtract(series.measured, series.ideal), np.array(series.t_ns) / 1e9
    if len(t_s) > 16:
        step = float(np.median(np.diff(t_s)))
        size = min(1024, 2 ** int(np.log2(len(error))))
        window = np.hanning(size)
        pieces = np.stack([error[k : k + size] for k in range(0, len(error) - size + 1, max(1, size // 2))])
        power = np.abs(np.fft.rfft((pieces - pieces.mean(1, keepdims=True)) * window)) ** 2
        density = np.sqrt(2 * power.mean(0) * step / (window**2).sum())
        axes.loglog(np.fft.rfftfreq(size, step)[1:], np.maximum(density[1:], 1e-15), color=MEASURED)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _at: f"{value:g}")
    axes.set(xlabel="frequency [Hz]", ylabel=f"measured − ideal [{series.unit}/√Hz]")


PANELS = {
    "over time": _over_time,
    "contact patch at the largest reading": _patch,
    "hysteresis": _hysteresis,
    "from sample to wire": _to_wire,
    "spectrum of the error": _spectrum,
}


def plot(path: str | Path, target: str | Path, *, skin: str | None = None, sense: str | None = None) -> None:
    """Draw one skin of a log.

    Raises:
        TactemuError: the log is missing or has no samples of this skin, the suffix is unknown, or the file cannot be
            written or is of another program.
    """
    target = Path(target)
    if target.suffix not in SIGNS:
        near = nearest(target.suffix, SIGNS)
        raise TactemuError(f"{target}: cannot draw to {target.suffix!r}{near}; expected {', '.join(SIGNS)}")
    check_writable(target, "the plot", SIGNS[target.suffix])
    series = series_of(Path(path), skin, sense)
    title = " ".join(filter(None, (series.device, series.sense)))
    chosen = [word for option, name in (("--skin", skin), ("--sense", sense)) if name for word in (option, name)]
    command = shlex.join(["tactemu", "plot", str(path), "--to", str(target), *chosen])
    with matplotlib.rc_context(plot_style()):
        if target.suffix == ".html":
            content = _page(series, title, command)
        else:
            content = _all_panels(series, title, command, target.suffix[1:])
    try:
        target.write_bytes(content)
    except OSError as error:
        raise TactemuError(f"{target}: cannot write it: {reason_of(error, target)}") from None


def _all_panels(series: Series, title: str, command: str, kind: str) -> bytes:
    """Return one image with all panels, and below them the command that makes it."""
    drawn = Figure(figsize=(10, 10.3), layout="constrained")
    drawn.suptitle(title)
    drawn.supxlabel(command, fontsize=7, color=LIGHT["muted"], x=0.01, ha="left")
    grid = drawn.subplot_mosaic([["a", "a"], ["b", "c"], ["d", "e"]])
    for axes, (name, draw) in zip(grid.values(), PANELS.items()):
        draw(axes, series)
        axes.set_title(name)
    return _saved(drawn, kind)


def _page(series: Series, title: str, command: str) -> bytes:
    """Return an HTML page with a figure for each panel, in the colours of the page."""
    figures = []
    for k, (name, draw) in enumerate(PANELS.items()):
        with matplotlib.rc_context({"svg.hashsalt": f"tactemu {k}"}):
            drawn = Figure(figsize=(5, 3.4), layout="constrained")
            draw(drawn.add_subplot(), series)
            text = re.sub(r"<metadata>.*?</metadata>", "", _saved(drawn, "svg").decode(), flags=re.DOTALL)
        text = re.sub(r'(id="|href="#|url\(#)', rf"\1p{k}-", text[text.index("<svg") :])
        figures.append(figure(text, f"{name[0].upper()}{name[1:]}.", command=command))
    span = (series.t_ns[-1] - series.t_ns[0]) / 1e9
    rows = {
        "samples": len(series.t_ns),
        "seconds": f"{span:.3f}",
        f"largest ideal [{series.unit}]": f"{max(series.ideal):.4g}",
        f"largest measured [{series.unit}]": f"{max(series.measured):.4g}",
        "median from sample to wire [ms]": f"{np.median(series.to_wire_ms):.3f}" if series.to_wire_ms else "no frames",
    }  # fmt: skip
    cells = "".join(f"<tr><td>{escape(name)}</td><td class=n>{value}</td></tr>" for name, value in rows.items())
    shown = f'<div class="figures">{"".join(figures)}</div>'
    return page(title, [f"<h1>{escape(title)}</h1>", f'<table class="narrow">{cells}</table>', shown]).encode()


def _saved(drawn: Figure, kind: str) -> bytes:
    content = io.BytesIO()
    drawn.savefig(content, format=kind, dpi=110, metadata={"Date": None} if kind == "svg" else None)
    return content.getvalue()
