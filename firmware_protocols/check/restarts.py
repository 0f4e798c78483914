"""State: a restart forgets all of it but the flash, and it is plain data that another process can go on from."""

from __future__ import annotations

import copy
import json
import os
import subprocess
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
from firmware_protocols.check.host import STEP, Host, Subject, story
from firmware_protocols.check.nonsense import reframed
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.frames import frame_of, text_of
from firmware_protocols.layouts import Layout

SURVIVE = ("counters", "flash", "options")
PATIENCE_S = 30


@dataclass
class Baseline:
    """What a device is before anything has been used."""

    subject: Subject
    state: dict[str, Any] = field(init=False)
    periods: dict[str, int] = field(init=False)

    def __post_init__(self):
        self.shared = shared(self.subject.cls)
        device = self.subject.build()
        self.layout, self.periods, self.why = device.layout, dict(device.periods), ""
        try:
            self.state = _state(device)
        except plain.NotPlain as error:
            self.state, self.why = {}, str(error)


def faults(baseline: Baseline) -> Iterator[Fault]:
    """What is other after a restart, or other the second time."""
    subject = baseline.subject
    file, line = source_line(subject.cls, "__init__")
    try:
        texts = [*_after_each(baseline), *_again(subject)]
        texts += [baseline.why] if baseline.why else [*_restarted(baseline)]
    except AuthorError as error:
        yield Fault.of("restart", error)
        return
    yield from (Fault("restart", text, file, line) for text in texts)


def _again(subject: Subject) -> Iterator[str]:
    first, second = ([text_of(frame) for frame in story(Host(subject.build()), subject, 1)] for _ in range(2))
    if first != second:
        at = next((k for k, (a, b) in enumerate(zip(first, second)) if a != b), min(len(first), len(second)))
        yield f"the same inputs give other bytes the second time, from frame {at} on: it draws, asks the time, or keeps"


def _after_each(baseline: Baseline) -> Iterator[str]:
    """Each request, also with other data, then a restart: rates are as when new, and nothing is left in the class."""
    subject = baseline.subject
    for name, requests, port in _requests(subject):
        host = Host(subject.make(), 1.0)
        try:
            for request in requests:
                host.send(request, port)
                host.wait()
            host.convert()
        except AuthorError:
            continue  # the other parts say so
        host.device.flash.clear()
        host.restart()
        for stream, period in baseline.periods.items():
            if (now := host.device.periods.get(stream, 0)) != period:
                yield (
                    f"stream {stream!r} converts every {period / 1e6:g} ms when new, and every {now / 1e6:g} ms after "
                    f"{name} and a restart: the rate must not survive"
                )
                return
        if left := next(_left(subject.cls, baseline.shared), ""):
            yield f"after {name} and a restart {left}"
            return


def _requests(subject: Subject) -> Iterator[tuple[str, list[Any], str]]:
    """Names, requests and ports: commands, commands with other data, what goes before the examples."""
    for command in subject.commands:
        whole = [frame_of(each) for each in (*command.after, command.request)]
        yield repr(command.name), whole, command.port
        yield (
            f"{command.name!r} with other data",
            [each for n, each in reframed(subject.cls, whole[-1]) if n],
            command.port,
        )
    for example in examples_with(subject):
        if example.after:
            yield repr(example.name), [frame_of(text) for text in example.after], example.port


def _restarted(baseline: Baseline) -> Iterator[str]:
    subject = baseline.subject
    used = Host(subject.build())
    story(used, subject, 2)
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
    """Return all but what survives, and what is computed when it is asked for."""
    computed = {
        name for cls in type(device).__mro__ for name, each in vars(cls).items() if isinstance(each, cached_property)
    }
    return {name: each for name, each in plain.snapshot(device).items() if name not in {*SURVIVE, *computed}}


def _layouts(fresh: Layout, used: Layout) -> Iterator[str]:
    for name in ("positions", "normals", "x_axes", "wire_order"):
        if not np.array_equal(getattr(fresh, name), getattr(used, name)):
            yield f"layout.{name} is another after a restart: make the layout from the options alone"


def _differences(fresh: Any, used: Any, where: str) -> Iterator[str]:
    """Between two trees of plain data; where they begin to differ."""
    if isinstance(fresh, dict) and isinstance(used, dict) and "~" in fresh and fresh.get("~") == used.get("~"):
        yield from _in_tagged(fresh, used, where)
    elif isinstance(fresh, dict) and isinstance(used, dict):
        for key in [*fresh, *(key for key in used if key not in fresh)]:
            if key not in fresh or key not in used:
                yield f"{where}.{key} is there only {'when new' if key in fresh else 'after a restart'}"
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


# -- what is shared by all devices of a class --------------------------------------------------------------------------


def shared(cls: type[Device]) -> dict[str, Any]:
    """What the device's classes and modules hold, to be compared later: a firmware's state does not belong there."""
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    found = {f"{each.__name__}.{name}": _kept(value) for each in own for name, value in vars(each).items()}
    for module in {each.__module__ for each in own}:
        values = vars(sys.modules[module])
        found |= {f"{module.rpartition('.')[2]}.{name}": _kept(value) for name, value in values.items()}
    return {
        name: value for name, value in found.items() if value is not ... and ".__" not in name and "._abc" not in name
    }


def _kept(value: Any) -> Any:
    """Return a copy of a value that can change or be replaced; ``...`` for code and the kit's own objects."""
    if isinstance(value, bool | int | float | str | bytes | bytearray | np.ndarray | type(None)):
        return copy.copy(value)
    if isinstance(value, list | tuple | set | frozenset | deque):
        return [_kept(each) for each in value]
    if isinstance(value, Mapping):
        return {_short(key): _kept(each) for key, each in value.items()}
    return ...


def _left(cls: type[Device], before: dict[str, Any]) -> Iterator[str]:
    """What devices have left in their class or module since."""
    now = shared(cls)
    for name in [*before, *(name for name in now if name not in before)]:
        if not _alike(was := before.get(name, "nothing"), kept := now.get(name, "nothing")):
            yield f"{name} is {_short(kept)}, {_short(was)} when new: all devices share it; keep state in self"


def _alike(a: Any, b: Any) -> bool:
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_alike, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_alike(a[key], b[key]) for key in a)
    return _same(a, b) or (a is ... and b is ...)


# -- another process ---------------------------------------------------------------------------------------------------


class Elsewhere:
    """A device saved in the middle of a story, told to its end in a fresh process as well as here."""

    def __init__(self, subject: Subject):
        self.subject = subject
        self.host = Host(subject.make())
        story(self.host, subject, 3, rounds=1)
        for request, port in subject.asked()[:1]:
            if isinstance(request, bytes):
                self.host.send(request[: len(request) // 2], port)
        saved = plain.to_bytes(self.host.device.snapshot())
        header = {"target": subject.target, "options": dict(subject.options), "t_ns": self.host.t_ns}
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "firmware_protocols.check.elsewhere"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": paths},
        )  # fmt: skip
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(header).encode() + b"\n" + saved)
        self.process.stdin.close()
        self.process.stdin = None

    def faults(self) -> Iterator[Fault]:
        """Whether both ends are the same."""
        file, line = source_line(self.subject.cls, "__init__")
        here = continued(self.host, self.subject)
        out, err = self.process.communicate(timeout=PATIENCE_S)
        if self.process.returncode:
            last = err.decode(errors="replace").strip().splitlines()[-1:]
            yield Fault("restart", f"a snapshot cannot be restored in another process: {' '.join(last)}", file, line)
        elif here != (there := json.loads(out)):
            at = next((k for k, (a, b) in enumerate(zip(here, there)) if a != b), min(len(here), len(there)))
            text = f"restored from a snapshot in another process it sends other bytes, from frame {at} on"
            yield Fault("restart", text, file, line)


def continued(host: Host, subject: Subject) -> list[str]:
    """The end of the story, as text."""
    host.wait(STEP)
    return [text_of(frame) for frame in story(host, subject, 4, rounds=1)]


def saved_elsewhere(subject: Subject) -> tuple[Elsewhere | None, list[Fault]]:
    """Return the story in another process, under way; or why it cannot begin."""
    try:
        return Elsewhere(subject), []
    except AuthorError as error:
        return None, [Fault.of("restart", error)]
    except plain.NotPlain as error:
        return None, [Fault("restart", str(error), *source_line(subject.cls, "__init__"))]
