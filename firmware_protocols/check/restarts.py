"""The check of state: a restart resets all of it but the flash, and none of it is on the class or in the module."""

from __future__ import annotations

import copy
import sys
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from firmware_protocols import state as plain
from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check.examples import examples_with
from firmware_protocols.check.host import Host, Subject, exercise
from firmware_protocols.check.malformed import malformed_requests
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.frames import frame_of, text_of
from firmware_protocols.layouts import Layout

SURVIVING_FIELDS = ("counters", "flash", "options")
"""The attributes that a restart keeps."""


@dataclass
class Baseline:
    """The state of a device, its class and its module before any use."""

    subject: Subject
    state: dict[str, Any] = field(init=False)
    periods: dict[str, int] = field(init=False)

    def __post_init__(self):
        self.shared = shared_values(self.subject.cls)
        device = self.subject.build()
        self.layout, self.periods, self.why = device.layout, dict(device.periods), ""
        try:
            self.state = _state(device)
        except plain.NotPlain as error:
            self.state, self.why = {}, str(error)


def faults(baseline: Baseline) -> Iterator[Fault]:
    """Yield state and rates that differ after a restart, and frames that differ the second time."""
    subject = baseline.subject
    file, line = source_line(subject.cls, "__init__")
    try:
        texts = [*_check_each_request(baseline), *_check_repetition(subject)]
        texts += [baseline.why] if baseline.why else [*_check_state(baseline)]
    except AuthorError as error:
        yield Fault.of("restart", error)
        return
    yield from (Fault("restart", text, file, line) for text in texts)


def _check_repetition(subject: Subject) -> Iterator[str]:
    first, second = ([text_of(frame) for frame in exercise(Host(subject.build()), subject, 1)] for _ in range(2))
    if first != second:
        at = next((k for k, (a, b) in enumerate(zip(first, second)) if a != b), min(len(first), len(second)))
        yield (
            f"the same inputs give other bytes the second time, from frame {at} on: use no random numbers, clocks or "
            "state outside of self"
        )


def _check_each_request(baseline: Baseline) -> Iterator[str]:
    """Yield a changed rate, or a value left in the class, after a request, also with other data, and a restart."""
    subject = baseline.subject
    for name, requests, port in _requests(subject):
        host = Host(subject.make(), 1.0)
        try:
            for request in requests:
                host.send(request, port)
                host.wait()
            host.convert()
        except AuthorError:
            continue  # the check of requests reports it
        host.device.flash.clear()
        host.restart()
        for stream, period in baseline.periods.items():
            if (now := host.device.periods.get(stream, 0)) != period:
                yield (
                    f"stream {stream!r} converts every {period / 1e6:g} ms when new, and every {now / 1e6:g} ms after "
                    f"{name} and a restart: the rate must not survive"
                )
                return
        if change := next(_shared_changes(subject.cls, baseline.shared), ""):
            yield f"after {name} and a restart {change}"
            return


def _requests(subject: Subject) -> Iterator[tuple[str, list[Any], str]]:
    """Yield names, requests and ports: of commands, of commands with other data, and of examples."""
    for command in subject.commands:
        frames = [frame_of(each) for each in (*command.after, command.frame)]
        yield repr(command.name), frames, command.port
        yield (
            f"{command.name!r} with other data",
            [each for n, each in malformed_requests(subject.cls, frames[-1]) if n],
            command.port,
        )
    for example in examples_with(subject):
        if example.after:
            yield repr(example.name), [frame_of(text) for text in example.after], example.port


def _check_state(baseline: Baseline) -> Iterator[str]:
    subject = baseline.subject
    used = Host(subject.build())
    exercise(used, subject, 2)
    for command in subject.commands:
        if isinstance(command.frame, bytes):
            used.send(command.frame[: len(command.frame) // 2], command.port)
    flash = dict(used.device.flash)
    used.device.flash.clear()
    used.device.power_cycle()
    yield from _differences(baseline.state, _state(used.device), "self")
    yield from _layouts(baseline.layout, used.device.layout)
    used.device.flash.update(flash)
    used.restart()


def _state(device: Device) -> dict[str, Any]:
    """Return the state without the attributes that survive a restart, and without cached properties."""
    computed = {
        name for cls in type(device).__mro__ for name, each in vars(cls).items() if isinstance(each, cached_property)
    }
    return {name: each for name, each in plain.snapshot(device).items() if name not in {*SURVIVING_FIELDS, *computed}}


def _layouts(fresh: Layout, used: Layout) -> Iterator[str]:
    for name in ("positions", "normals", "x_axes", "wire_order"):
        if not np.array_equal(getattr(fresh, name), getattr(used, name)):
            yield f"layout.{name} differs after a restart: make the layout from the options alone"


def _differences(fresh: Any, used: Any, where: str) -> Iterator[str]:
    """Yield the places at which two trees of plain data differ."""
    if isinstance(fresh, dict) and isinstance(used, dict) and "~" in fresh and fresh.get("~") == used.get("~"):
        yield from _in_tagged(fresh, used, where)
    elif isinstance(fresh, dict) and isinstance(used, dict):
        for key in [*fresh, *(key for key in used if key not in fresh)]:
            if key not in fresh or key not in used:
                when = "when new" if key in fresh else "after a restart"
                yield f"{where}.{key} exists only {when}: set it in __init__"
            else:
                yield from _differences(fresh[key], used[key], f"{where}.{key}")
    elif not _same(fresh, used):
        yield f"{where} is {_short(fresh)} when new, {_short(used)} after a restart: set it in __init__"


def _in_tagged(fresh: dict[str, Any], used: dict[str, Any], where: str) -> Iterator[str]:
    kind = fresh["~"]
    if kind == "object":
        yield from _differences(fresh["state"], used["state"], where)
    elif kind in ("dict", "Counter", "defaultdict"):
        mine, theirs = ({_short(key): value for key, value in each["items"]} for each in (fresh, used))
        yield from _differences(mine, theirs, where)
    elif "items" in fresh and len(fresh["items"]) == len(used["items"]):
        for k, (mine, theirs) in enumerate(zip(fresh["items"], used["items"])):
            yield from _differences(mine, theirs, f"{where}[{k}]")
    elif kind != "same" and not _same(fresh.get("value", fresh.get("items")), used.get("value", used.get("items"))):
        was, now = (_short(each.get("value", each.get("items"))) for each in (fresh, used))
        yield f"{where} is {was} when new, {now} after a restart: set it in __init__"


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return type(a) is type(b) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return type(a) is type(b) and (a == b or a != a)


def _short(value: Any) -> str:
    text = repr(value.tolist()[:4] if isinstance(value, np.ndarray) and value.ndim else value)
    return text if len(text) <= 60 else text[:59] + "…"


# -- values that all devices of a class share --------------------------------------------------------------------------


def shared_values(cls: type[Device]) -> dict[str, Any]:
    """Return copies of the values in the device's classes and modules, where no state of a firmware belongs."""
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    found = {f"{each.__name__}.{name}": _copied(value) for each in own for name, value in vars(each).items()}
    for module in {each.__module__ for each in own}:
        values = vars(sys.modules[module])
        found |= {f"{module.rpartition('.')[2]}.{name}": _copied(value) for name, value in values.items()}
    return {
        name: value for name, value in found.items() if value is not ... and ".__" not in name and "._abc" not in name
    }


_IMMUTABLE = {bool, int, float, str, bytes, type(None)}


def _copied(value: Any) -> Any:
    """Return a copy of a value; ``...`` for functions, classes and other objects."""
    if type(value) in _IMMUTABLE:
        return value
    if isinstance(value, bool | int | float | str | bytes | bytearray | np.ndarray):
        return copy.copy(value)
    if isinstance(value, list | tuple | set | frozenset | deque):
        return [_copied(each) for each in value]
    if isinstance(value, Mapping):
        return {_short(key): _copied(each) for key, each in value.items()}
    return ...


def _shared_changes(cls: type[Device], before: dict[str, Any]) -> Iterator[str]:
    """Yield the values of class and module that differ from those ``before``."""
    now = shared_values(cls)
    for name in [*before, *(name for name in now if name not in before)]:
        if not _alike(was := before.get(name, "nothing"), value := now.get(name, "nothing")):
            yield f"{name} is {_short(value)}, {_short(was)} when new: all devices share it, keep state in self"


def _alike(a: Any, b: Any) -> bool:
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_alike, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_alike(a[key], b[key]) for key in a)
    return _same(a, b) or (a is ... and b is ...)
