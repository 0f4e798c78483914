"""The snapshots of an emulator, in memory and in a file."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import StateError
from tactemu.base.option_groups import to_flat
from tactemu.emulator.saving import parts, state_file

MAX_TURN_NS = 600_000_000_000
"""Longest turn of the loop in which a state can be saved; long enough for the compilation of kernels."""


def snapshot_of(emulator: Any) -> dict[str, Any]:
    """Return the complete state of an emulator as plain data.

    Raises:
        StateError: a part of it cannot be saved.
    """
    there = parts.parts_of(emulator)
    state = parts.state_of(there)
    return {"header": state_file.header(_recipe(emulator, there), emulator.clock.now_ns()), "parts": state}


def write(path: str | Path, state: Mapping[str, Any]) -> int:
    """Write a state to a file; return its size [byte].

    Raises:
        StateError: the file cannot be written.
    """
    return state_file.write(path, state["header"], state["parts"])


def restore(emulator: Any, state: Mapping[str, Any] | str | Path) -> None:
    """Restore a state of the emulator.

    Raises:
        StateError: the state is of another emulator; names the difference. Nothing has changed.
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


# -- the recipe --------------------------------------------------------------------------------------------------------


def _recipe(emulator: Any, there: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scene, devices and options that a state must have: tables of texts and numbers, named for messages."""
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
    if module is None or not module.__name__.startswith("firmware_protocols."):  # a file that its author may change
        source = inspect.getsourcefile(type(device))
        found["file"] = _digest(Path(source).read_bytes()) if source else "unknown"
    return found


def _options(model: Any) -> dict[str, str]:
    """Return the class and options of a sensor model; long options as their digests."""
    values = to_flat(model)
    texts = {name: str(each.tolist() if isinstance(each, np.ndarray) else each) for name, each in values.items()}
    short = {name: text if len(text) <= 200 else _digest(text.encode()) for name, text in texts.items()}
    return {"model": type(model).__name__, **short}


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()
