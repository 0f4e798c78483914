"""The schedules of events, with which the test of a driver's recovery can be repeated.

An event (:class:`tactemu.Event`) is an entry ``[[scenario]]`` of a scene file, or made in Python::

    with tactemu.serve("anyskin", scenario=[Event(at=2, dead=(4,)), Event(at=3, fault="unplug for 0.5s")]) as dev: ...

The wire applies faults of bytes at their times; the loop applies events of values and time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from firmware_protocols import Device
from tactemu.base.errors import SceneError, nearest
from tactemu.base.loop import Action
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.imperfections.options import Law
from tactemu.scene.events import EventTable, timed_fault
from tactemu.wire.faults import Fault


def applies_to(event: EventTable, skin: str) -> bool:
    """Return True if an event applies to this skin."""
    return event.skin in (None, skin)


def check_scenario(events: Iterable[EventTable], devices: Mapping[str, Device], source: str = "") -> None:
    """Raise if an event changes an option or a taxel that its devices do not have.

    Args:
        events: the events, as in the scene file ``source`` or in its place in Python.
        devices: the devices, by the skin's name.
        source: the file, with which the message begins.

    Raises:
        SceneError: names the event by its number.
    """
    start = f"{source}: " if source else ""
    for k, event in enumerate(events):
        for option in event.set:
            _check_changeable(f"{start}scenario[{k}]: set", option)
        for skin, device in devices.items():
            if applies_to(event, skin):
                _check_taxels(f"{start}scenario[{k}]: ", event, skin, device)


def laws_needed(events: Iterable[EventTable], skin: str) -> tuple[str, ...]:
    """Return the laws that a skin's sensor must be built with, so that these events can switch them on."""
    needed = set()
    for event in events:
        if applies_to(event, skin):
            needed |= {*event.set, *(["dead"] if event.dead else [])}
    return tuple(sorted(needed))


def _check_changeable(where: str, option: str) -> None:
    options = [law for law in get_args(Law) if law != "dead"]
    if option not in options:
        raise SceneError(f"{where}: {option!r} cannot change{nearest(option, options)} (can: {', '.join(options)})")


def _check_taxels(where: str, event: EventTable, skin: str, device: Device) -> None:
    """Raise if a device does not have the taxels of an event."""
    last = len(device.layout) - 1
    for name, taxels in (("dead", event.dead), ("taxels", event.taxels or ())):
        if taxels and not 0 <= min(taxels) <= max(taxels) <= last:
            raise SceneError(f"{where}{name}: expected taxels 0..{last} of {skin!r}, got {list(taxels)}")


def faults_of(events: Iterable[EventTable], skins: Sequence[str]) -> list[Fault]:
    """Return the faults of the events for a wire with these skins, each with its time."""
    concerned = (event for event in events if any(applies_to(event, skin) for skin in skins))
    return [timed_fault(event) for event in concerned if event.fault]


def schedule(emulator: Emulator, events: Iterable[EventTable], *, now_s: float = 0.0) -> None:
    """Schedule the events in the loop, except faults of bytes; their times count from ``now_s`` [s].

    Raises:
        SceneError: an event does not fit this scene.
    """
    pairs = [(c, event) for event in events for c in emulator.channels if applies_to(event, c.name)]
    for channel, event in pairs:
        _check(channel, event)
    for channel, event in pairs:
        _plan(emulator, channel, event, round(now_s * 1e9))


def apply_event(emulator: Emulator, event: EventTable, now_s: float) -> None:
    """Schedule an event in a running loop, including its fault of bytes; its times count from ``now_s`` [s].

    Raises:
        SceneError: the event does not fit this scene.
    """
    schedule(emulator, [event], now_s=now_s)
    for wire in emulator.wires if event.fault else ():
        if any(applies_to(event, c.name) for c in emulator.channels if wire in c.wires.values()):
            wire.add_fault(timed_fault(event, now_s))


def _check(channel: Channel, event: EventTable) -> None:
    """Raise if this device cannot have the event."""
    _check_taxels("", event, channel.name, channel.device)
    if event.dead:
        channel.imperfections.set_dead([], True, event.value)
    for option, value in event.set.items():
        channel.imperfections.set(option, value, (), event.taxels)  # in no environment: it only checks


def _plan(emulator: Emulator, channel: Channel, event: EventTable, origin_ns: int) -> None:
    start = origin_ns + round(event.at * 1e9)
    stop = None if event.until is None else origin_ns + round(event.until * 1e9)

    def plan(t_ns: int | None, name: str, *args: Any) -> None:
        if t_ns is not None:
            emulator.at(t_ns, Action(name, channel.name, args))

    if event.dead:
        plan(start, "kill", event.dead, event.value)
        plan(stop, "revive", event.dead)
    for option, value in event.set.items():
        plan(start, "set", option, value, event.taxels)
        plan(stop, "set", option, _built(channel, option, event.taxels), event.taxels)
    if event.hang:
        plan(start, "hang", stop)
    if event.reset:
        plan(start, "reset")


def _built(channel: Channel, option: str, taxels: Sequence[int] | None) -> Any:
    """Return the value that an option was built with; for some taxels only their values, if it has one per taxel."""
    value = getattr(channel.imperfections.options, option)
    each = taxels is not None and np.ndim(value) and len(value) == len(channel.device.layout)
    return np.asarray(value)[list(taxels or ())].tolist() if each else value
