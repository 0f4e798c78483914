"""``tactemu poke``: commands to a running emulator. The sub-commands come from the table of control commands."""

from __future__ import annotations

import inspect
import json as json_module
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Annotated, Any, NoReturn

import typer

from tactemu.base.errors import SceneError, TactemuError
from tactemu.cli.parameters import quantity_of
from tactemu.cli.sections import in_sections
from tactemu.control.argument_types import ArgumentType
from tactemu.control.client import connect
from tactemu.control.command_registry import EVENT_ARGUMENT, Argument, ControlCommand
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.control.endpoints import running
from tactemu.wire.faults import parse

HELP = """
Press, move, break or read a running emulator.

\b
  tactemu poke                                    list emulators, commands
  tactemu poke press --depth 1mm --dwell 2s
  tactemu poke press thumb --depth 1mm --taxel 7  one of several skins
  tactemu poke fault 'drop 5% for 1s'
  tactemu poke unplug --for 500ms
  tactemu poke set noise=0.01 --taxels 1:4        of `run --adjustable noise`
  tactemu poke pose ball 0 0 25mm
  tactemu poke sample --json
  tactemu poke step 10                            of `run --clock lockstep`

Numbers may have a unit: 1mm, 2s, 50mm/s; without one they are SI. If several emulators run, choose one with --name.
Exit code 2 if the command cannot be done, or no emulator or several run.
"""
NAME = typer.Option("--name", metavar="NAME", help="Name of the emulator; default: the only one that runs.")
JSON = typer.Option("--json", help="Print the answer as JSON.")
WORDS = {"seconds": "for"}
"""The names of arguments that differ on the command line."""
EXAMPLES = {
    "body": "ball", "depth": "1mm", "fault": "'drop 5% for 1s'", "file": "state.npz", "options": "noise=0.01",
    "seconds": "500ms", "taxels": "3,4",
}  # fmt: skip
"""A value for each argument that a command needs, in messages; a switch needs none."""


def main(words: Sequence[str]) -> None:
    """Run the sub-command in ``words``.

    Raises:
        TactemuError: the command cannot be done.
    """
    make_app()(list(words), prog_name="tactemu poke")


def make_app() -> typer.Typer:
    """Return the command line of ``tactemu poke``, with a sub-command for each control command."""
    app = typer.Typer(
        help=HELP, rich_markup_mode=None, pretty_exceptions_enable=False, add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]}, invoke_without_command=True,
    )  # fmt: skip
    app.callback()(_list)
    for verb in CONTROL_COMMANDS.values():
        negative = any(argument.type.words > 1 for argument in verb.arguments.values())  # -1mm is no option
        settings = {"ignore_unknown_options": negative}
        app.command(
            verb.name, help=_help(verb), short_help=verb.brief, context_settings=settings,
            cls=in_sections({"Options": " ".join(verb.arguments)}),
        )(_command(verb))  # fmt: skip
    app.command("watch", help="Print states as lines of JSON until Ctrl-C.\n\n\b\n  tactemu poke watch --rate 30")(
        _watch
    )
    return app


def _list(
    context: typer.Context, name: Annotated[str | None, NAME] = None, json: Annotated[bool, JSON] = False
) -> None:
    """List the running emulators and the commands."""
    context.obj = name, json
    if context.invoked_subcommand is not None:
        return
    there = running()
    if json:
        print(json_module.dumps([vars(owner) for owner in there]))
        return
    for owner in there:
        print(f"{owner.name:<14} {owner.target}  (process {owner.pid})")
    print("" if there else "no emulator runs; start one: tactemu run anyskin\n")
    for verb in CONTROL_COMMANDS.values():
        print(f"  {verb.name:<10} {verb.brief}")
    print(f"  {'watch':<10} Print states as lines of JSON until Ctrl-C.\n\ntactemu poke VERB --help")


def _help(verb: ControlCommand) -> str:
    """Return the help of a command: its sentence and an example."""
    words = [_placeholder(argument) for argument in _arguments(verb) if argument.name in verb.words]
    needed = [each for each in verb.arguments.values() if each.needed and each.name not in verb.words]
    words += [f"--{_word(argument.name)} {argument.type.word}" for argument in needed]
    return f"{verb.about}\n\n\b\n  tactemu poke {' '.join([verb.name, *words])}"


def _require(verb: ControlCommand, given: dict[str, Any]) -> None:
    """Raise with an example if an argument is missing that the command needs."""
    needed = [each for each in verb.arguments.values() if each.needed]
    named = {each.name: "" if each.name in verb.words else f"--{_word(each.name)} " for each in needed}
    words = " ".join(f"{named[each.name]}{EXAMPLES.get(each.name, '')}".strip() for each in needed)
    for each in needed:
        if given.get(each.name) is None:
            what = named[each.name].strip() or _placeholder(each)
            raise SceneError(f"{verb.name}: {what} is missing: {each.about}; example: tactemu poke {verb.name} {words}")


def _placeholder(argument: Argument) -> str:
    """Return the placeholder of an argument without a name on the command line."""
    return argument.type.word if argument.type.words != 1 else argument.name.upper()


def _word(name: str) -> str:
    return WORDS.get(name, name).replace("_", "-")


def _arguments(verb: ControlCommand) -> list[Argument]:
    return [EVENT_ARGUMENT] if verb.name == "happen" else list(verb.arguments.values())


def _command(verb: ControlCommand) -> Any:
    """Return a function with the signature that the command line needs; every argument is text, read by its type."""
    parameters = [_parameter(verb, argument) for argument in _arguments(verb)]
    parameters += [
        inspect.Parameter("name", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[str | None, NAME]),
        inspect.Parameter("json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Annotated[bool, JSON]),
    ]
    parameters.sort(key=lambda parameter: _place(verb, parameter.name))
    parameters.append(inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))

    def run(context: typer.Context, **given: Any) -> None:
        name, json = context.obj  # options before the command's name
        _run(verb, **given | {"name": given["name"] or name, "json": given["json"] or json})

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _place(verb: ControlCommand, name: str) -> int:
    """Return the place of an argument on a command line: those that stand there without their names come first."""
    return verb.words.index(name) if name in verb.words else len(verb.words)


def _shown(default: float | str) -> str:
    return default if isinstance(default, str) else f"{default:g}"


def _parameter(verb: ControlCommand, argument: Argument) -> inspect.Parameter:
    kind = argument.type
    default = "" if argument.default is None or argument.name == "wait" else f" [default: {_shown(argument.default)}]"
    about = f"{argument.about}{default}"
    many = kind.words != 1
    hint: Any = list[str] | None if many else str | None
    word = f"--{_word(argument.name)}"
    if argument.name in verb.words:
        info = typer.Argument(metavar=_placeholder(argument), help=about, show_default=False)
    elif kind.json == "true or false":
        hint = bool | None
        info = typer.Option(f"{word}/--no-{word[2:]}", help=about, show_default=False)
    else:
        if many:
            hint = tuple[tuple(str for _ in range(kind.words))] | None  # type: ignore[misc]
        info = typer.Option(word, metavar=kind.word, help=about)
    kwargs: dict[str, Any] = {"default": None, "annotation": Annotated[hint, info]}
    return inspect.Parameter(argument.name, inspect.Parameter.KEYWORD_ONLY, **kwargs)


def _read(kind: ArgumentType, text: Any) -> Any:
    """Return a typed text as its argument's type reads it, or None if nothing was typed."""
    if isinstance(text, bool) or not text:
        return text if text is not None and text != [] else None
    return kind.read(text if isinstance(text, str) else list(text))  # type: ignore[arg-type]


def _run(verb: ControlCommand, *, name: str | None, json: bool, **given: Any) -> None:
    """Read the arguments, send the command, and print its result."""
    arguments = {each.name: _read(each.type, given[each.name]) for each in _arguments(verb)}
    if verb.name == "happen":
        event = arguments["event"]
        arguments = event if isinstance(event, dict) else _refuse(f"happen: expected KEY=VALUE ..., got {event!r}")
    else:
        _require(verb, arguments)
    checked = verb.checked(arguments)
    with connect(name) as emulator:
        result = emulator._do(verb.name, checked)
    if json:
        print(json_module.dumps({"ok": True, "result": result}))
    elif result is not None:
        _print(verb.name, result)
    elif verb.name != "wait":
        print(_summary(verb, checked))


def _summary(verb: ControlCommand, given: dict[str, Any]) -> str:
    """Return what a command has changed, and until when: ``dead 3,4: every skin, until the run ends``."""
    duration, end = verb.end
    is_limited = duration in given or (verb.name == "fault" and parse(given["fault"]).stop_ns is not None)
    until = "" if is_limited or not end else f"until {end.replace('`', '`tactemu poke ', 1)}"
    after = ", ".join(filter(None, (*_targets(verb, given), until)))
    return " ".join(_words(verb, given)) + (f": {after}" if after else "")


def _targets(verb: ControlCommand, given: dict[str, Any]) -> Iterator[str]:
    """Yield the skin that a command is for, or that it is for every skin or every body."""
    for name in ("skin", "body"):
        if name == "skin" and name in given and name in verb.arguments:
            yield given[name]
        elif name in verb.arguments and name not in given and verb.arguments[name].about.endswith("default: all"):
            yield f"every {name}"


def _words(verb: ControlCommand, given: dict[str, Any]) -> Iterator[str]:
    """Yield the words of a command that is carried out: the arguments that differ from their defaults."""
    yield verb.name
    for name, value in sorted(given.items(), key=lambda each: _place(verb, each[0])):
        argument = verb.arguments.get(name)
        if argument is None or isinstance(value, dict):  # keys of an event, options
            table = value if isinstance(value, dict) else {name: value}
            yield from (f"{key}={f'{each:g}' if isinstance(each, float) else each}" for key, each in table.items())
        elif name not in ("skin", "wait") and value != argument.default:
            text = ",".join(map(str, value)) if name == "taxels" else _numbers(value)
            unit = argument.type.json.partition("[")[2].rstrip("]")
            yield " ".join(filter(None, ("" if name in verb.words else _word(name), text, unit)))


def _refuse(text: str) -> NoReturn:
    raise TactemuError(text)


def _print(verb: str, result: Any) -> None:
    """Print a result as text."""
    if verb == "step":
        print(f"{result:.9g} s")
    elif verb == "sample":
        _print_sample(result)
    elif verb == "save":
        print(f"{result} bytes")
    elif "skins" not in result:  # the answer of a replayed recording
        print(json_module.dumps(result))
    elif verb == "stats":
        from tactemu.cli.reports import sentence

        for skin, entry in result["skins"].items():
            print(f"{skin}: {sentence(entry)}")
        print("clients: " + (", ".join(f"{what} {count}" for what, count in result["clients"].items()) or "none"))
    elif verb == "state":
        _print_state(result)


def _print_sample(sample: dict[str, Any]) -> None:
    when = f"{sample['t_ns'] / 1e9:.6f} s"
    print(f"{sample['device']}: sample {sample['number']} at {when}: taxel, ideal, measured, counts")
    rows = [sample[name] if isinstance(sample[name], list) else [sample[name]] for name in ("ideal", "measured")]
    counts = sample["counts"] if isinstance(sample["counts"], list) else [sample["counts"]]
    if len(counts) != len(rows[0]):  # not by taxels
        counts = [""] * len(rows[0])
    for k, values in enumerate(zip(*rows, counts)):
        print(f"  {k:>4}  " + "  ".join(map(_numbers, values)))


def _print_state(state: dict[str, Any]) -> None:
    print(f"{state['t_s']:.6f} s")
    for body, pose in state["bodies"].items():
        held = " in hand" if pose["in_hand"] else "" if pose["movable"] else " (not to be moved)"
        print(f"  body {body:<14} at {_numbers(pose['position'])} m, turned {_numbers(pose['quaternion'])}{held}")
    for skin, entry in state["skins"].items():
        ports = ", ".join(f"{port} {address}".strip() for port, address in entry["ports"].items())
        print(f"  skin {skin:<14} {entry['device']} on {ports}")


def _numbers(value: Any) -> str:
    if isinstance(value, list):
        return f"({', '.join(map(_numbers, value))})"
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:.6g}"


def _watch(
    context: typer.Context,
    rate: Annotated[
        float, typer.Option(metavar="HZ", parser=quantity_of("--rate", "Hertz"), help="States a second, at most.")
    ] = 10.0,
    name: Annotated[str | None, NAME] = None,
) -> None:
    """Print states as lines of JSON until Ctrl-C.

    \b
      tactemu poke watch --rate 30
    """
    with suppress(KeyboardInterrupt), connect(name or context.obj[0]) as emulator:
        for state in emulator.watch(rate):
            print(json_module.dumps(state), flush=True)
