"""The live view of a running emulator on one screen, drawn by a thread of its own so that the loop never waits."""

from __future__ import annotations

import sys
import threading
import time

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from firmware_protocols.senses import QUANTITY_UNITS
from tactemu.base.frame_text import text
from tactemu.base.statistics import counter_words
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.session.heatmap import draw_all, taxel_magnitudes

PERIOD_S = 0.1
PAUSE_PER_DRAWING_TIME = 5
"""Ratio of pause to drawing time, at least; large pictures are therefore drawn less often."""
SWITCH_INTERVAL_S = 5e-4
"""Longest time for which the drawing thread keeps the interpreter when the loop's deadline passes."""
SHOWN_UNITS = {"pressure": ("kPa", 1e-3), "depth": ("mm", 1e3), "displacement": ("mm", 1e3)}
"""The units of quantities that are not shown in their SI unit, each with its number per SI unit."""
MAX_MISSED_SHARE = 0.01
"""Share of missed samples above which their number is red."""
BORDER_ROWS = 2
BORDER_COLUMNS = 4
MAX_HEX_BYTES = 96
"""Maximum number of bytes of a frame on the screen."""


class LiveView:
    """A live view that is drawn inside its ``with`` statement::

    with LiveView(emulator, console):
        emulator.run()
    """

    def __init__(self, emulator: Emulator, console: Console):
        self._emulator = emulator
        self._live = Live(console=console, auto_refresh=False, screen=False, transient=True)
        self._peaks: dict[str, float] = {}
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._draw_on, name="tactemu-view", daemon=True)

    def __enter__(self):
        self._interval = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._live.start()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._done.set()
        self._thread.join()
        self._live.stop()
        sys.setswitchinterval(self._interval)

    def _draw_on(self) -> None:
        pause = PERIOD_S
        while not self._done.wait(pause):
            begun = time.perf_counter()
            self._live.update(self.picture(), refresh=True)
            pause = max(PERIOD_S, PAUSE_PER_DRAWING_TIME * (time.perf_counter() - begun))

    def rehearse(self) -> None:
        """Draw one picture without showing it, before a port is open, since the first picture takes longest."""
        with self._live.console.capture():
            self._live.console.print(self.picture())

    def picture(self) -> RenderableType:
        """Return the screen: a panel per device."""
        return Group(*self.panels(), Text("Ctrl-C ends", style="dim"))

    def panels(self) -> list[Panel]:
        """Return a panel per device; together they fill the screen except for a line."""
        width, height = self._live.console.size
        channels = self._emulator.channels
        room = (height - 2) // len(channels)  # the cursor takes the last line of a terminal
        return [self._panel(channel, width, room) for channel in channels]

    def _panel(self, channel: Channel, width: int, height: int) -> Panel:
        """Return the panel of one device in ``width`` by ``height`` characters: the texts, and in the remaining lines
        its pictures."""
        title = f"{channel.name}  {channel.wire.transport.address}"
        sample = self._emulator.truth.latest(channel.name)
        device = channel.device
        values = (
            taxel_magnitudes(device.layout, device.contact[0], sample.measured)
            if sample
            else np.zeros(len(device.layout))
        )
        peak = self._peaks[channel.name] = max(self._peaks.get(channel.name, 0.0), float(np.max(values, initial=0.0)))
        unit, scale = SHOWN_UNITS.get(device.contact[0], (QUANTITY_UNITS[device.contact[0]], 1.0))
        summary = f"sum {values.sum() * scale:.4g} {unit}   peak {max(values.max(initial=0.0), 0.0) * scale:.4g} {unit}"
        inside = width - BORDER_COLUMNS
        words = [Text(summary), *_numbers(channel, inside), self._last_frame(channel, inside)]
        taken = sum(len(text.wrap(self._live.console, inside)) for text in words)
        maps = draw_all(device.layout, values, peak, inside, height - BORDER_ROWS - taken)
        return Panel(Group(maps, *words), title=title, title_align="left")

    def _last_frame(self, channel: Channel, width: int) -> Text:
        frame = self._emulator.truth.latest_frame(channel.name)
        if not channel.wire.transport.has_reader:
            return Text(f"waiting for a driver to open {channel.wire.transport.address}", style="yellow")
        if frame is None:
            return Text("nothing sent yet: this sensor speaks when it is asked", style="dim")
        shown = text(frame)
        cut = shown[: min(2 * MAX_HEX_BYTES, 2 * width - 20)]
        return Text("last frame  ", style="dim").append(cut + ("…" if len(shown) > len(cut) else ""), style="cyan")


def _numbers(channel: Channel, width: int) -> list[Text]:
    """Return rates, drops and lateness, in lines of at most ``width`` characters."""
    statistics = channel.statistics
    late = statistics.lateness
    latest = (late.percentile_ns(50), late.percentile_ns(99), late.max_ns)
    cells = {
        "rate": f"{statistics.rate_hz:.1f} Hz",
        "samples": str(statistics.samples),
        "missed": str(statistics.missed),
        "late p50/p99/max": "/".join(f"{ns / 1e3:.0f}" for ns in latest) + " µs",
        **{counter_words(name): str(count) for name, count in channel.wire.counters.items() if count},
    }
    too_many = statistics.missed > MAX_MISSED_SHARE * max(statistics.samples, 1)
    lines = [Text()]
    for name, value in cells.items():
        cell = Text(name, style="dim").append(f" {value}", "bold red" if name == "missed" and too_many else "default")
        if not lines[-1]:
            lines[-1] = cell
        elif len(lines[-1]) + 2 + len(cell) <= width:
            lines[-1] = Text("  ").join([lines[-1], cell])
        else:
            lines.append(cell)
    return lines
