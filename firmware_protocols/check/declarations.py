"""The check that the declarations of a device are complete and free of contradictions."""

from __future__ import annotations

import inspect
import re
import sys
import typing
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols import registry
from firmware_protocols.adc import LowPass
from firmware_protocols.calls import source_line
from firmware_protocols.check.converter import measures_contact
from firmware_protocols.check.host import Subject
from firmware_protocols.check.report import Fault
from firmware_protocols.connectors import Can, Connector, port_error
from firmware_protocols.device import Device, DeviceKind, Evidence
from firmware_protocols.facts import Fact, Part
from firmware_protocols.frames import CanFrame, frame_of
from firmware_protocols.framing import Packets
from firmware_protocols.layouts import Layout, Patch
from firmware_protocols.motors import Motors
from firmware_protocols.registers import Registers
from firmware_protocols.senses import quantity_error
from firmware_protocols.stuffing import Lines

MIN_DISTANCE_PITCHES = 0.2
"""The smallest distance of two taxels of one link [pitches]; nearer ones are taken for two at one place."""
DOCSTRING_PARTS = ("wire", "try it")
"""The words that the docstring of a device's file must contain."""
MUTABLE = (bytearray, list, set, deque, np.ndarray, Packets, Lines, LowPass, Motors, Registers)


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield declarations that are missing or contradict each other."""
    device = subject.build()
    file, line = source_line(subject.cls)
    if wrong := list(_ports(device)):
        yield from (Fault("declarations", text, file, line) for text in wrong)
        return
    for text in (
        *_datasheet(subject, device), *_options(subject.cls), *_shared(subject.cls),
        *_senses(device), *_columns(device), *_commands(subject, device), *_layout(device),
    ):  # fmt: skip
        yield Fault("declarations", text, file, line)


def _datasheet(subject: Subject, device: Device) -> Iterator[str]:
    cls, name = subject.cls, getattr(subject.cls, "name", "")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        yield f"name {name!r}: expected lower case with underscores"
    elif subject.target != name and ".py:" not in subject.target:
        yield f"name {name!r}: it is registered as {subject.target!r}"
    elif ".py:" in subject.target and name in registry.DEVICES and not _is_registered(cls, name):
        yield f"name {name!r} is taken by {registry.DEVICES[name]}"
    for what in ("title", "judge"):
        if not str(getattr(device, what, "")).strip():
            yield f"{what} is empty"
    if device.kind not in typing.get_args(DeviceKind):
        yield f"kind {device.kind!r}: expected one of {typing.get_args(DeviceKind)}"
    for what in ("sources", "evidence"):
        found = getattr(device, what, None)
        if not isinstance(found, tuple) or not all(isinstance(each, str) and each.strip() for each in found):
            yield f"{what}: expected a tuple of sentences, got {found!r}"
        elif not found:
            yield f"{what} is empty"
    for fact in device.facts:
        if not isinstance(fact, Fact) or fact.part not in typing.get_args(Part) or not (fact.what and fact.where):
            yield f"facts: expected stated(part, what, where), measured(...) or assumed(...), got {fact!r}"
    known = typing.get_args(Evidence)
    for word in getattr(device, "evidence", None) or ():
        if word not in known:
            yield f"evidence {word!r}: expected {', '.join(known)}"
    docs = (sys.modules[cls.__module__].__doc__ or "").lower()
    for part in DOCSTRING_PARTS:
        if part not in docs:
            yield f"the docstring of {Path(inspect.getfile(cls)).name} lacks {part!r}: add the line"
    if "power_cycle(" in inspect.getsource(cls):
        yield "it calls power_cycle, which only the runner may call: return Restart()"


def _is_registered(cls: type[Device], name: str) -> bool:
    return inspect.getfile(registry.device_class(name)) == inspect.getfile(cls)


def _options(cls: type[Device]) -> Iterator[str]:
    hints = typing.get_type_hints(cls.__init__, include_extras=True)
    for name, option in list(inspect.signature(cls.__init__).parameters.items())[1:]:
        if option.kind == option.VAR_KEYWORD:
            continue  # those of the base class
        if option.kind != option.KEYWORD_ONLY or option.default is option.empty:
            yield f"option {name!r}: make it keyword-only, with a default"
        elif name not in hints:
            yield f"option {name!r}: annotate it, as in `{name}: Annotated[int, Option(...)] = {option.default!r}`"


def _shared(cls: type[Device]) -> Iterator[str]:
    for each in cls.__mro__[: cls.__mro__.index(Device)]:
        for name, value in vars(each).items():
            if isinstance(value, MUTABLE):
                yield (
                    f"{each.__name__}.{name} is a {type(value).__name__} on the class, "
                    "which all devices share and no restart resets: make it in __init__"
                )


def _ports(device: Device) -> Iterator[str]:
    ports = getattr(device, "ports", ())
    if wrong := port_error(ports):
        yield wrong
    elif len(ports) > 1 and ("" in (names := [each.name for each in ports]) or len(set(names)) < len(names)):
        yield f"ports: give each of several its own name, got {names}"


def _senses(device: Device) -> Iterator[str]:
    keys = [sense.key for sense in device.sensed]
    for sense in device.sensed:
        if wrong := quantity_error(sense):
            yield wrong
        if sense.burst < 1:
            yield f"sense {sense.key!r}: burst {sense.burst}, expected 1 or more"
    yield from (f"senses: two are called {key!r}" for key in _duplicates(keys))
    for name, stream in device.streams.items():
        yield from (f"stream {name!r}: no sense {key!r}; there are {keys}" for key in stream.senses if key not in keys)
    for name, period in device.periods.items():
        if period < 0:
            yield f"stream {name!r}: a period of {period} ns"


def _duplicates(names: Sequence[Any]) -> list[Any]:
    return [name for name, count in Counter(names).items() if count > 1]


def _columns(device: Device) -> Iterator[str]:
    keys = [sense.key for sense in device.sensed]
    if not device.columns:
        yield "columns: declare the meaning of the counts, as in Column(name=..., low=..., high=..., push=1)"
    for column in device.columns:
        if column.low >= column.high or not column.low <= column.rest <= column.high:
            yield (
                f"column {column.name!r}: expected low <= rest <= high and low < high, got low {column.low:g}, "
                f"rest {column.rest:g}, high {column.high:g}"
            )
        if column.sense and column.sense not in keys:
            yield f"column {column.name!r}: no sense {column.sense!r}; there are {keys}"
        if column.counts_per_unit and not column.unit:
            yield f"column {column.name!r}: {column.counts_per_unit:g} counts per unit, but no unit: give it"
    for sense, name in _duplicates([(column.sense, column.name) for column in device.columns]):
        yield f"columns: two{sense and f' of {sense}'} are called {name!r}: give each axis its own name"
    for each in device.rollovers:
        if each.bits < 1 or (each.state and not hasattr(device, each.state)):
            yield f"rollover {each.name!r}: {each.bits} bits in self.{each.state}: expected 1 or more in an attribute"


def _commands(subject: Subject, device: Device) -> Iterator[str]:
    commands, ports = subject.commands, [port.name for port in device.ports]
    yield from (f"commands: two are called {name!r}" for name in _duplicates([each.name for each in commands]))
    for command in commands:
        if not command.origin.strip():
            yield f"command {command.name!r}: give the source of the example (origin)"
        if command.port and command.port not in ports:
            yield f"command {command.name!r}: no port {command.port!r}; there are {ports}"
            continue
        connector = device.connector(command.port) if command.port else device.ports[0]
        for request in (*command.after, *command.written):
            yield from _request_faults(command.name, request, connector)


def _request_faults(name: str, request: Any, connector: Connector) -> Iterator[str]:
    try:
        frame = frame_of(request)
    except ValueError as error:
        yield f"command {name!r}: {request!r}: {error}"
        return
    if isinstance(frame, CanFrame) != isinstance(connector, Can):
        yield f"command {name!r}: {request!r} is not a frame of a {type(connector).__name__} port"
    elif isinstance(frame, CanFrame) and isinstance(connector, Can) and connector.filters:
        if not any(frame.arbitration_id & mask == ident & mask for ident, mask in connector.filters):
            yield f"command {name!r}: no filter of its port accepts the identifier of {request!r}"


def _layout(device: Device) -> Iterator[str]:
    layout = device.layout
    if not len(layout):
        if measures_contact(device):
            yield "layout: it has no taxel"
        return
    if not np.isfinite(layout.positions).all():
        yield "layout: expected finite positions"
        return
    lengths, lean = np.linalg.norm(layout.x_axes, axis=1), (layout.normals * layout.x_axes).sum(1)
    if not np.allclose(lengths, 1.0, atol=1e-6) or not np.allclose(lean, 0.0, atol=1e-6):
        yield "layout: expected every x axis of length 1 and at right angles to its normal"
    if not (layout.pitches > 0).all() or not (layout.areas > 0).all():
        yield "layout: expected pitch and area of every patch above 0"
        return
    yield from (
        f"layout: patch {patch.name!r} is mirrored: seen from outside, its columns go to the left as its rows go down"
        for patch in layout.patches
        if _is_mirrored(layout, patch)
    )
    yield from (f"layout: two patches are called {name!r}" for name in _duplicates([p.name for p in layout.patches]))
    links = np.concatenate([[patch.link] * len(patch) for patch in sorted(layout.patches, key=lambda p: p.start)])
    for link in layout.links:
        own = np.flatnonzero(links == link)
        if (pair := _close_pair(layout.positions[own], MIN_DISTANCE_PITCHES * layout.pitches[own].min())) is not None:
            both = f"{own[pair[0]]} and {own[pair[1]]}"
            yield f"layout: taxels {both} lie at one place (less than {MIN_DISTANCE_PITCHES} pitches apart)"


def _is_mirrored(layout: Layout, patch: Patch) -> bool:
    """Return True if the picture of a patch is a mirror image of it: row 0 on top, column 0 on the left."""
    if patch.rows < 2 or patch.cols < 2:
        return False
    grid = layout.positions[patch.taxels].reshape(patch.rows, patch.cols, 3)
    right, down = np.diff(grid, axis=1).mean((0, 1)), np.diff(grid, axis=0).mean((0, 1))
    area = np.cross(right, -down) @ layout.normals[patch.taxels].mean(0)
    return bool(area < -0.5 * np.linalg.norm(right) * np.linalg.norm(down))


def _close_pair(positions: np.ndarray, distance: float) -> tuple[int, int] | None:
    """Return two points nearer than ``distance``, found in cells of that size; ``None`` if there are none."""
    cells: dict[tuple[int, ...], list[int]] = {}
    steps = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    for k, cell in enumerate(map(tuple, np.floor(positions / distance).astype(int).tolist())):
        for step in steps if cells else ():
            for other in cells.get((cell[0] + step[0], cell[1] + step[1], cell[2] + step[2]), ()):
                if np.linalg.norm(positions[k] - positions[other]) < distance:
                    return other, k
        cells.setdefault(cell, []).append(k)
    return None
