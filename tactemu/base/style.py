"""The one look of everything that tactemu draws: colours, type, tables and figures of reports, plots and the site.

The colours of data are those of Okabe and Ito's palette for colour-blind eyes that show on a light and on a dark page.
Colours of text and surfaces are pairs, for a light and a dark page; ``style.css`` uses them as variables, such as
``var(--muted)``.

Pictures are drawn in the colours of a light page. In an HTML page :func:`themed` makes them follow the page.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols.layouts import PATCH_COLOURS

SERIES = PATCH_COLOURS
"""The colours of curves and points, in the order in which they are used."""
BLUE, VERMILION, _, PURPLE = SERIES
IDEAL, MEASURED = BLUE, VERMILION
"""The colours of a reading without imperfections, and with them."""
RAMP = ("#363861", "#5a3e88", "#8a4096", "#c23f83", "#e6536b", "#fe7353", "#ff9b44", "#ffc454", "#fcea7e")
"""The scale of readings at equal steps from 0 to the largest: dark violet, red, orange, pale yellow.

Its lightness rises all the way, so that the order of readings is visible without colour vision.
"""
ARROW = "#218cf2"
"""The colour of forces in the scene of the live page: no reading has it."""
NAN = "#00d9bf"
"""The colour of a reading that is not a number: turquoise, which the scale does not contain."""
THEMES = {
    "text": ("#1c2128", "#dde3ea"),
    "muted": ("#5a646f", "#9aa4af"),
    "page": ("#ffffff", "#14181d"),
    "panel": ("#f3f5f8", "#1f262e"),
    "key": ("#f1f3f6", "#31353c"),
    "line": ("#d3d9e0", "#39424c"),
    "link": ("#0b5d9c", "#6cb6f5"),
    "good": ("#00704e", "#3ecf9f"),
    "odd": ("#8a5a00", "#e5ad45"),
    "bad": ("#b23c00", "#ff8f5e"),
    "sky": ("#fbfcfd", "#2c313a"),
    "haze": ("#e3e8ee", "#16191e"),
    "mark": ("#ffdcc9", "#6b2a0c"),
}
"""The colours of text and surfaces by name: on a light page, on a dark page."""
LIGHT = {name: pair[0] for name, pair in THEMES.items()}
"""The colours of a light page, in which pictures are drawn."""


def rgb(colour: str) -> np.ndarray:
    """Return red, green and blue of a colour such as ``#0072b2``, each from 0 to 1."""
    return np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255


def colours(shares: np.ndarray | float) -> np.ndarray:
    """Return the colours of shares of the largest reading (0 to 1): RGB from 0 to 1, shape ``(..., 3)``."""
    shares = np.asarray(shares, float)
    ramp = np.array([rgb(colour) for colour in RAMP])
    at = np.linspace(0.0, 1.0, len(ramp))
    mixed = np.stack([np.interp(np.nan_to_num(shares), at, channel) for channel in ramp.T], axis=-1)
    return np.where(np.isnan(shares)[..., None], rgb(NAN), mixed)


# -- pages ---------------------------------------------------------------------------------------------------------


def stylesheet(light: str = ":root", dark: str = "") -> str:
    """Return the style sheet, with the colours as variables.

    Args:
        light: the selector of a light page.
        dark: the selector of a dark page; default: the browser's preference decides.
    """
    day, night = ("".join(f"--{name}: {pair[k]}; " for name, pair in THEMES.items()) for k in (0, 1))
    series = "".join(f"--series-{k}: {colour}; " for k, colour in enumerate(SERIES, 1))
    night = f"{dark} {{ {night}}}" if dark else f"@media (prefers-color-scheme: dark) {{ :root {{ {night}}} }}"
    rules = Path(__file__).with_suffix(".css").read_text(encoding="utf-8")
    return f":root {{ {series}}}\n{light} {{ {day}}}\n{night}\n{rules}"


PAGE_SIGN = '<link rel="icon" href="data:,">'
"""A text in the head of each page that tactemu writes, and of few others."""


def page(title: str, parts: Sequence[str], *, command: str = "") -> str:
    """Return an HTML page without scripts and external resources.

    Args:
        title: the title of the page; headings are parts.
        parts: pieces of HTML.
        command: the command that makes the page; its last line shows it.
    """
    made = f"<footer>Made by <code>{escape(command)}</code></footer>" if command else ""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">{PAGE_SIGN}'
        f'<title>{escape(title)}</title><style>{stylesheet()}</style></head><body class="report">\n'
        + "\n".join(filter(None, [*parts, made]))
        + "\n</body></html>\n"
    )


def figure(picture: str, caption: str = "", *, command: str = "") -> str:
    """Return a figure of a page: an SVG, and below it what it shows and the command that makes it."""
    below = " ".join(filter(None, [escape(caption), f"<code>{escape(command)}</code>" if command else ""]))
    return f"<figure>{themed(picture)}<figcaption>{below}</figcaption></figure>"


def themed(svg: str) -> str:
    """Return an SVG whose colours of a light page are those of the page that holds it."""
    names = {colour: name for name, colour in LIGHT.items()}
    names |= {colour: f"series-{k}" for k, colour in enumerate(SERIES, 1)}
    return re.sub(r"#[0-9a-f]{6}\b", lambda found: f"var(--{names[found[0]]})" if found[0] in names else found[0], svg)


# -- plots ---------------------------------------------------------------------------------------------------------


def plot_style() -> dict[str, Any]:
    """Return the settings of matplotlib, for ``matplotlib.rc_context``."""
    from cycler import cycler  # comes with matplotlib

    text = dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), LIGHT["text"])
    return {
        **text,
        "font.family": "sans-serif", "font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left",
        "axes.titleweight": "bold", "figure.titlesize": 12, "axes.edgecolor": LIGHT["muted"],
        "axes.facecolor": LIGHT["page"], "figure.facecolor": LIGHT["page"], "axes.spines.top": False,
        "axes.spines.right": False, "axes.prop_cycle": cycler(color=SERIES), "axes.grid": True,
        "axes.axisbelow": True, "grid.color": LIGHT["line"], "grid.linewidth": 0.6, "lines.linewidth": 1.2,
        "legend.frameon": False, "svg.fonttype": "none", "svg.hashsalt": "tactemu",
    }  # fmt: skip


def plot_colours() -> Any:
    """Return the scale of readings as a colour map of matplotlib."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("readings", RAMP)
