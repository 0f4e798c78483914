"""Patches of taxels as flat pictures: ideal, measured and sent side by side, with the counts."""

from __future__ import annotations

import base64
import io
from html import escape

import numpy as np
from PIL import Image

from firmware_protocols.layouts import Patch
from tactemu.base.style import colours
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import MAX_COLUMNS, cells
from tactemu.view.page.feed import PageSkin, magnitudes

_MAX_NUMBERED_TAXELS = 64
"""Maximum number of taxels of a patch whose counts are written below its picture."""
_MAX_PATCHES = 24
"""Maximum number of patches of one skin that are drawn."""
_COLUMNS: tuple[str, ...] = ("ideal", "measured", "sent")


class Pictures:
    """The patches of one skin at a time."""

    def __init__(self) -> None:
        self._skin: PageSkin | None = None
        self._places: list[tuple[Patch, np.ndarray]] = []
        self._most = dict.fromkeys(_COLUMNS, 0.0)

    def html(self, skin: PageSkin, sample: Sample | None, sent: np.ndarray | None) -> str:
        """Return the pictures of a sample; ``sent`` is how far the counts are from baseline."""
        if skin is not self._skin:
            self._skin = skin
            self._most = dict.fromkeys(_COLUMNS, 0.0)
            self._places = [(patch, cells(skin.layout, patch)) for patch in skin.layout.patches[:_MAX_PATCHES]]
        if sample is None or not len(skin.layout) or len(sample.ideal) != len(skin.layout):
            return "<p>nothing to draw: this skin has no reading for each taxel</p>"
        sizes: dict[str, np.ndarray | None] = {
            "ideal": magnitudes(sample.ideal),
            "measured": magnitudes(sample.measured),
            "sent": sent,
        }
        for name, size in sizes.items():
            if size is not None:
                self._most[name] = max(self._most[name], float(np.nanmax(size, initial=0.0)))
        together = max(self._most["ideal"], self._most["measured"])
        scale = {"ideal": together, "measured": together, "sent": self._most["sent"]}
        head = "".join(f"<th>{name}<br><small>0 to {scale[name]:.3g}</small></th>" for name in _COLUMNS)
        rows = "".join(self._row(patch, places, sizes, scale, sample) for patch, places in self._places)
        more = len(skin.layout.patches) - len(self._places)
        note = f"<p>and {more} more patches</p>" if more > 0 else ""
        return f'<table class="flat"><tr>{head}</tr>{rows}</table>{note}{_STYLE}'

    def _row(
        self,
        patch: Patch,
        places: np.ndarray,
        sizes: dict[str, np.ndarray | None],
        scale: dict[str, float],
        sample: Sample,
    ) -> str:
        pixels = [picture(size, patch, places, scale[name]) for name, size in sizes.items()]
        pictures = "".join(f"<td>{each}</td>" for each in pixels)
        return f'<tr><td colspan="3" class="name">{escape(patch.name)}</td></tr><tr>{pictures}</tr>' + _numbers(
            patch, places, sample
        )


def picture(size: np.ndarray | None, patch: Patch, places: np.ndarray, most: float) -> str:
    """Return an image of one pixel for each taxel, which the browser enlarges."""
    if size is None:
        return "<small>not by taxels</small>"
    rows, cols = places.max(axis=0) + 1
    pixels = np.zeros((rows, cols, 4), np.uint8)
    pixels[places[:, 0], places[:, 1], :3] = (255 * colours(size[patch.taxels] / (most or 1.0))).round()
    pixels[places[:, 0], places[:, 1], 3] = 255
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=1)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="" src="data:image/png;base64,{data}" style="aspect-ratio:{cols}/{rows}">'


def _numbers(patch: Patch, places: np.ndarray, sample: Sample) -> str:
    """Return a table of the counts, each at its taxel's place in the picture."""
    counts = np.asarray(sample.counts)
    rows, cols = (int(extent) for extent in places.max(axis=0) + 1)
    if counts.ndim == 0 or len(counts) != len(sample.ideal) or len(places) > _MAX_NUMBERED_TAXELS or cols > MAX_COLUMNS:
        return ""
    grid = [["<td></td>"] * cols for _ in range(rows)]
    for taxel, (row, col) in zip(range(patch.start, patch.start + len(patch)), places.tolist()):
        words = "<br>".join(f"{value:.6g}" for value in np.atleast_1d(counts[taxel]).tolist())
        grid[row][col] = f'<td title="taxel {taxel}">{words}</td>'
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in grid)
    return f'<tr><td colspan="3"><div class="wide"><table class="counts">{body}</table></div></td></tr>'


_STYLE = """<style>
table.flat { width: 100%; table-layout: fixed; border-spacing: 4px; font-size: 12px; }
table.flat img { width: 100%; max-height: 220px; object-fit: contain; image-rendering: pixelated; display: block; }
table.flat .name { opacity: 0.7; }
table.flat .wide { overflow-x: auto; }
table.counts { width: 100%; font-size: 10px; border-spacing: 2px; text-align: center;
  font-family: ui-monospace, monospace; }
table.counts td[title] { background: rgba(128, 128, 128, 0.15); border-radius: 3px; }
</style>"""
