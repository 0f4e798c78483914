"""The panels of a page: the controls, and the views beside the scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import viser

from tactemu.view.page.curves import Curves
from tactemu.view.page.feed import Baseline, DescribedRun, PageSkin, PageState
from tactemu.view.page.pictures import Pictures
from tactemu.view.page.viewer_commands import Report, ViewerCommands
from tactemu.view.page.wire import Wire

SHARES = ("drop", "flip", "truncate", "checksum", "duplicate", "garbage", "late")
"""The faults that hit a share of the frames, which a slider sets."""
READ_HZ = 5.0
"""The rate at which text, pictures and curves are renewed: a browser takes longer to lay them out than to draw the
scene."""
_RIGHT_PX = 430
_LEFT_PX = 300


class Panel:
    """The panels for one emulator.

    Args:
        server: viser's server; its present panels are removed.
        run: the bodies and skins of the emulator.
        viewer_commands: sends the commands.
        datasheet: returns the lines of a device's datasheet, or why there is none.
        title: the title of the page.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        run: DescribedRun,
        viewer_commands: ViewerCommands,
        datasheet: Callable[[PageSkin], Sequence[str]],
        title: str,
    ):
        self._run, self._viewer_commands, self._datasheet = run, viewer_commands, datasheet
        self._next_read_s = 0.0
        self._pictures, self._wire = Pictures(), Wire(run)
        self._baselines = {name: Baseline(skin) for name, skin in run.skins.items()}
        gui = self._gui = server.gui
        gui.reset()
        gui.set_panel_label(title)
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        self._status = gui.add_html("")
        names = list(run.skins) or ["none"]
        self._skin = gui.add_dropdown("skin", names, hint="its pictures, wire, statistics and datasheet are shown")
        self._taxel = gui.add_number("taxel", 0, min=0, step=1, hint="or click one in the scene")
        self._add_touch()
        self._add_breaking()
        self._add_imperfections()
        gui.main_panel.dock_left()
        gui.main_panel.set_width(_LEFT_PX)
        self._add_views()
        self._skin.on_update(self._skin_chosen)
        self._choose_skin()

    @property
    def skin(self) -> PageSkin | None:
        """The selected skin: its pictures, wire, statistics and datasheet are shown."""
        return self._run.skins.get(self._skin.value)

    # -- what may be done ----------------------------------------------------------------------------------------------

    def _add_touch(self) -> None:
        gui = self._gui
        with gui.add_folder("Touch"):
            gui.add_html(_padded("<small>Drag a blue body. Esc gives it back.</small>"))
            depth = gui.add_slider("depth [mm]", 0.1, 5.0, 0.1, 1.0)
            seconds = gui.add_slider("for [s]", 0.1, 10.0, 0.1, 1.0)
            press = gui.add_button("Press the taxel")
            back = gui.add_button("Give all back")
        self._on(
            press,
            lambda: [
                ("press", {"depth": depth.value * 1e-3, "dwell": seconds.value, "taxel": int(self._taxel.value),
                           "skin": self._skin.value, "wait": False})
            ],
        )  # fmt: skip

        @back.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._viewer_commands.give_back(None, reporter(event.client))

        escape_key = gui.add_command("Give back what I hold", hotkey="escape")

        @escape_key.on_trigger
        async def _(event: Any) -> None:
            self._viewer_commands.give_back(event.client.client_id, reporter(event.client))

    def _add_breaking(self) -> None:
        gui = self._gui
        with gui.add_folder("Break"):
            unplug = gui.add_button("Unplug for 1 s")
            reset = gui.add_button("Reboot")
            hang = gui.add_button("Hang for 1 s")
            share = gui.add_dropdown("fault", SHARES, hint="tactemu faults explains them")
            percent = gui.add_slider("of frames [%]", 0.0, 100.0, 1.0, 0.0)
            with gui.add_form(None) as form:
                words = gui.add_text("any fault", "", hint="such as: late 20% by 30ms; Enter begins it")
                begin = gui.add_button("Begin it")
            mend = gui.add_button("Mend all")
        skin = lambda **more: {"skin": self._skin.value, **more}  # noqa: E731
        self._on(unplug, lambda: [("unplug", skin(seconds=1.0))])
        self._on(reset, lambda: [("reset", skin())])
        self._on(hang, lambda: [("hang", skin(seconds=1.0))])
        self._on(mend, lambda: [("mend", skin())])
        self._shares: dict[tuple[str, str], str] = {}

        @percent.on_update
        async def _(event: viser.GuiEvent) -> None:
            key, say = (self._skin.value, share.value), reporter(event.client)
            if before := self._shares.pop(key, None):
                self._viewer_commands.submit("mend", say, fault=before, skin=key[0])
            if percent.value > 0:
                self._shares[key] = f"{share.value} {percent.value:g}%"
                self._viewer_commands.submit("fault", say, fault=self._shares[key], skin=key[0])

        @mend.on_click
        async def _(_: viser.GuiEvent) -> None:
            self._shares.clear()
            percent.value = 0.0

        async def ask(event: viser.GuiEvent) -> None:
            if words.value.strip():
                self._viewer_commands.submit(
                    "fault", reporter(event.client), fault=words.value.strip(), skin=self._skin.value
                )

        form.on_submit(ask)
        begin.on_click(ask)

    def _add_imperfections(self) -> None:
        gui = self._gui
        options = {name: list(skin.about.get("adjustable", ())) for name, skin in self._run.skins.items()}
        there = sorted({option for each in options.values() for option in each if option != "dead"})
        with gui.add_folder("Imperfections", expand_by_default=bool(there)):
            if there:
                option = gui.add_dropdown("option", there)
                value = gui.add_number("value", 0.0, step=1e-6)
                change = gui.add_button("Set")
                self._on(change, lambda: [("set", {"options": {option.value: value.value}, "skin": self._skin.value})])
            if any("dead" in each for each in options.values()):
                kill = gui.add_button("Kill the taxel")
                taxel = lambda: {"taxels": [int(self._taxel.value)], "skin": self._skin.value}  # noqa: E731
                self._on(kill, lambda: [("dead", taxel())])
            else:
                gui.add_html(
                    _padded("<small>To change more, start the run with --adjustable noise --adjustable dead.</small>")
                )

    def _on(self, button: viser.GuiButtonHandle, commands: Callable[[], list[tuple[str, dict[str, Any]]]]) -> None:
        @button.on_click
        async def _(event: viser.GuiEvent) -> None:
            for verb, arguments in commands():
                self._viewer_commands.submit(verb, reporter(event.client), **arguments)

    # -- what is shown -------------------------------------------------------------------------------------------------

    def _add_views(self) -> None:
        gui = self._gui
        upper, lower = gui.add_panel(), gui.add_panel()
        with upper.add_tab("Pictures"):
            self._flat = gui.add_html("")
        with upper.add_tab("Curves"):
            self.curves = Curves(gui)
        with lower.add_tab("Wire"):
            self._running = gui.add_html("")
        with lower.add_tab("Statistics"):
            self._numbers = gui.add_html("")
        with lower.add_tab("Datasheet"):
            self._details = gui.add_html("")
        upper.dock_right()
        upper.set_width(_RIGHT_PX)
        lower.dock_below(upper)

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
        self._details.content = f'<pre class="sheet">{escape(lines)}</pre>{_SHEET}'
        self._wire = Wire(self._run)

    def choose_taxel(self, skin: str, taxel: int) -> None:
        """Select a taxel that a viewer has clicked, and its skin."""
        self._skin.value = skin
        self._choose_skin()
        self._taxel.value = taxel
        self.curves.choose(skin, taxel)

    def draw(self, state: PageState, words: str) -> None:
        """Show a state; text, pictures and curves are renewed at :data:`READ_HZ` only."""
        is_due = (now := time.monotonic()) >= self._next_read_s
        looked_at = {name for name, _ in self.curves.chosen}
        deviations = {
            name: self._baselines[name].deviation(sample)
            for name, sample in state.samples.items()
            if name in self._baselines and (is_due or name in looked_at)
        }
        self.curves.add(state.t_s, state.samples, deviations)
        if state.wire or state.missing:
            self._wire.add(state.wire, state.missing)
        if not is_due:
            return
        self._next_read_s = now + 1 / READ_HZ
        holders = self._viewer_commands.holders
        held = [
            f"{escape(body)}: {holder_text(holders.get(body))}"
            for body, each in state.bodies.items()
            if each["in_hand"] and body in holders
        ]
        lines = [f"<b>{state.t_s:.1f} s</b>, {words}", *held]
        _show(self._status, _padded("<br>".join(lines)))
        skin = self.skin
        if skin is not None:
            _show(self._flat, self._pictures.html(skin, state.samples.get(skin.name), deviations.get(skin.name)))
        self.curves.draw()
        _show(self._running, self._wire.html())

    def end(self, t_s: float, why: str) -> None:
        """Report that nothing more comes."""
        words = f'<b style="color:#e03131">{escape(why)}</b><br>the last picture is of {t_s:.1f} s'
        _show(self._status, _padded(words))

    def numbers(self, stats: Mapping[str, Any]) -> None:
        """Show the emulator's statistics."""
        tables = [_table(name, entry) for name, entry in stats.get("skins", {"wire": stats}).items()]
        _show(self._numbers, "".join(tables) + _SHEET)


def holder_text(viewer: int | None) -> str:
    """Return the text for the holder of a body: ``viewer 1 has it``."""
    return "held" if viewer is None else f"viewer {viewer + 1} has it"


def reporter(client: viser.ClientHandle | None) -> Report:
    """Return a callable that shows an error to a viewer."""

    def say(text: str) -> None:
        if client is not None:
            client.add_notification("That cannot be done", text[:300], auto_close_seconds=8.0, color="red")

    return say


def _padded(html: str) -> str:
    return f'<div style="padding: 0 0.8em 0.5em">{html}</div>'


def _show(handle: Any, content: str) -> None:
    if handle.content != content:
        handle.content = content


def _table(name: str, entry: Mapping[str, Any]) -> str:
    rows = []
    for what, value in entry.items():
        if isinstance(value, Mapping):
            rows += [f"<tr><td>{escape(what)}: {escape(k)}</td><td>{v}</td></tr>" for k, v in value.items()]
        elif what != "skin":
            rows.append(f"<tr><td>{escape(what.replace('_', ' '))}</td><td>{value}</td></tr>")
    return f'<table class="numbers"><tr><th colspan="2">{escape(name)}</th></tr>{"".join(rows)}</table>'


_SHEET = """<style>
pre.sheet { font-size: 11px; overflow: auto; max-height: 60vh; margin: 0; }
table.numbers { font-size: 12px; width: 100%; }
table.numbers th { text-align: left; }
table.numbers td:last-child { text-align: right; font-variant-numeric: tabular-nums; }
</style>"""
