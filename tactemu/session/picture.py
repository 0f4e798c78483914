"""The picture of the live view at one moment, as an SVG file; the pytest plugin keeps it for a failed test."""

from __future__ import annotations

import io
import re
from pathlib import Path

from rich.console import Console
from rich.terminal_theme import TerminalTheme

from tactemu.base.style import PURPLE, THEMES, rgb
from tactemu.emulator.emulator import Emulator
from tactemu.session.live_view import LiveView

WIDTH = 110
"""Width of the picture [characters]."""
HEIGHT_OF_DEVICE = 30
"""Height of the panel of a device [characters]."""

_WEB_FONTS = re.compile(r"@font-face\s*\{[^}]*\}\s*")
"""The references to fonts on the network, which are removed so that the picture needs no connection."""


def _theme() -> TerminalTheme:
    """Return the colours of a dark page, with the eight of a terminal."""
    ground, text, muted, bad, good, odd, link = (
        tuple(round(255 * each) for each in rgb(THEMES[name][1]))
        for name in ("page", "text", "muted", "bad", "good", "odd", "link")
    )
    purple = tuple(round(255 * each) for each in rgb(PURPLE))
    return TerminalTheme(ground, text, [ground, bad, good, odd, link, purple, link, text, muted])


def save_picture(emulator: Emulator, path: Path) -> None:
    """Draw every device at its last sample, with its statistics, into an SVG file.

    Raises:
        OSError: the file cannot be written.
    """
    height = HEIGHT_OF_DEVICE * len(emulator.channels) + 2
    console = Console(record=True, file=io.StringIO(), width=WIDTH, height=height, force_terminal=True)
    for panel in LiveView(emulator, console).panels():
        console.print(panel)
    svg = console.export_svg(title=f"tactemu  {path.stem}", theme=_theme())
    path.write_text(_WEB_FONTS.sub("", svg), encoding="utf-8")
