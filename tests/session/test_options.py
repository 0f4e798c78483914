"""Every option of a run is declared once, in RunOptions; those who take options are compared with it."""

import inspect
from dataclasses import fields

import pytest
from typer.main import get_command

import tactemu as tt
from tactemu.cli.app import app
from tactemu.emulator.options import AssemblyOptions
from tactemu.exec.pytest_plugin import ExecEnvironments
from tactemu.integrations.pytest_plugin import TactileDevice
from tactemu.session.options import CLOCKS, RUN_CLOCKS, SERVE_CLOCKS, RunOptions, ServeOptions

FIELDS = {field.name: field for field in fields(RunOptions)}
INTERNAL = {"fresh_ports", "usual_network", "env", "default_name"}
"""What no user asks for: the commands set them."""
OF_RUNS = {"seconds", "restore", "save", "save_at", "preempt"}
"""What makes no sense beside a test, which ends, saves and restores by methods of what `serve` returns."""
OF_SERVE = {"steer", "by_hand", "scenario", "source"}
"""What Python alone can give."""
WORDS = {
    # the word on the command line, where it differs
    "device_options": "options", "rate_hz": "rate", "faults": "fault", "keep": "truth_keep",
}  # fmt: skip
OF_THE_PICTURE = {"rerun", "rerun_to", "web", "web_port", "web_host", "json", "plain", "virtual"}
OF_THE_VIEW = {"node", "way", "expose", "quiet"}


def test_editors_see_the_options_of_a_run():
    expected = FIELDS.keys() - INTERNAL - OF_RUNS - {"port"}
    assert ServeOptions.__annotations__.keys() == expected
    for name, told in ServeOptions.__annotations__.items():
        assert told.__forward_arg__ == FIELDS[name].type, name


def test_help_shows_serve_with_every_option_its_type_and_its_default():
    shown = inspect.signature(tt.serve).parameters
    assert list(shown)[:2] == ["target", "port"] and shown.keys() == {"target", "port", *ServeOptions.__annotations__}
    for name, parameter in shown.items():
        if name != "target":
            assert (parameter.default, parameter.annotation) == (FIELDS[name].default, FIELDS[name].type), name
            positional = parameter.kind is parameter.POSITIONAL_OR_KEYWORD
            assert positional == (name == "port"), "the others are given by name"


def test_the_fixtures_take_what_serve_takes():
    for fixture in (TactileDevice, ExecEnvironments):
        assert inspect.signature(fixture.__call__).parameters["options"].annotation == "Unpack[ServeOptions]"


@pytest.mark.parametrize(
    ("command", "own", "without"),
    [
        ("run", OF_THE_PICTURE, OF_SERVE),
        ("exec", OF_THE_VIEW, OF_SERVE | OF_RUNS | {"adjustable", "again", "clock"}),
    ],
)
def test_a_command_has_a_word_for_every_option(command, own, without):
    options = {parameter.name: parameter for parameter in get_command(app).commands[command].params}  # type: ignore[attr-defined]
    expected = {WORDS.get(name, name): FIELDS[name] for name in FIELDS.keys() - INTERNAL - without}
    assert options.keys() == expected.keys() | own | {"target"}
    for word, field in expected.items():
        default = options[word].default
        assert default == field.default or (not default and not field.default), word


def test_every_clock_is_of_a_run_in_the_foreground_or_of_one_in_a_thread():
    assert {*RUN_CLOCKS, *SERVE_CLOCKS} == set(CLOCKS)
    for name in CLOCKS:
        RunOptions(clock=name)
    with pytest.raises(tt.SceneError, match="clock: expected one of real, virtual, lockstep, paced, got 'sun'"):
        RunOptions(clock="sun")


def test_every_option_is_described():
    source = inspect.getsource(RunOptions) + inspect.getsource(AssemblyOptions)
    for name in FIELDS:
        after = source[source.index(f"    {name}: ") :].split("\n", 2)[1]
        assert after.strip().startswith('"""'), name
