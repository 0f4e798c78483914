"""State files with one leaf altered: refused in one sentence, or the run goes on for a second with finite readings."""

import random
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tactemu.base.errors import StateError
from tactemu.emulator.saving import snapshots
from tests.emulator.saving import story, test_models
from tests.fuzz import TIMES

LEAVES = 40
"""Altered leaves per scene; the nightly run has ``TIMES`` as many."""
SAVED_S = 0.0813
WRITTEN = "n", "~", "class", "as", "factory"
"""Keys by which the writer of a state says what follows."""


SCENES = {
    "a board of its own clock": lambda: story.of_device("singletact"),
    "a board on a CAN bus": lambda: story.of_device("xela_uskin"),
    "a hand that is polled": lambda: story.of_device("linker_hand_l10_rs485"),
    "an elastic layer": lambda: test_models.scene("elastic_layer_taxel", {}),
    "all imperfections": lambda: test_models.scene("kinematic_taxel", test_models.SPOILT["electronics"]),
}


def leaves(value: Any, path: tuple = ()) -> Iterator[tuple[tuple, Any]]:
    """Yield every leaf of a written state with the way to it."""
    if isinstance(value, dict):
        for key, each in value.items():
            if "~" not in value or key not in WRITTEN:
                yield from leaves(each, (*path, key))
    elif isinstance(value, list):
        for k, each in enumerate(value):
            yield from leaves(each, (*path, k))
    else:
        yield path, value


def replacements(value: Any) -> list[Any]:
    """Return what a leaf is replaced by."""
    if not isinstance(value, np.ndarray):
        others = [None, float("nan"), float("inf"), 2**62, 1e300, -(2**62), -5, "x", [], [1]]
        return [other for other in others if type(other) is not type(value) or other != value]
    found: list[Any] = [None, "x", np.zeros((*value.shape, 2), value.dtype)]
    if value.dtype.kind == "f":
        top = np.finfo(value.dtype).max
        found += [np.full_like(value, other) for other in (np.nan, np.inf, top, -top)]
    elif value.dtype.kind in "iu":
        found += [np.full_like(value, other) for other in (np.iinfo(value.dtype).max, np.iinfo(value.dtype).min)]
    return found


def altered(state: dict, path: tuple, other: Any) -> dict:
    """Return the state with another leaf; the rest is shared."""
    whole = node = dict(state)
    for key in path[:-1]:
        node[key] = dict(node[key]) if isinstance(node[key], dict) else list(node[key])
        node = node[key]
    node[path[-1]] = other
    return whole


def hangs(*_: Any) -> None:
    raise TimeoutError("no second of the run in 20 s")


@pytest.mark.parametrize("name", SCENES)
def test_an_altered_leaf_is_refused_or_harmless(name, tmp_path):
    chance, path, data = random.Random(name), tmp_path / "altered.npz", SCENES[name]()
    saved, emulator = [], story.build(data)
    story.ask(emulator)
    with emulator:
        emulator.call(lambda: saved.append(emulator.snapshot()), round(SAVED_S * 1e9))
        emulator.run(SAVED_S + 0.01)
    (state,) = saved
    cases = [(at, other) for at, value in leaves(state["parts"], ("parts",)) for other in replacements(value)]
    cases = [(("header", "t_ns"), 2**62), *chance.sample(cases, min(len(cases), LEAVES * TIMES - 1))]
    emulator = story.build(data)
    before = signal.signal(signal.SIGALRM, hangs)
    try:
        with emulator:
            emulator.run(0.02)
            here, refused = emulator.snapshot(), 0
            for at, other in cases:
                signal.alarm(20)
                where = f"{'/'.join(map(str, at))} = {other!r:.40}"
                refused += not goes_on(emulator, altered(state, at, other), path, where)
                emulator.restore(here)
        assert refused > len(cases) / 2
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def goes_on(emulator: Any, state: dict, path: Any, where: str) -> bool:
    """Return True if the run goes on from the state, False if it is refused."""
    snapshots.write(path, state)
    try:
        emulator.restore(path)
    except StateError as error:
        assert len(str(error)) < 600 and "\n" not in str(error), where
        return False
    try:
        emulator.run(1.0)
    except Exception as error:
        raise AssertionError(f"{where}: {type(error).__name__}: {error}") from error
    for sample in [*emulator.truth.samples][-50:]:
        assert np.isfinite(sample.measured).all(), where
    return True
