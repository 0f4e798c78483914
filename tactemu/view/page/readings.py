"""The numbers of a skin: ideal and measured reading and the counts of each taxel, with names and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from firmware_protocols.layouts import Layout
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import prefixed
from tactemu.view.page.feed import PageSkin, magnitudes

_MAX_ROWS = 64
"""Maximum number of taxels whose numbers are listed; of more, those around the selected taxel."""
_COMPONENTS = {3: ("x", "y", "z"), 6: ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}
"""The names of the components of a reading, by their number."""
_STATISTICS = {
    "rate_hz": "rate [Hz]",
    "lateness_p50_us": "lateness, median [µs]",
    "lateness_p99_us": "lateness, 99th percentile [µs]",
    "lateness_max_us": "lateness, largest [µs]",
    "sent_bytes": "sent [bytes]",
    "received_bytes": "received [bytes]",
    "unheard": "frames while no driver had the port open",
    "dropped_unread": "frames that the driver did not read in time",
}
"""The words for names of statistics that need a unit or more words."""


def readings_html(skin: PageSkin, sample: Sample | None, selected: int) -> str:
    """Return a table of a sample, with a row for each taxel; of a single point, with a row for each component.

    Args:
        skin: the skin of the sample.
        sample: the sample; None: there is none yet.
        selected: the selected taxel, whose row is marked.
    """
    if sample is None or not np.ndim(sample.ideal) or not len(sample.ideal):
        return '<div class="tt"><p>No numbers yet.</p></div>'
    if len(sample.ideal) == 1 and np.ndim(sample.ideal) > 1:
        return f'<div class="tt">{_components(skin, sample)}</div>'
    return f'<div class="tt">{_taxels(skin, sample, selected)}</div>'


def _taxels(skin: PageSkin, sample: Sample, selected: int) -> str:
    ideal, measured = magnitudes(sample.ideal), magnitudes(sample.measured)
    n = len(ideal)
    counts = _counts(sample)
    channels = [] if counts is None else skin.channels(sample.sense, counts.shape[1])
    largest = float(np.nanmax(np.concatenate([ideal, measured]), initial=0.0))
    factor, unit = prefixed(largest, skin.unit(sample.sense))
    heads = [("taxel", ""), ("ideal", unit), ("measured", unit), *((each.name, each.unit) for each in channels)]
    first = max(0, min(selected - _MAX_ROWS // 2, n - _MAX_ROWS))
    rows = []
    for taxel in range(first, min(first + _MAX_ROWS, n)):
        cells = [f"{ideal[taxel] * factor:.3f}", f"{measured[taxel] * factor:.3f}"]
        cells += [] if counts is None else [f"{value:.6g}" for value in counts[taxel].tolist()]
        mark = ' class="tt-chosen"' if taxel == selected else ""
        name = escape(taxel_name(skin.layout, taxel))
        rows.append(f"<tr{mark}><td>{name}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    note = f"<p>Taxels {first} to {first + len(rows) - 1} of {n}; select another taxel for others.</p>"
    return (note if n > _MAX_ROWS else "") + _table(heads, rows)


def _components(skin: PageSkin, sample: Sample) -> str:
    """Return the components of a single reading, beside the channels if these are the same."""
    ideal, measured = np.ravel(sample.ideal), np.ravel(sample.measured)
    counts = _counts(sample)
    values = [] if counts is None else [f"{value:.6g}" for value in counts[0].tolist()]
    channels = skin.channels(sample.sense, len(values))
    is_aligned = len(channels) == len(ideal) and all(each.axis for each in channels)
    names = [each.name for each in channels] if is_aligned else _COMPONENTS.get(len(ideal), range(len(ideal)))
    units = skin.unit(sample.sense).split(", ")
    sent = [(value, _one_count(each.unit)) for value, each in zip(values, channels)]
    rows = []
    for k, name in enumerate(names):
        unit = units[min(k // 3, len(units) - 1)]
        rows.append(
            _cells(f"{name} [{unit}]", f"{ideal[k]:.4f}", f"{measured[k]:.4f}", *(sent[k] if is_aligned else ()))
        )
    heads = ["component", "ideal", "measured", *(("sent", "one count") if is_aligned else ())]
    table = _table([(head, "") for head in heads], rows)
    if not is_aligned:
        rows = [_cells(each.name, *one) for each, one in zip(channels, sent)]
        table += _table([("channel", ""), ("sent", ""), ("one count", "")], rows)
    return table


def _one_count(unit: str) -> str:
    """Return what one count is, in words: ``10 mN``, ``1 N``."""
    return "no scale" if unit == "counts" else unit if unit[:1].isdigit() else f"1 {unit}"


def _cells(*words: str) -> str:
    return f"<tr>{''.join(f'<td>{escape(word)}</td>' for word in words)}</tr>"


def _counts(sample: Sample) -> np.ndarray | None:
    """Return the counts, a row for each taxel, or None if they are not by taxels."""
    counts = np.asarray(sample.counts)
    return counts.reshape(len(counts), -1) if counts.ndim and len(counts) == len(sample.ideal) else None


def _table(heads: Sequence[tuple[str, str]], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{escape(name)}<br><small>{escape(unit) or '&nbsp;'}</small></th>" for name, unit in heads)
    body = f'<table class="tt-numbers"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
    return f'<div class="tt-wide">{body}</div>'


def taxel_name(layout: Layout, taxel: int) -> str:
    """Return the name of a taxel: its number, and its patch where there are several."""
    if len(layout.patches) < 2:
        return str(taxel)
    patch = next((each for each in layout.patches if each.start <= taxel < each.start + len(each)), None)
    return str(taxel) if patch is None else f"{taxel} ({patch.name})"


def statistics_html(stats: Mapping[str, Any]) -> str:
    """Return the emulator's statistics as tables of a name and a number each."""
    tables = [_statistics(name, entry) for name, entry in stats.get("skins", {"wire": stats}).items()]
    return f'<div class="tt">{"".join(tables)}</div>'


def _statistics(name: str, entry: Mapping[str, Any]) -> str:
    rows = []
    for what, value in entry.items():
        if isinstance(value, Mapping):
            title = {"injected": "faults injected"}.get(what, what)
            rows += [f'<tr><th colspan="2">{escape(title)}</th></tr>'] if value else []
            rows += [_row(key, each) for key, each in value.items()]
        elif what != "skin":
            rows.append(_row(what, value))
    return f'<table class="tt-pairs"><tr><th colspan="2">{escape(name)}</th></tr>{"".join(rows)}</table>'


def _row(name: str, value: Any) -> str:
    number = f"{value:,.1f}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
    return f"<tr><td>{escape(_STATISTICS.get(name, name.replace('_', ' ')))}</td><td>{escape(number)}</td></tr>"
