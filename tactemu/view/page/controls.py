"""The controls of a page: touch, break, imperfections, and the keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import viser

from tactemu.view.page.feed import DescribedRun
from tactemu.view.page.viewer_commands import Report, ViewerCommands

SHARES = ("drop", "flip", "truncate", "checksum", "duplicate", "garbage", "late")
"""The faults that hit a share of the frames, which a slider sets."""
_ANSWER_S, _ERROR_S = 4.0, 8.0
"""The times for which the notification of a command, and that of an error, stay."""

Command = tuple[str, dict[str, Any]]
"""A control command and its arguments."""


class Controls:
    """The controls that send commands, in sections.

    Args:
        gui: viser's controls; the sections are added where its context is now.
        run: the bodies and skins of the emulator.
        viewer_commands: sends the commands.
        target: returns the names of the selected skin and the number of the selected taxel.
        answered: receives the words of a command that is done.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        run: DescribedRun,
        viewer_commands: ViewerCommands,
        target: Callable[[], tuple[str, int]],
        answered: Callable[[str], str],
    ):
        self._gui, self._run, self._viewer_commands = gui, run, viewer_commands
        self._target, self._answered = target, answered
        self._notifications: dict[int, Any] = {}
        """The last notification of each viewer; a new one takes its place."""
        self._shares: dict[tuple[str, str], str] = {}
        """The fault that the slider has begun, by skin and kind."""
        self._keys: list[tuple[str, str]] = []
        self._add_touch()
        self._add_breaking()
        self._add_imperfections()

    # -- the sections --------------------------------------------------------------------------------------------------

    def _add_touch(self) -> None:
        gui = self._gui
        with gui.add_folder("Touch"):
            depth = gui.add_slider("depth [mm]", 0.1, 5.0, 0.1, 1.0, hint="How far the body goes into the skin")
            dwell = gui.add_slider("time [s]", 0.1, 10.0, 0.1, 1.0, hint="How long the body stays at that depth")
            body = gui.add_button_group(
                "body", ("Press taxel", "Give back"),
                hint="Press taxel: the nearest body presses the selected taxel. Give back: all bodies follow their own "
                "motion again. You can also drag a body in the scene.",
            )  # fmt: skip

        def press() -> list[Command]:
            skin, taxel = self._target()
            arguments = {"depth": depth.value * 1e-3, "dwell": dwell.value, "taxel": taxel, "skin": skin, "wait": False}
            return [("press", arguments)]

        @body.on_click
        async def _(event: viser.GuiEvent) -> None:
            if body.value == "Press taxel":
                self._submit(event.client, press())
            else:
                self._viewer_commands.give_back(None, self._error(event.client), self._done(event.client))

        self.add_key("P", "Press the selected taxel", lambda client: self._submit(client, press()))
        self.add_key("escape", "Give back the body that you hold", self._give_back)

    def _give_back(self, client: viser.ClientHandle) -> None:
        self._viewer_commands.give_back(client.client_id, self._error(client), self._done(client))

    def _add_breaking(self) -> None:
        gui = self._gui
        with gui.add_folder("Break"):
            device = gui.add_button_group(
                "device", ("Unplug", "Hang", "Reboot"),
                hint="Unplug: the port vanishes for 1 s. Hang: the device neither samples nor answers for 1 s. Reboot: "
                "it starts as after power-up.",
            )  # fmt: skip
            share = gui.add_dropdown(
                "fault", SHARES, hint="The fault that the slider below sets; `tactemu faults` explains each"
            )
            percent = gui.add_slider(
                "frames [%]", 0.0, 100.0, 1.0, 0.0, hint="The share of the frames that this fault hits; 0 ends it"
            )
            with gui.add_form(None) as form:
                words = gui.add_text(
                    "any fault", "", hint="A fault in the words of `tactemu faults`, such as: late 20% by 30ms"
                )
            faults = gui.add_button_group(
                "faults", ("Begin it", "Mend all"),
                hint="Begin it: the fault in the box above, as Enter does. Mend all: every fault ends, and the port "
                "comes back.",
            )  # fmt: skip

        @device.on_click
        async def _(event: viser.GuiEvent) -> None:
            skin = {"skin": self._target()[0]}
            commands: dict[str, Command] = {
                "Unplug": ("unplug", {"seconds": 1.0, **skin}),
                "Hang": ("hang", {"seconds": 1.0, **skin}),
                "Reboot": ("reset", skin),
            }
            self._submit(event.client, [commands[device.value]])

        @percent.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._set_share(event.client, share.value, percent.value)

        async def begin(event: viser.GuiEvent) -> None:
            if words.value.strip():
                self._submit(event.client, [("fault", {"fault": words.value.strip(), "skin": self._target()[0]})])

        @faults.on_click
        async def _(event: viser.GuiEvent) -> None:
            if faults.value == "Begin it":
                await begin(event)
                return
            self._shares.clear()
            percent.value = 0.0
            self._submit(event.client, [("mend", {"skin": self._target()[0]})])

        form.on_submit(begin)

    def _set_share(self, client: viser.ClientHandle, kind: str, percent: float) -> None:
        """Replace the fault that the slider has begun on the selected skin."""
        skin = self._target()[0]
        commands: list[Command] = []
        if before := self._shares.pop((skin, kind), None):
            commands.append(("mend", {"fault": before, "skin": skin}))
        if percent > 0:
            fault = self._shares[skin, kind] = f"{kind} {percent:g}%"
            commands.append(("fault", {"fault": fault, "skin": skin}))
        self._submit(client, commands)

    def _add_imperfections(self) -> None:
        gui = self._gui
        options = {name: list(skin.about.get("adjustable", ())) for name, skin in self._run.skins.items()}
        there = sorted({option for each in options.values() for option in each if option != "dead"})
        has_dead = any("dead" in each for each in options.values())
        with gui.add_folder("Imperfections", expand_by_default=bool(there) or has_dead):
            if there:
                option = gui.add_dropdown(
                    "option", there, hint="The imperfection that changes; docs/sensors.md has each"
                )
                value = gui.add_number("value", 0.0, step=1e-6, hint="Its new value, in the option's unit")
                change = gui.add_button_group("change", ("Set",), hint="Give the option this value from now on")

                @change.on_click
                async def _(event: viser.GuiEvent) -> None:
                    arguments = {"options": {option.value: value.value}, "skin": self._target()[0]}
                    self._submit(event.client, [("set", arguments)])

            if has_dead:
                kill = gui.add_button_group(
                    "taxel", ("Make it dead",), hint="From now on the selected taxel returns its last reading"
                )

                @kill.on_click
                async def _(event: viser.GuiEvent) -> None:
                    skin, taxel = self._target()
                    self._submit(event.client, [("dead", {"taxels": [taxel], "skin": skin})])

            else:
                gui.add_html(
                    '<div class="tt">To change more, start the run with <code>--adjustable noise --adjustable dead'
                    "</code>.</div>"
                )

    # -- keys ----------------------------------------------------------------------------------------------------------

    def add_key(self, key: Any, label: str, pressed: Callable[[viser.ClientHandle], None]) -> None:
        """Let a key do something for the viewer who presses it."""
        command = self._gui.add_command(label, hotkey=key)
        self._keys.append(("Esc" if key == "escape" else key, label))

        @command.on_trigger
        async def _(event: Any) -> None:
            pressed(event.client)

    def add_keys_section(self) -> None:
        """Add the section that lists all keys."""
        rows = "".join(
            f"<tr><td><kbd>{escape(key)}</kbd></td><td>{escape(label)}</td></tr>" for key, label in self._keys
        )
        with self._gui.add_folder("Keys"):
            self._gui.add_html(f'<div class="tt"><table class="tt-keys">{rows}</table></div>')

    # -- answers -------------------------------------------------------------------------------------------------------

    def _submit(self, client: viser.ClientHandle | None, commands: Sequence[Command]) -> None:
        for verb, arguments in commands:
            self._viewer_commands.submit(verb, self._error(client), self._done(client), **arguments)

    def _done(self, client: viser.ClientHandle | None) -> Report:
        def say(text: str) -> None:
            remark = self._answered(text if client is None else f"{text} (viewer {client.client_id + 1})")
            self.notify(client, text[:1].upper() + text[1:], remark, _ANSWER_S, "teal")

        return say

    def _error(self, client: viser.ClientHandle | None) -> Report:
        return lambda text: self.notify(client, "That cannot be done", text[:300], _ERROR_S, "red")

    def notify(self, client: viser.ClientHandle | None, title: str, text: str, seconds: float, colour: Any) -> None:
        """Show a notification to a viewer, in place of their last one."""
        if client is None:
            return
        if (last := self._notifications.pop(client.client_id, None)) is not None:
            last.remove()
        self._notifications[client.client_id] = client.add_notification(
            title, text, auto_close_seconds=seconds, color=colour
        )
