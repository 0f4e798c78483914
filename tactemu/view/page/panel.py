"""The panels of a page: the controls, and the views beside the scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser

from tactemu.view.page.controls import Controls
from tactemu.view.page.curves import Curves
from tactemu.view.page.feed import Baseline, DescribedRun, PageSkin, PageState
from tactemu.view.page.pictures import ALL, KINDS, Pictures
from tactemu.view.page.ranges import Ranges
from tactemu.view.page.readings import readings_html, statistics_html
from tactemu.view.page.viewer_commands import ViewerCommands
from tactemu.view.page.wire import Wire

READ_HZ = 5.0
"""The rate at which text, pictures and curves are renewed: a browser takes longer to lay them out than to draw the
scene."""
_RIGHT_PX = 400
_LEFT_PX = 290
_UNHEARD = "No driver has the port open."


class Panel:
    """The panels for one emulator.

    Args:
        server: viser's server; its present panels are removed.
        run: the bodies and skins of the emulator.
        viewer_commands: sends the commands.
        datasheet: returns the lines of a device's datasheet, or why there is none.
        title: the title of the page.
        show_skin: places the camera of a viewer before the skin.
        ranges: the ranges of the readings.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        run: DescribedRun,
        viewer_commands: ViewerCommands,
        datasheet: Callable[[PageSkin], Sequence[str]],
        title: str,
        show_skin: Callable[[viser.ClientHandle], None],
        ranges: Ranges,
    ):
        self._run, self._viewer_commands, self._datasheet = run, viewer_commands, datasheet
        self._next_read_s = self._t_s = 0.0
        self._answer = ""
        self._is_held = False
        self._pictures, self._wire = Pictures(ranges), Wire(run)
        self._baselines = {name: Baseline(skin) for name, skin in run.skins.items()}
        gui = self._gui = server.gui
        gui.reset()
        gui.set_panel_label(title)
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        self._status = gui.add_html("")
        names = list(run.skins) or ["none"]
        self._skin = gui.add_dropdown("skin", names, hint="Its pictures, numbers, wire and datasheet are shown")
        self._taxel = gui.add_number("taxel", 0, min=0, step=1, hint="The taxel to press; or click one in the scene")
        self._controls = Controls(gui, run, viewer_commands, self._target, self._command_done)
        self._controls.add_key("F", "Find the skin: it fills the scene", show_skin)
        self._controls.add_key("N", "Show the next skin", lambda client: self._show_next_skin())
        self._controls.add_key("H", "Hold pictures, curves and wire, or go on", lambda client: self._toggle_hold())
        self._controls.add_keys_section()
        gui.main_panel.dock_left()
        gui.main_panel.set_width(_LEFT_PX)
        self._add_views()
        self._skin.on_update(self._skin_chosen)
        self._choose_skin()

    @property
    def skin(self) -> PageSkin | None:
        """The selected skin: its pictures, wire, statistics and datasheet are shown."""
        return self._run.skins.get(self._skin.value)

    def _target(self) -> tuple[str, int]:
        return self._skin.value, int(self._taxel.value)

    # -- what is shown -------------------------------------------------------------------------------------------------

    def _add_views(self) -> None:
        gui = self._gui
        upper, lower = gui.add_panel(), gui.add_panel()
        with upper.add_tab("Pictures"):
            self._shown = gui.add_button_group(
                "show", (ALL, *KINDS),
                hint="Ideal: without imperfections. Measured: with them. Sent: the counts, as change from baseline.",
            )  # fmt: skip
            self._flat = gui.add_html("")
        with upper.add_tab("Curves"):
            self.curves = Curves(gui, self._run.skins, self._target)
        with upper.add_tab("Numbers"):
            self._numbers = gui.add_html("")
        with lower.add_tab("Wire"):
            self._running = gui.add_html("")
        with lower.add_tab("Statistics"):
            self._statistics = gui.add_html("")
        with lower.add_tab("Datasheet"):
            self._details = gui.add_html("")
        upper.dock_right()
        upper.set_width(_RIGHT_PX)
        lower.dock_below(upper)
        upper.expand()  # a phone shows a panel as a closed section unless it is told

    async def _skin_chosen(self, _: viser.GuiEvent) -> None:
        self._choose_skin()

    def _choose_skin(self) -> None:
        skin = self.skin
        if skin is None:
            return
        self._viewer_commands.skin = skin.name
        self._taxel.max = max(len(skin.layout) - 1, 0)
        self._taxel.value = min(self._taxel.value, self._taxel.max)
        lines = "\n".join(self._datasheet(skin))
        self._details.content = (
            f'<div class="tt"><div class="tt-wide"><pre class="tt-sheet">{escape(lines)}</pre></div></div>'
        )
        self._wire = Wire(self._run)
        self._shown.value = ALL if len(skin.layout.patches) == 1 else KINDS[1]

    def _show_next_skin(self) -> None:
        names = list(self._run.skins)
        if names:
            self._skin.value = names[(names.index(self._skin.value) + 1) % len(names)]
            self._choose_skin()

    def _toggle_hold(self) -> None:
        self._is_held = not self._is_held
        self._next_read_s = 0.0

    def choose_taxel(self, skin: str, taxel: int) -> None:
        """Select a taxel that a viewer has clicked, and its skin."""
        self._skin.value = skin
        self._choose_skin()
        self._taxel.value = taxel
        self.curves.choose(skin, taxel)

    def draw(self, state: PageState, words: str) -> None:
        """Show a state; text, pictures and curves are renewed at :data:`READ_HZ` only."""
        self._t_s = state.t_s
        is_due = (now := time.monotonic()) >= self._next_read_s
        looked_at = {name for name, _ in self.curves.chosen}
        deviations = {
            name: self._baselines[name].deviation(sample)
            for name, sample in state.samples.items()
            if name in self._baselines and (is_due or name in looked_at)
        }
        if not self._is_held:
            self.curves.add(state.t_s, state.samples, deviations)
            if state.wire or state.missing:
                self._wire.add(state.wire, state.missing)
        if not is_due:
            return
        self._next_read_s = now + 1 / READ_HZ
        self._show_status(state, words)
        if not self._is_held:
            self._show_views(state, deviations)

    def _show_views(self, state: PageState, deviations: Mapping[str, np.ndarray | None]) -> None:
        skin = self.skin
        if skin is not None:
            sample = state.samples.get(skin.name)
            pictures = self._pictures.html(skin, sample, deviations.get(skin.name), self._shown.value)
            _show(self._flat, pictures)
            _show(self._numbers, readings_html(skin, sample, int(self._taxel.value)))
        self.curves.draw()
        _show(self._running, self._wire.html())

    def _show_status(self, state: PageState, words: str) -> None:
        holders = self._viewer_commands.holders
        lines = [f"<b>{state.t_s:.1f} s</b>, {escape(words)}"]
        if self._is_held:
            lines.append("<b>The panels are held.</b> Press H to go on.")
        if self.skin is not None and self._wire.is_unheard(self.skin.name):
            lines.append(f'<span class="tt-dim">{_UNHEARD}</span>')
        lines += [
            f"{escape(body)}: {holder_text(holders.get(body))}"
            for body, each in state.bodies.items()
            if each["in_hand"] and body in holders
        ]
        if self._answer:
            lines.append(f'<div class="tt-answer">{escape(self._answer)}</div>')
        _show(self._status, f'<div class="tt tt-status">{"<br>".join(lines)}</div>')

    def _command_done(self, text: str) -> str:
        """Show what a command has done in the status, and return a remark if no driver can notice it."""
        self._answer = f"{self._t_s:.1f} s: {text}"
        self._next_read_s = 0.0
        return _UNHEARD if self.skin is not None and self._wire.is_unheard(self.skin.name) else ""

    def end(self, t_s: float, why: str) -> None:
        """Report that nothing more comes."""
        words = f'<span class="tt-wrong">{escape(why)}</span><br>The page shows the state at {t_s:.1f} s.'
        _show(self._status, f'<div class="tt tt-status">{words}</div>')

    def numbers(self, stats: Mapping[str, Any]) -> None:
        """Show the emulator's statistics."""
        _show(self._statistics, statistics_html(stats))


def holder_text(viewer: int | None) -> str:
    """Return the text for the holder of a body: ``viewer 1 has it``."""
    return "held" if viewer is None else f"viewer {viewer + 1} has it"


def _show(handle: Any, content: str) -> None:
    if handle.content != content:
        handle.content = content
