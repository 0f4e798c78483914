"""Snapshots of an emulator: what belongs to one, in memory and in a file."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import StateError
from tactemu.emulator.saving import parts, state_file

MAX_TURN_NS = 600_000_000_000
"""Longest turn of the loop in which a state can be saved: one in which kernels are compiled."""


def snapshot_of(emulator: Any) -> dict[str, Any]:
    """Return the whole state as plain data.

    Raises:
        StateError: some part of it cannot be saved.
    """
    there = parts.parts_of(emulator)
    state = parts.state_of(there)
    return {"header": state_file.header(_recipe(emulator, there), emulator.clock.now_ns()), "parts": state}


def write(path: str | Path, state: Mapping[str, Any]) -> int:
    """Return a state as a file; returns its size [byte].

    Raises:
        StateError: the file cannot be written.
    """
    return state_file.write(path, state["header"], state["parts"])


def restore(emulator: Any, state: Mapping[str, Any] | str | Path) -> None:
    """Let the emulator go on from a state.

    Raises:
        StateError: it is not one of such an emulator; says what differs. Nothing has changed.
    """
    there = parts.parts_of(emulator)
    recipe = _recipe(emulator, there)
    if isinstance(state, Mapping):
        header, tree = state["header"], state["parts"]
        state_file.check_header(header, recipe, "the state")
    else:
        memory = sum(array.numpy().nbytes for array in _memory(there))
        header, tree = state_file.read(state, recipe, memory)
    _check_time(header["t_ns"], tree)
    give = parts.prepare_restore(there, tree, header["t_ns"])
    give()
    emulator.clock.set_ns(header["t_ns"])
    emulator.now_ns = header["t_ns"]
    emulator.truth.origin_ns = emulator.clock.origin_ns


def _check_time(t_ns: int, tree: Mapping[str, Any]) -> None:
    loop = tree.get("")
    now_ns = loop.get("now_ns") if isinstance(loop, Mapping) else None
    if type(now_ns) is not int or not 0 <= t_ns - now_ns <= MAX_TURN_NS:
        raise StateError(f"the loop: now_ns: expected the time of the state, {t_ns}, got {now_ns!r:.40}")


def _simulation(there: Mapping[str, Any]) -> Any:
    return next((part for part in there.values() if hasattr(getattr(part, "context", None), "memory")), None)


def _memory(there: Mapping[str, Any]) -> list[Any]:
    simulation = _simulation(there)
    return [] if simulation is None else simulation.context.memory


# -- what it is of -----------------------------------------------------------------------------------------------------


def _recipe(emulator: Any, there: Mapping[str, Any]) -> dict[str, Any]:
    """What a state must have been saved of, to be restored here: tables of texts and numbers, by names for messages."""
    devices = {channel.name: _device(channel.device) for channel in emulator.channels}
    found: dict[str, Any] = {"device": devices, **emulator.recipe}
    simulation = _simulation(there)
    if simulation is not None:
        context = simulation.context
        found["simulation"] = {
            "runs on": "cpu" if context.device.is_cpu else "cuda",
            "environments": context.n_envs,
            "dtype": context.real.__name__,
            "dt": simulation.dt,
            "seed": context.seed,
            "bodies": [body.name for body in simulation.bodies],
            "sensor": {sensor.name: _options(sensor.model) for sensor in simulation.sensors},
            "stage": [stage.name for stage in simulation.plan.stages],
        }
    return found


def _device(device: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"name": device.name, "option": {key: repr(each) for key, each in device.options.items()}}
    module = inspect.getmodule(type(device))
    if module is None or not module.__name__.startswith("firmware_protocols."):  # a file that somebody works on
        source = inspect.getsourcefile(type(device))
        found["file"] = _digest(Path(source).read_bytes()) if source else "unknown"
    return found


def _options(model: Any) -> dict[str, str]:
    """Class and options of a sensor model; what is long as its digest."""
    values = {each.name: getattr(model, each.name) for each in dataclasses.fields(model)}
    texts = {name: str(each.tolist() if isinstance(each, np.ndarray) else each) for name, each in values.items()}
    short = {name: text if len(text) <= 200 else _digest(text.encode()) for name, text in texts.items()}
    return {"model": type(model).__name__, **short}


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()
