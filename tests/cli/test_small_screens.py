"""The live picture where there is little room: what is said stays on the screen, whatever the size of the skin."""

import io
import re
from dataclasses import replace

import pytest
from rich.console import Console

from tactemu.base.clock import VirtualClock
from tactemu.cli.finding import Finding, tell
from tactemu.cli.fitting import fitted
from tactemu.cli.reports import say_text
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import load
from tactemu.session.live_view import LiveView


@pytest.fixture(scope="module")
def hand():
    emulator = assemble(load("inspire_rh56dftp"), AssemblyOptions(port="memory:"), clock=VirtualClock()).emulator
    with emulator:
        emulator.run(0.5)
        yield emulator


def test_a_field_is_shown_in_its_unit():
    loaded = load("anyskin")
    (skin,) = loaded.tables.skin
    skin = skin.model_copy(update={"transducer": ({"kind": "magnetic"},)})
    loaded = replace(loaded, tables=loaded.tables.model_copy(update={"skin": (skin,)}))
    console = Console(width=80, height=24, force_terminal=True, color_system=None)
    emulator = assemble(loaded, AssemblyOptions(port="memory:"), clock=VirtualClock()).emulator
    with emulator, console.capture() as capture:
        emulator.run(0.5)
        console.print(LiveView(emulator, console).picture())
    assert re.search(r"sum \S+ T   peak \S+ T ", capture.get())


@pytest.mark.parametrize(("width", "height"), [(80, 24), (40, 24), (40, 12), (120, 50)])
def test_statistics_and_port_stay_on_the_screen(hand, width, height):
    console = Console(width=width, height=height, force_terminal=True, color_system=None)
    view = LiveView(hand, console)
    with console.capture() as capture:
        console.print(view.picture())
    lines = capture.get().splitlines()
    assert len(lines) < height and max(map(len, lines)) <= width
    shown = "\n".join(lines)
    for words in ("rate ", "samples ", "missed ", "late p50/p99/max ", "memory:", "Ctrl-C ends"):
        assert words in shown, words


def test_a_finding_goes_on_below_itself_on_a_narrow_terminal_and_is_whole_in_a_pipe(capsys, monkeypatch):
    finding = Finding("neighbours", False, "other programs use two CPUs " * 4, "stop them " * 8)
    monkeypatch.delenv("COLUMNS", raising=False)
    tell([finding])
    assert len(capsys.readouterr().out.splitlines()) == 2
    monkeypatch.setenv("COLUMNS", "80")
    tell([finding])
    first, *others = capsys.readouterr().out.splitlines()
    assert first.startswith("no   neighbours  other programs") and len(others) > 1 and len(first) <= 80
    assert all(len(line) <= 80 and line[:17].isspace() and not line[17].isspace() for line in others)


@pytest.mark.parametrize("is_terminal", [True, False])
def test_an_event_breaks_between_words_on_a_terminal_only(hand, is_terminal):
    screen = io.StringIO()
    screen.isatty = lambda: is_terminal
    say_text(Console(file=screen, width=60, color_system=None))("summary", **hand.summary()[0])
    lines = screen.getvalue().splitlines()
    assert all(len(line) <= 60 for line in lines) == is_terminal and (len(lines) > 1) == is_terminal


def test_figures_behind_a_long_name_are_indented_below_it():
    name, figures = "ContactDepthProbe in Genesis's scene, 4096 taxels", "777.4 µs (step 593.9, read 183.5)  aim 900"
    row = f"{name}   {figures}"
    assert list(fitted([row], 80)) == [f"{name}   777.4 µs (step 593.9, read", "    183.5)  aim 900"]
    assert list(fitted(["a paragraph of six words here"], 20)) == ["a paragraph of six", "words here"]
    assert list(fitted([f"{name}   777.4 µs"], 20)) == [f"{name}   777.4 µs"]  # a page scrolls along its rows
