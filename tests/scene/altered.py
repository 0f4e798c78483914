"""Scenes with one value replaced by something else: each gives one sentence, or a run whose readings and counts hold.

::

    python -m tests.scene.altered                          every value of every scene; takes some minutes
    python -m tests.scene.altered --scenes layer,hand --values nan,-1

A scene runs for a moment of virtual time on ports ``memory:``. What is not allowed: any exception but tactemu's own,
a message of more lines than there are mistakes or of a thousand letters, a warning of numpy, a reading that is not
finite, a count that its column cannot show, and a run that does not end.
"""

from __future__ import annotations

import argparse
import copy
import math
import os
import signal
import sys
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.clock import VirtualClock
from tactemu.base.errors import TactemuError
from tactemu.base.kernels import start_warp
from tactemu.emulator.assembly import assemble, truth_of
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.scene.steering import steered

ROOT = Path(__file__).parents[2]
OURS = tuple(str(ROOT / name) for name in ("tactemu", "firmware_protocols"))
OWN = sorted((ROOT / "tests" / "data" / "altered").glob("*.toml"))
"""Scenes that are here to be altered: they name nearly every key that there is."""
OTHERS = [
    "examples/hand.toml",
    "examples/mujoco_ball.toml",
    "examples/so101.toml",
    "examples/hands/ability_hand.toml",
    "examples/hands/inspire_rh56dftp.toml",
    "examples/hands/linker_l6.toml",
    "examples/hands/paxini_gripper.toml",
    "examples/hands/so101.toml",
    "tactemu/scene/start.toml",
    "tactemu/scene/defaults/anyskin.toml",
    "tactemu/scene/defaults/icub_skin.toml",
    "tactemu/scene/defaults/robotiq_tsf85.toml",
    "tactemu/scene/defaults/xela_uskin.toml",
    "tests/data/scenes/icub_forearm_moving.toml",
]
SCENES = {path.stem: path for path in OWN} | {name: ROOT / name for name in OTHERS}
VALUES: dict[str, Any] = {
    "nan": math.nan, "inf": math.inf, "1e308": 1e308, "1e12": 1e12, "-1": -1, "0": 0, "[]": [], "[1, 2]": [1, 2],
    "text": "text",
}  # fmt: skip
RUN_S = 0.1
MOST_LINES = 5
"""Most lines of a message: one for each mistake, as for each key that names a body that is gone."""
MOST_LETTERS = 1000
"""Most letters of a line."""
TIMEOUT_CPU_S = 60
"""Longest that a case may compute; a kernel that is compiled takes up to half of it."""
TIMEOUT_S = 600
"""Longest that it may take."""

Way = tuple[str | int, ...]


class Defect(Exception):
    """A case that is neither refused well nor runs well."""


def places(value: Any, way: Way = ()) -> Iterator[Way]:
    """Yield the way to every table, list and value in ``value``."""
    if way:
        yield way
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*way, key))


def altered(tables: dict[str, Any], way: Way, value: Any) -> dict[str, Any]:
    """Return a copy of ``tables`` with ``value`` at the end of ``way``."""
    tables = copy.deepcopy(tables)
    inside: Any = tables
    for key in way[:-1]:
        inside = inside[key]
    inside[way[-1]] = value
    return tables


def tried(path: Path, tables: dict[str, Any], way: Way = ()) -> str:
    """Run a scene; return its message where it is refused, else an empty text.

    Raises:
        Defect: it neither runs well nor is refused well.
    """
    for number in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(number, _too_long)
    signal.setitimer(signal.ITIMER_PROF, TIMEOUT_CPU_S)
    signal.alarm(TIMEOUT_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            _run(path, tables, port=None if {"port", "ports"} & set(way) else "memory:")
    except TactemuError as error:
        lines = str(error).split("\n")
        if not lines[0] or len(lines) > MOST_LINES or max(map(len, lines)) > MOST_LETTERS:
            raise Defect(f"message of {len(lines)} lines, {len(str(error))} letters: {error!s:.300}") from error
        return str(error)
    except Defect:
        raise
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if frame.filename.startswith(OURS)] or frames
        where = f"{ours[-1].filename.removeprefix(str(ROOT))}:{ours[-1].lineno}"
        raise Defect(f"{type(error).__name__} at {where}: {error!s:.200}") from error
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
    return ""


def _too_long(*_: Any) -> None:
    raise TimeoutError("it did not end")


def _run(path: Path, tables: dict[str, Any], port: str | None) -> None:
    loaded = steered(file.check(tables, source=path.name, folder=path.parent))
    log = truth_of(loaded)
    try:
        emulator = assemble(loaded, AssemblyOptions(port=port), clock=VirtualClock(), truth=log).emulator
        with emulator:
            emulator.run(RUN_S)
    finally:
        log.close()
    _check(emulator)


def _check(emulator: Emulator) -> None:
    devices = {channel.name: channel.device for channel in emulator.channels}
    for sample in emulator.truth.samples:
        columns = [column for column in devices[sample.device].columns if column.sense in ("", sample.sense)]
        for name in ("ideal", "measured", "counts"):
            values = np.asarray(getattr(sample, name))
            if not np.isfinite(values).all():
                raise Defect(f"{name} of {sample.device} {sample.sense} at {sample.t_ns} ns: {values.ravel()[:9]}")
        if not columns:
            continue
        each = sample.counts.ndim == 2 and sample.counts.shape[1] == len(columns)
        low, high = (np.array([getattr(column, end) for column in columns]) for end in ("low", "high"))
        low, high = (low, high) if each else (low.min(), high.max())
        room = 1e-6 * np.maximum(abs(low), abs(high))  # of counts that are float32
        if ((sample.counts < low - room) | (sample.counts > high + room)).any():
            raise Defect(f"counts of {sample.device} {sample.sense} out of range: {sample.counts.ravel()[:9]}")


def cases(scenes: list[str], values: list[str]) -> Iterator[tuple[str, Way, str]]:
    """Yield each case: the scene, the way to the value that is replaced, and by which."""
    for scene in scenes:
        for way in places(tomllib.loads(SCENES[scene].read_text())):
            yield from ((scene, way, value) for value in values)


def trial(scene: str, way: Way, value: str) -> str:
    """Run one case; see :func:`tried`."""
    path = SCENES[scene]
    return tried(path, altered(tomllib.loads(path.read_text()), way, VALUES[value]), way)


def main() -> int:
    """Run what the command line asks for; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(SCENES), help="separated by commas; a beginning is enough")
    parser.add_argument("--values", help=f"of {' '.join(VALUES)}, separated by commas")
    parser.add_argument("--only", default="", help="ways that contain this, as skin.0.options.noise")
    parser.add_argument("--say", action="store_true", help="print every message")
    asked = parser.parse_args()
    start_warp()
    os.chdir(ROOT)
    scenes = [name for name in SCENES if any(name.startswith(word) for word in asked.scenes.split(","))]
    values = asked.values.split(",") if asked.values else list(VALUES)
    ends, found, began = Counter[str](), Counter[str](), time.monotonic()
    for scene in scenes:
        if said := tried(SCENES[scene], tomllib.loads(SCENES[scene].read_text())):
            found["as it is"] += 1
            print(f"{scene}: does not run as it is: {said}")
            continue
        for case in cases([scene], values):
            words = f"{scene} {'.'.join(map(str, case[1]))} = {case[2]}"
            if asked.only not in words:
                continue
            try:
                said = trial(*case)
            except Defect as defect:
                found[str(defect)[:60]] += 1
                print(f"{words}: {defect}", flush=True)
                continue
            ends["refused" if said else "ran"] += 1
            if asked.say:
                print(f"{words}: {said or 'ran'}", flush=True)
    n_cases = ends.total() + found.total()
    print(f"{len(scenes)} scenes, {n_cases} cases in {time.monotonic() - began:.0f} s: {ends['refused']} refused, "
          f"{ends['ran']} ran, {found.total()} defects")  # fmt: skip
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
