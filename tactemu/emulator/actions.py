"""The actions on one device that events and commands schedule: hang, imperfections, dead taxels; each is logged."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from tactemu.base.loop import Action
from tactemu.emulator.channel import Channel
from tactemu.truth import Truth


class InjectionLog(Protocol):
    """The time and the log of a loop."""

    now_ns: int
    truth: Truth


def hang(log: InjectionLog, channel: Channel, until_ns: int) -> None:
    """Let the device neither sample nor receive until ``until_ns``."""
    channel.silent_until_ns = max(channel.silent_until_ns, until_ns)
    inject(log, channel, "hang", f"until {until_ns} ns")


def set_option(
    log: InjectionLog, channel: Channel, option: str, value: Any, taxels: Sequence[int] | None = None
) -> None:
    """Set an imperfection of all taxels, or of some."""
    channel.imperfections.set(option, value, None, taxels)
    of = "" if taxels is None else f" of {' '.join(map(str, taxels))}"
    inject(log, channel, "set", f"{option} = {value}{of}")


def kill(log: InjectionLog, channel: Channel, taxels: Sequence[int], value: float | None) -> None:
    """Make taxels dead: they return ``value``; ``None``: their last reading."""
    channel.imperfections.set_dead(list(taxels), True, value)
    inject(log, channel, "dead", " ".join(map(str, taxels)))


def revive(log: InjectionLog, channel: Channel, taxels: Sequence[int]) -> None:
    """Let dead taxels measure again."""
    channel.imperfections.set_dead(list(taxels), False)
    inject(log, channel, "revived", " ".join(map(str, taxels)))


def inject(log: InjectionLog, channel: Channel, what: str, detail: str = "") -> None:
    """Log an injected event of a device."""
    log.truth.inject(log.now_ns, channel.name, what, detail)


# -- actions of a saved state ------------------------------------------------------------------------------------------


def is_valid(action: Action, channels: Mapping[str, Channel], actions: Mapping[str, Callable[..., None]]) -> bool:
    """Return True if these devices can take an action of a saved state.

    Args:
        action: the action.
        channels: the devices, by name.
        actions: the functions, by the name of their actions.

    Raises:
        SceneError: the device has no such imperfection.
    """
    if action.name not in actions or not _accepts(actions[action.name], action.args):
        return False
    if (channel := channels.get(action.channel)) is None:
        return False
    every = range(len(channel.device.layout))
    match action.name, action.args:
        case "set", (option, value, *taxels):
            channel.imperfections.set(option, value, (), *taxels)  # in no environment: it only checks
        case "kill", (taxels, value):
            channel.imperfections.set_dead([], True, value)  # of no taxel: it only checks
            return all(taxel in every for taxel in taxels)
        case "revive", (taxels,):
            return all(taxel in every for taxel in taxels)
        case "convert", (stream, _):
            return stream in channel.timers
        case "send", (port, *_):
            return port in channel.wires
    return True


def _accepts(function: Callable[..., None], args: Sequence[Any]) -> bool:
    """Return True if a function of an action accepts these arguments after the loop and the channel."""
    from tactemu.emulator.saving.leaves import fits

    hints = typing.get_type_hints(function)
    names = list(inspect.signature(function).parameters)[2:]
    needed = len(names) - len(function.__defaults__ or ())
    return needed <= len(args) <= len(names) and all(fits(value, hints[name]) for name, value in zip(names, args))
