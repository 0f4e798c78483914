"""The state of an object and of all its parts, as plain data, and its restoration.

A *part* is an object that exists before a state is restored and stays the same object: the loop, a channel, a wire.
Its class lists in ``TRANSIENT_FIELDS`` the attributes that are no state (those that are made anew and equal, those of
the outside); all others are its state, so that an attribute that is added to a class later is saved, too. Attributes
that lead to parts are its structure, also those in ``TRANSIENT_FIELDS``. All others must hold plain data or objects of
the modules in :data:`VALUES`, which may have ``__getstate__`` and ``__setstate__`` as for pickle.

Two more hooks, if a part needs them:

* ``state()`` returns its state in place of the attributes;
* ``prepare_restore(state)`` checks the state, changes nothing, and returns a callable that is called when all parts
  have their attributes. Of a part with ``state()``, it checks that arrays are finite, and the callable restores the
  part.

Copies are made without these hooks: ``Simulation.clone()`` and ``Sensor.clone()`` return another of the same scene at
its start; ``Assembled.fork()`` returns another emulator (``reassemble()``) with the state of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from firmware_protocols import Device
from firmware_protocols import state as plain
from tactemu.base.errors import StateError, TactemuError
from tactemu.emulator.saving.leaves import LeafCheck
from tactemu.emulator.saving.rehearsal import rehearse

VALUES = (
    "firmware_protocols", "tactemu.base.loop", "tactemu.base.statistics", "tactemu.emulator.channel",
    "tactemu.emulator.sampling", "tactemu.geometry.motion", "tactemu.transports.transport", "tactemu.truth.entries",
    "tactemu.wire",
)  # fmt: skip
"""Packages and modules whose objects are data: they are saved with their attributes, and made anew."""


def parts_of(root: Any) -> dict[str, Any]:
    """Return the parts of ``root``, itself included, by their paths: ``channels[0].wires['']``."""
    found: dict[str, Any] = {}
    seen: set[int] = set()

    def look(value: Any, name: str) -> None:
        if isinstance(value, list | tuple):
            for k, each in enumerate(value):
                look(each, f"{name}[{k}]")
        elif isinstance(value, dict):
            for key, each in value.items():
                look(each, f"{name}[{key!r}]")
        elif _is_part(value) and id(value) not in seen:
            seen.add(id(value))
            found[name] = value
            if not isinstance(value, Device):
                for key, each in (_attributes(value) | vars(value)).items():
                    look(each, f"{name}.{key}".lstrip("."))

    look(root, "")
    return found


def state_of(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the state of all parts: nested dicts and lists of plain values and arrays, which share nothing with them.

    Raises:
        StateError: a value cannot be saved; names its place.
    """
    writer = _Writer(_belongs, parts)
    try:
        return {name: _written(part, name, writer) for name, part in parts.items()}
    except plain.NotPlain as error:
        raise StateError(f"cannot be saved: {error}") from None


def prepare_restore(parts: Mapping[str, Any], state: Mapping[str, Any], t_ns: int) -> Callable[[], None]:
    """Check that ``state`` is a state of such parts at ``t_ns``; return a callable that restores it.

    Raises:
        StateError: names the value that does not fit. Nothing has been changed.
    """
    _check_names("the emulator", "part", parts, state)
    reader, leaves = _Reader(_belongs, parts), LeafCheck(t_ns)
    steps = [_prepare_restore(part, name, state[name], reader, leaves) for name, part in parts.items()]

    def take() -> None:
        for step in [first for first, _ in steps] + [then for _, then in steps]:
            step()

    return take


# -- one part ----------------------------------------------------------------------------------------------------------


def _written(part: Any, name: str, writer: _Writer) -> dict[str, Any]:
    if isinstance(part, Device):
        return part.snapshot()
    attributes = part.state() if hasattr(part, "state") else _own(part)
    return {key: writer.write(value, f"{name}.{key}".lstrip(".")) for key, value in attributes.items()}


def _prepare_restore(
    part: Any, name: str, state: Any, reader: _Reader, leaves: LeafCheck
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return a callable that sets the attributes of a part, and one for when all parts have theirs."""
    where = name or "the loop"
    if not isinstance(state, dict):
        raise StateError(f"{where}: expected a table, got {type(state).__name__}")
    try:
        if isinstance(part, Device):
            return partial(plain.set_attributes, part, _device_attributes(part, where, state, leaves)), _nothing
        here = part.state() if hasattr(part, "state") else _own(part)
        _check_names(where, "attribute", here, state)
        attributes = {key: reader.read(value) for key, value in state.items()}
        leaves.attributes(type(part), attributes, [here], name)
        then = part.prepare_restore(attributes) if hasattr(part, "prepare_restore") else _nothing
        return _nothing if hasattr(part, "state") else partial(vars(part).update, attributes), then
    except StateError:
        raise
    except (TactemuError, ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        raise StateError(f"{where}: {error}") from None


def _nothing() -> None:
    pass


def _device_attributes(device: Device, where: str, state: Mapping[str, Any], leaves: LeafCheck) -> dict[str, Any]:
    """Return the attributes in the state of a device, after a rehearsal with a copy of the device.

    Raises:
        ValueError, StateError: a device of this class cannot have them, or raises with them.
    """
    fresh, other = type(device)(**device.options), type(device)(**device.options)
    there = [
        {key: each for key, each in vars(one).items() if key not in plain.TRANSIENT_FIELDS} for one in (device, fresh)
    ]
    if missing := sorted(there[1].keys() - state.keys()):
        raise ValueError(f"the state of {device.name} lacks {', '.join(missing)}")
    attributes = plain.decode(device, dict(state))
    leaves.attributes(type(device), attributes, there, where)
    plain.set_attributes(other, plain.decode(other, dict(state)))
    rehearse(other, fresh.periods.keys(), leaves.t_ns)
    return attributes


def _check_names(where: str, what: str, here: Mapping[str, Any], there: Mapping[str, Any]) -> None:
    for name in there.keys() - here.keys():
        raise StateError(f"{where}: has no {what} {name!r}, which the state has")
    for name in here.keys() - there.keys():
        raise StateError(f"{where}: the state lacks the {what} {name!r}")


def _is_part(value: Any) -> bool:
    return hasattr(type(value), "TRANSIENT_FIELDS") or isinstance(value, Device)


def _attributes(part: Any) -> dict[str, Any]:
    return {name: value for name, value in vars(part).items() if name not in part.TRANSIENT_FIELDS}


def _own(part: Any) -> dict[str, Any]:
    """Return the attributes of a part without those that lead to other parts."""
    return {name: value for name, value in _attributes(part).items() if not _leads_to_parts(value)}


def _leads_to_parts(value: Any) -> bool:
    if isinstance(value, list | tuple | dict) and value:
        return all(map(_leads_to_parts, value.values() if isinstance(value, dict) else value))
    return _is_part(value)


# -- values ------------------------------------------------------------------------------------------------------------


def _belongs(module: str) -> bool:
    return any(module == each or module.startswith(f"{each}.") for each in VALUES)


class _Writer(plain.Writer):
    def compound(self, value: Any, where: str) -> dict[str, Any]:
        if type(value) is np.random.Generator:
            return {"~": "generator", "state": self.write(value.bit_generator.state, where)}
        return super().compound(value, where)


class _Reader(plain.Reader):
    def make(self, kind: str, value: dict[str, Any]) -> Any:
        if kind == "generator":
            bits = np.random.Philox()
            bits.state = self._read(value["state"])
            return self.keep(value, np.random.Generator(bits))
        return super().make(kind, value)
