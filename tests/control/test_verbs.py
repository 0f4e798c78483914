"""The commands are declared once: who carries them out, the command line and the manual agree with that."""

import inspect
from pathlib import Path

import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.units import LENGTHS_M, TIMES_S, scaled
from tactemu.cli.words import quantity
from tactemu.control.argument_types import plain
from tactemu.control.control import Control
from tactemu.control.control_commands import CONTROL_COMMANDS, ControlCommands
from tactemu.wire.faults import parse as parse_fault
from tests.cli.command import here

PAGE = Path(__file__).parents[2] / "docs" / "live-control.md"


@pytest.mark.parametrize("name", CONTROL_COMMANDS)
def test_every_verb_can_be_done_explained_and_typed(name):
    verb = CONTROL_COMMANDS[name]
    takes = inspect.signature(getattr(Control, f"_{verb.method}")).parameters
    anything = any(each.kind is each.VAR_KEYWORD for each in takes.values())
    for argument in verb.arguments.values():
        assert argument.about, f"{name}: {argument.name} is not explained"
        assert anything or argument.name in takes
    help_text = here("poke", name, "--help").stdout
    assert f"    tactemu poke {name}" in help_text, "an example to copy"
    assert f"| `{name}" in PAGE.read_text(), "a row of the manual"
    for type_ in (tt.Served, tt.Connection):
        assert issubclass(type_, ControlCommands)


@pytest.mark.parametrize(
    ("name", "words", "says"),
    [
        ("press", {}, "press: depth is missing"),
        ("press", {"depht": 1e-3}, "press: no argument 'depht'; did you mean 'depth'?"),
        ("press", {"depth": "1mm"}, "press: depth must be"),
        ("press", {"depth": float("nan")}, "press: depth must be"),
        ("press", {"depth": 1e-3, "taxel": 1.5}, "press: taxel must be a whole number"),
        ("press", {"depth": 1e-3, "taxel": -1}, "press: taxel must be"),
        ("press", {"depth": 1e-3, "wait": 1}, "press: wait must be true or false, got 1"),
        ("press", {"depth": 1e-3, "body": ["ball"]}, "press: body must be a text"),
        ("press", {"depth": 1e-3, "body": "\x1b[2J"}, "press: body must be a text"),
        ("move", {"position": [1, 2]}, "move: position must be 3 numbers"),
        ("move", {"position": [0, 0, 1e9]}, "move: position must be within 100 of 0"),
        ("set", {"options": [1]}, "set: options must be a table"),
        ("set", {"options": {"noise": float("inf")}}, "set: options must be a table"),
        ("dead", {"taxels": "all"}, "dead: taxels must be numbers"),
        ("dead", {"taxels": [0.5]}, "dead: taxels must be numbers of taxels"),
        ("dead", {"taxels": list(range(2)) * 10**6}, "dead: taxels must be"),
    ],
)
def test_what_does_not_fit_is_refused_in_words(name, words, says):
    with pytest.raises(SceneError) as refused:
        CONTROL_COMMANDS[name].checked(words)
    assert str(refused.value).startswith(says)


def test_numbers_have_units():
    assert scaled("1.5mm", LENGTHS_M) == pytest.approx(1.5e-3)
    assert scaled("-2e1us", TIMES_S) == pytest.approx(-2e-5)
    assert scaled("1", TIMES_S) is scaled("1mm", TIMES_S) is scaled("mm", LENGTHS_M) is None
    assert CONTROL_COMMANDS["dead"].arguments["taxels"].type.read("3:7,9") == [3, 4, 5, 6, 9]
    for text, seconds in (("5m", 300.0), ("5min", 300.0), ("1.5h", 5400.0), ("16ms", 0.016)):
        assert CONTROL_COMMANDS["unplug"].arguments["seconds"].type.read(text) == pytest.approx(seconds)
        assert quantity("--seconds", text, "Seconds") == pytest.approx(seconds)
        assert parse_fault(f"drop 5% for {text}").stop_ns == round(seconds * 1e9)
    read = CONTROL_COMMANDS["set"].arguments["options"].type.read
    assert read(["gain=0.9", "bias=[0, 1]", "noise=5%"]) == {"gain": 0.9, "bias": [0, 1], "noise": 0.05}  # type: ignore[arg-type]
    assert plain({"a": (1, 2)}) == {"a": [1, 2]}


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("press", ("dwell", "`release`")),
        ("unplug", ("seconds", "`mend`")),
        ("set", ("seconds", "the run ends")),
        ("dead", ("seconds", "the run ends")),
        ("fault", ("", "`mend`")),
        ("pose", ("", "it is moved again")),
        ("reset", ("", "")),
    ],
)
def test_a_docstring_says_until_when_a_change_lasts(name, end):
    verb = CONTROL_COMMANDS[name]
    assert verb.end == end
    assert end[1] in (inspect.getdoc(getattr(tt.Connection, verb.method)) or "")
