"""The bytes of a model's frames that an option of the device changes: a real sensor may have another setting there."""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from firmware_protocols import Command, Device
from firmware_protocols.frames import payload
from firmware_protocols.options import Declared, declared
from tactemu.judge.compare.asking import ask, form_of, records_of
from tactemu.judge.compare.bench import Bench, Readings
from tactemu.judge.compare.frame_classes import FrameClass, identity_of

MAX_OPTION_VALUES = 2
"""Number of other values that are tried of each option."""
MAX_TRIED_OPTIONS = 24
"""Number of devices with another option that are tried."""
MAX_OPTION_REQUESTS = 600
"""Number of requests to all of them together; with many commands fewer options are tried."""
LISTENING_S = 0.3
"""Time for unasked frames of a device with another option [s]."""
BOOTING_S = 0.03
"""Time for a device that sends none [s]."""


def find_settings(
    make: Callable[..., Device],
    port: str,
    unasked: Sequence[FrameClass],
    answers: Mapping[str, FrameClass | None],
    commands: Sequence[Command],
    progress: Callable[[str], object],
) -> None:
    """Mark the constants that another option of the device changes.

    Args:
        make: makes a device, with options.
        port: the name of the port.
        unasked: the classes of unasked frames.
        answers: the classes of the answers, by name of the command.
        commands: the commands that are asked.
        progress: is called with what is being done.
    """
    tried = 0
    for option in declared(type(make())).values():
        for value in _other_values(option):
            if tried >= min(MAX_TRIED_OPTIONS, MAX_OPTION_REQUESTS // max(1, len(commands))):
                return
            tried += 1
            progress(f"the model with another {option.name}")
            try:
                _mark_settings(make(**{option.name: value}), port, unasked, answers, commands, option)
            except Exception:  # a combination of options that this device refuses
                continue


def _mark_settings(
    device: Device,
    port: str,
    unasked: Sequence[FrameClass],
    answers: Mapping[str, FrameClass | None],
    commands: Sequence[Command],
    option: Declared,
) -> None:
    connector = next(each for each in device.ports if each.name == port)
    with Bench(device, connector, Readings()) as bench:
        bench.run(device.boot_s + (LISTENING_S if unasked else BOOTING_S))
        heard = records_of(bench, 0, 0)
        for record in heard[:200]:
            for each in unasked:
                if each.identity == identity_of(record.frame) and each.envelope == "plain":
                    _mark(each, payload(record.frame), option.name)
        for command in commands:
            made = answers[command.name]
            if made is not None and made.envelope == "plain":
                for record, _, _ in ask(bench, command, 0, set(map(form_of, heard)))[:1]:
                    _mark(made, payload(record.frame), option.name)
                    if isinstance(option.default, str) and len(payload(record.frame)) != made.size:
                        made.length_setting = option.name


def _mark(made: FrameClass, content: bytes, option: str) -> None:
    if made.size is None or len(content) != made.size:
        return
    differ = [at for at, value in made.const.items() if content[at] != value]
    if len(differ) <= max(4, len(made.const) // 2):
        for at in differ:
            made.settings.setdefault(at, option)


def _other_values(option: Declared) -> list[Any]:
    """Return other values of an option, as far as its type gives them."""
    kind = typing.get_args(option.annotation)[0] if typing.get_args(option.annotation) else option.annotation
    if typing.get_origin(kind) is typing.Literal:
        return [each for each in typing.get_args(kind) if each != option.default][:MAX_OPTION_VALUES]
    match option.default:
        case bool():
            return [not option.default]
        case int():
            low, high = option.option.low, option.option.high
            near = (option.default + 1, option.default - 1, (option.default ^ 0x5A5A5A5A) & 0x7FFFFFFF)
            fits = [v for v in near if (low is None or v >= low) and (high is None or v <= high)]
            return fits[:MAX_OPTION_VALUES]
        case str():
            return ["Zq" + option.default[2:], f"{option.default}9"] if option.default else []
    return []
