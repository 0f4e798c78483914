"""The legend of the scene: the colour scale with its range and unit, the length of an arrow, the grid of the floor.

It is a picture in the lower left corner of the canvas, by a style sheet alone: it lies beside the panels wherever a
viewer puts them, and lets the mouse through.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from html import escape

from tactemu.base.style import ARROW, NAN, RAMP, THEMES

WIDTH_PX, HEIGHT_PX, INSET_PX = 284, 66, 10
CANVAS = "canvas[data-engine]"
"""The canvas on which the page draws."""
_BAR_PX = 8, 24, 150, 11
"""The left, top, width and height of a colour bar in its row [pixels]."""


@dataclass(frozen=True)
class Row:
    """The texts of one quantity in the legend."""

    title: str
    top: str
    """The end of the range, with its unit; "" before the first reading that is not 0."""
    half: str
    arrow: str
    """The meaning of an arrow's length; "" if the readings are no vectors."""


def style(rows: list[Row], grid: str) -> str:
    """Return the style sheet of the canvas, with the legend of the quantities and of the grid."""
    height = max(len(rows), 1) * HEIGHT_PX
    sheets = []
    for scheme, ink, sky, haze in zip(("light", "dark"), THEMES["text"], THEMES["sky"], THEMES["haze"]):
        picture = b64encode(_svg(rows, grid, ink, height).encode()).decode()
        root = f':root[data-mantine-color-scheme="{scheme}"]'
        sheets.append(
            f"{root} {CANVAS} {{ background: radial-gradient(120% 90% at 50% 42%, {sky}, {haze} 85%); }}"
            f"{root} div:has(> {CANVAS})::after {{ background-image: url(data:image/svg+xml;base64,{picture}); }}"
        )
    sheets.append(
        f"div:has(> {CANVAS}) {{ position: relative; }}"
        f'div:has(> {CANVAS})::after {{ content: ""; position: absolute; left: {INSET_PX}px; bottom: {INSET_PX}px;'
        f" width: {WIDTH_PX}px; height: {height}px; pointer-events: none; background-repeat: no-repeat; }}"
    )
    return f"<style>{''.join(sheets)}</style>"


def _svg(rows: list[Row], grid: str, ink: str, height: int) -> str:
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH_PX}" height="{height}" fill="{ink}"'
        ' font-family="system-ui, sans-serif" font-size="11">',
        '<linearGradient id="scale">',
        *(f'<stop offset="{k / (len(RAMP) - 1):.3f}" stop-color="{each}"/>' for k, each in enumerate(RAMP)),
        "</linearGradient>",
    ]
    left, top, width, tall = _BAR_PX
    for number, row in enumerate(rows):
        low = number * HEIGHT_PX
        parts += [
            f'<text x="{left}" y="{low + 15}" font-weight="600">{escape(row.title)}</text>',
            f'<rect x="{left}" y="{low + top}" width="{width}" height="{tall}" rx="2" fill="url(#scale)"/>',
            f'<text x="{left}" y="{low + 49}">0</text>',
            f'<text x="{left + width / 2}" y="{low + 49}" text-anchor="middle">{escape(row.half)}</text>',
            f'<text x="{left + width}" y="{low + 49}" text-anchor="end">{escape(row.top)}</text>',
            f'<rect x="{left + width + 14}" y="{low + top}" width="11" height="{tall}" rx="2"'
            f' fill="{NAN}"/><text x="{left + width + 30}" y="{low + top + 10}">NaN</text>',
        ]
        if row.arrow:
            parts += [
                f'<path d="M{left + width + 14} {low + 45.5}h12m-4 -3.5l4 3.5l-4 3.5" stroke="{ARROW}"'
                ' stroke-width="2" fill="none"/>',
                f'<text x="{left + width + 31}" y="{low + 49}">{escape(row.arrow)}</text>',
            ]
    if grid:
        parts.append(f'<text x="{left}" y="{height - 3}" opacity="0.75">{escape(grid)}</text>')
    return "".join([*parts, "</svg>"])
