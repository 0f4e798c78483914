"""The live view's picture of one moment, as a file: what a failed test leaves behind."""

from __future__ import annotations

import io
import re
from pathlib import Path

from rich.console import Console

from tactemu.emulator.emulator import Emulator
from tactemu.session.live_view import LiveView

WIDTH, HEIGHT_OF_DEVICE = 110, 30
"""Characters."""

_WEB_FONTS = re.compile(r"@font-face\s*\{[^}]*\}\s*")
"""A picture asks no host for a font."""


def save_picture(emulator: Emulator, path: Path) -> None:
    """Draw every device as it was at its last sample, with its statistics, into an SVG file.

    Raises:
        OSError: it cannot be written.
    """
    height = HEIGHT_OF_DEVICE * len(emulator.channels) + 2
    console = Console(record=True, file=io.StringIO(), width=WIDTH, height=height, force_terminal=True)
    for panel in LiveView(emulator, console).panels():
        console.print(panel)
    svg = console.export_svg(title=f"tactemu  {path.stem}")
    path.write_text(_WEB_FONTS.sub("", svg), encoding="utf-8")
