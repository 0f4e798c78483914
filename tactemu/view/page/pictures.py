"""Patches of taxels as flat pictures: ideal, measured and sent, each with its colour bar."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from html import escape

import numpy as np
from PIL import Image

from firmware_protocols.layouts import Patch
from tactemu.base.style import NAN, RAMP, colours
from tactemu.session.heatmap import cells
from tactemu.truth.entries import Sample
from tactemu.view.page.feed import PageSkin, deviation_unit, magnitudes
from tactemu.view.page.ranges import NO_CONTACT, Range, Ranges

KINDS: tuple[str, ...] = ("ideal", "measured", "sent")
"""The pictures that there are of a skin."""
ALL = "all three"
"""The choice that shows all of them."""
_MAX_PATCHES = 24
"""Maximum number of patches of one skin that are drawn."""
_MAX_TAXEL_PX = 26
"""Maximum size of a taxel in a skin of several patches."""
_CLEAR_TAXEL_PX, _MIN_TAXEL_PX = 8, 3
"""A size of a taxel that is well visible, and the smallest one."""
_PANEL_PX = (372, 300)
"""The room that all patches take if they can [px]: width and height."""
_GAP_PX, _NAME_PX = 8, 20
"""The room between patches, and that of a name with the gap below [px]."""
_MIN_NAME_PX = 56
"""The width that a patch's name has at least [px]."""
_SQUARE_PX, _MAX_SQUARES = 8, 1000
"""The size of a taxel in the image with its line [px], and the number of taxels up to which there are lines."""
_MIN_WIDE = 1.6
"""Ratio of width to height from which on pictures stand one above the other instead of side by side."""
_FINGERS = ("thumb", "index", "middle", "ring", "little")
_SEGMENTS = ("tip", "top", "distal", "middle", "proximal", "pad", "base")
"""The parts of a finger, from its end."""

DrawnPatch = tuple[Patch, np.ndarray]
"""A patch, and the row and column of each of its taxels."""


class Pictures:
    """The patches of one skin at a time.

    Args:
        ranges: the ranges of the readings.
    """

    def __init__(self, ranges: Ranges):
        self._ranges = ranges
        self._skin: PageSkin | None = None
        self._rows: list[list[list[DrawnPatch]]] = []
        self._taxel_px = _MAX_TAXEL_PX
        self._sent = Range("", "")

    def html(self, skin: PageSkin, sample: Sample | None, sent: np.ndarray | None, shown: str = ALL) -> str:
        """Return the pictures of a sample.

        Args:
            skin: the skin of the sample.
            sample: the sample; None: there is none yet.
            sent: how far the counts are from the baseline; None: they are not by taxels.
            shown: one of :data:`KINDS`, or :data:`ALL`.
        """
        if skin is not self._skin:
            self._skin = skin
            self._sent = Range("", "")
            patches = skin.layout.patches[:_MAX_PATCHES]
            self._rows = picture_rows([(patch, cells(skin.layout, patch)) for patch in patches])
            self._taxel_px = taxel_size(self._rows)
        if sample is None or not len(skin.layout) or len(sample.ideal) != len(skin.layout):
            return '<div class="tt"><p>No picture: this skin has no reading for each taxel yet.</p></div>'
        sizes = {"ideal": magnitudes(sample.ideal), "measured": magnitudes(sample.measured), "sent": sent}
        if sent is not None:
            self._sent.unit = _sent_unit(skin, sample)
            self._sent.include(sent)
        read = self._ranges.of(skin.name, sample.sense)
        scales = {"ideal": read, "measured": read, "sent": self._sent}
        kinds = KINDS if shown == ALL else (shown,)
        boxes = "".join(
            f'<section class="tt-kind"><header><h4>{name}</h4>{_meaning(skin, sample, name)}'
            f"{_colour_bar(scales[name], sizes[name])}</header>"
            f"{self._patches(sizes[name], scales[name], len(kinds))}</section>"
            for name in kinds
        )
        more = len(skin.layout.patches) - sum(len(column) for row in self._rows for column in row)
        note = f"<p>{more} more patches are not drawn.</p>" if more > 0 else ""
        beside = " tt-beside" if len(kinds) > 1 and self._is_narrow() else ""
        return f'<div class="tt"><div class="tt-kinds{beside}">{boxes}</div>{note}</div>'

    def _is_narrow(self) -> bool:
        """Return True if the pictures of one patch fit side by side."""
        rows, cols = _extent(self._rows[0][0][0])
        return self._is_single() and cols / rows < _MIN_WIDE

    def _is_single(self) -> bool:
        return len(self._rows[0]) == 1 and len(self._rows[0][0]) == 1

    def _patches(self, size: np.ndarray | None, scale: Range, kinds: int) -> str:
        if size is None:
            return "<p>The counts are not one for each taxel.</p>"
        if self._is_single():
            limit = "44vh" if kinds == 1 else "24vh" if self._is_narrow() else "9.5vh"
            return _figure(*self._rows[0][0][0], size, scale, f"max-height:{limit}", has_name=False)
        boxes = "".join(_row(row, size, scale, self._taxel_px) for row in self._rows if row)
        return f'<div class="tt-rows">{boxes}</div>'


def _row(row: Sequence[Sequence[DrawnPatch]], size: np.ndarray, scale: Range, taxel_px: int) -> str:
    boxes = []
    for column in row:
        figures = [
            _figure(*drawn, size, scale, f"width:{_extent(drawn)[1] * taxel_px}px", has_name=True) for drawn in column
        ]
        width = _column_px(column, taxel_px)[0]
        boxes.append(f'<div class="tt-finger" style="width:{width}px">{"".join(figures)}</div>')
    return f'<div class="tt-patches">{"".join(boxes)}</div>'


def taxel_size(rows: Sequence[Sequence[Sequence[DrawnPatch]]]) -> int:
    """Return the largest size of a taxel [px] with which all patches fit into the panel, and the fingers of a hand into
    one row. Taxels are not made smaller than :data:`_CLEAR_TAXEL_PX` to fit in height: then the panel scrolls."""
    for taxel_px in range(_MAX_TAXEL_PX, _MIN_TAXEL_PX, -1):
        lines = [_lines_px(row, taxel_px) for row in rows]
        is_in_height = sum(map(sum, lines)) <= _PANEL_PX[1] or taxel_px <= _CLEAR_TAXEL_PX
        if is_in_height and (len(rows) == 1 or len(lines[0]) == 1):
            return taxel_px
    return _MIN_TAXEL_PX


def _lines_px(row: Sequence[Sequence[DrawnPatch]], taxel_px: int) -> list[int]:
    """Return the height of each line into which a row breaks [px]."""
    heights, left = [0], 0
    for column in row:
        width, tall = _column_px(column, taxel_px)
        if left and left + width > _PANEL_PX[0]:
            heights, left = [*heights, 0], 0
        heights[-1], left = max(heights[-1], tall + _GAP_PX), left + width + _GAP_PX
    return heights


def _column_px(column: Sequence[DrawnPatch], taxel_px: int) -> tuple[int, int]:
    """Return width and height of a column of patches with their names [px]."""
    extents = [_extent(drawn) for drawn in column]
    width = max(_MIN_NAME_PX, *(cols * taxel_px for _, cols in extents))
    return width, sum(rows * taxel_px + _NAME_PX for rows, _ in extents)


def _extent(drawn: DrawnPatch) -> tuple[int, int]:
    """Return the number of rows and of columns of a patch's picture."""
    rows, cols = (drawn[1].max(axis=0) + 1).tolist()
    return rows, cols


def picture_rows(places: Sequence[DrawnPatch]) -> list[list[list[DrawnPatch]]]:
    """Return the patches in rows of columns: of a hand, a column for each finger, its tip on top, and the others in a
    second row; else one row, with a column for each patch."""
    fingers: dict[str, list[DrawnPatch]] = {}
    others: list[list[DrawnPatch]] = []
    for place in places:
        finger = place[0].name.split(" ")[0].replace("pinky", "little")
        if finger in _FINGERS:
            fingers.setdefault(finger, []).append(place)
        else:
            others.append([place])
    if len(fingers) < 2:
        return [[[place] for place in places]]
    ordered = [sorted(fingers[name], key=lambda place: _rank(place[0].name)) for name in _FINGERS if name in fingers]
    return [ordered, others]


def _rank(name: str) -> tuple[float, str]:
    """Return the rank of a part of a finger from the tip: words by :data:`_SEGMENTS`, numbers downwards."""
    part = name.partition(" ")[2]
    if part in _SEGMENTS:
        return _SEGMENTS.index(part), part
    number = re.match(r"\d+", part)
    return (len(_SEGMENTS) - int(number[0]) / 100 if number else len(_SEGMENTS) / 2), part


def _figure(patch: Patch, places: np.ndarray, size: np.ndarray, scale: Range, style: str, *, has_name: bool) -> str:
    picture = image(size[patch.taxels], places, scale)
    rows, cols = places.max(axis=0) + 1
    name = escape(patch.name)
    caption = f"<figcaption>{name}</figcaption>" if has_name else ""
    return (
        f'<figure class="tt-patch"><img alt="{name}" src="{picture}" style="aspect-ratio:{cols}/{rows};{style}">'
        f"{caption}</figure>"
    )


def image(size: np.ndarray, places: np.ndarray, scale: Range) -> str:
    """Return an image with a square for each taxel and lines between them, as an address with its data."""
    rows, cols = places.max(axis=0) + 1
    pixels = np.zeros((rows, cols, 4), np.uint8)
    pixels[places[:, 0], places[:, 1], :3] = (255 * colours(scale.shares(size))).round()
    pixels[places[:, 0], places[:, 1], 3] = 255
    if len(size) <= _MAX_SQUARES:
        pixels = pixels.repeat(_SQUARE_PX, axis=0).repeat(_SQUARE_PX, axis=1)
        pixels[_SQUARE_PX - 1 :: _SQUARE_PX] = pixels[:, _SQUARE_PX - 1 :: _SQUARE_PX] = 0
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=1)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _colour_bar(scale: Range, size: np.ndarray | None) -> str:
    ramp, lost = ", ".join(RAMP), ""
    if size is not None and np.isnan(size).any():
        lost = f' <span class="tt-ramp" style="flex:0 0 10px;background:{NAN}"></span><span>NaN</span>'
    return (
        f'<div class="tt-bar"><span>0</span><span class="tt-ramp" style="background:linear-gradient(90deg, {ramp})">'
        f"</span><span>{escape(scale.end() or NO_CONTACT)}</span>{lost}</div>"
    )


def _sent_unit(skin: PageSkin, sample: Sample) -> str:
    columns = np.asarray(sample.counts).reshape(len(sample.counts), -1).shape[1] if np.ndim(sample.counts) else 0
    return deviation_unit(skin.channels(sample.sense, columns))


def _meaning(skin: PageSkin, sample: Sample, kind: str) -> str:
    """Return what the picture shows, in words."""
    text = "counts − baseline" if kind == "sent" else skin.quantity(sample.sense).replace("_", " ")
    return f'<div class="tt-dim">{escape(text)}</div>'
