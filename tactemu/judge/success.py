"""Success rate of a task, such as a grasp, under faults of growing strength: `tactemu judge --success`.

The command runs the task; the function ``success`` of a script returns True if it succeeded, from the scene's state::

    def success(dev):
        time.sleep(4)                                   # the task needs this time to grasp
        dev.move((0, 0, -0.2), body="table", speed=0.3)
        time.sleep(2)
        return dev.state()["bodies"]["object"]["position"][2] > 0.06

``dev`` is what :func:`tactemu.serve` returns. Each trial has its own emulator, process and seed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError, no_such, reason_of
from tactemu.judge.driver import Driver, command_of
from tactemu.judge.options import JudgeOptions
from tactemu.session.serving import Served, serve

STRENGTHS: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "drop": ("frames lost [%]", (1, 3, 10, 30, 60)),
    "flip": ("frames with a wrong bit [%]", (1, 3, 10, 30, 60)),
    "late": ("frames late by [ms]", (5, 20, 50, 100, 200)),
    "dead": ("taxels dead [%]", (5, 10, 25, 50, 75)),
}
"""Title with unit, and strengths, of each kind of fault."""
ROUNDS = 3
"""Number of trials at each strength without a budget."""
Z_SCORE = 1.96
"""Quantile of the normal distribution for an interval of 95 %."""
Success = Callable[[Served], Any]


@dataclass(frozen=True)
class Point:
    """One strength of one fault."""

    fault: str
    """The kind of fault; "" for none."""
    strength: float
    tried: int = 0
    succeeded: int = 0

    @property
    def interval(self) -> tuple[float, float]:
        """The confidence interval of the success rate, by Wilson at 95 %."""
        n, z2 = max(self.tried, 1), Z_SCORE**2
        rate = self.succeeded / n
        middle = (rate + z2 / (2 * n)) / (1 + z2 / n)
        half = Z_SCORE / (1 + z2 / n) * math.sqrt(rate * (1 - rate) / n + z2 / (4 * n * n))
        return max(0.0, middle - half), min(1.0, middle + half)

    def after(self, success: bool) -> Point:
        """Return the point with one more trial."""
        return Point(self.fault, self.strength, self.tried + 1, self.succeeded + success)


def read_script(path: Path) -> Success:
    """Return the function ``success`` of a script.

    Raises:
        TactemuError: the script cannot be read or run, or has no such function.
    """
    names: dict[str, Any] = {"__name__": "success", "__file__": str(path)}
    try:
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    except OSError as error:
        raise TactemuError(f"--success: {path}: cannot read it: {reason_of(error)}") from None
    except Exception as error:
        raise TactemuError(f"--success: {path}: {type(error).__name__}: {error}") from error
    if not callable(names.get("success")):
        raise TactemuError(f"--success: {path} has no function success(dev); define one that returns True or False")
    return names["success"]


def success_curve(
    target: str,
    command: Sequence[str],
    success: Success,
    options: JudgeOptions,
    report_progress: Callable[[str], object] = lambda text: None,
) -> Iterator[dict[tuple[str, float], Point]]:
    """Try each fault at each strength, round by round, and yield all points after each trial.

    Args:
        target: scene file or device.
        command: of the task; ``{port}`` as for drivers, ``{channel}`` and ``{interface}`` on CAN.
        success: a function that returns True if the task succeeded, given the served emulator.
        options: ``only`` has kinds of :data:`STRENGTHS`; ``seed`` is that of the first round, and each later round adds
            1; after ``budget_s`` no further trial begins, but the first round is always complete; and ``port``.
        report_progress: called with a description of each trial.

    Raises:
        TactemuError: there is no such kind, the emulator or the command cannot be started, or the script failed.
    """
    only, budget_s = options.only, options.budget_s
    for kind in only:
        if kind not in STRENGTHS:
            raise TactemuError(f"--only: {no_such('fault', kind, STRENGTHS)}")
    keys = [("", 0.0)] + [(kind, s) for kind in only or STRENGTHS for s in STRENGTHS[kind][1]]
    points = {key: Point(*key) for key in keys}
    began, k = time.monotonic(), 0
    while k < ROUNDS if budget_s is None else k == 0 or time.monotonic() < began + budget_s:
        for key in keys:
            report_progress(f"round {k + 1}: {title(key[0])} {key[1]:g}" if key[0] else f"round {k + 1}: no fault")
            points[key] = points[key].after(_tried(target, command, success, key, options.port, options.seed + k))
            yield points
            if budget_s is not None and k and time.monotonic() > began + budget_s:
                return
        k += 1


def title(kind: str) -> str:
    """Return the title of a kind of fault, with its unit."""
    return STRENGTHS[kind][0] if kind else "no fault"


def _tried(
    target: str,
    command: Sequence[str],
    success: Success,
    key: tuple[str, float],
    port: str | Mapping[str, str] | None,
    seed: int,
) -> bool:
    """Run one trial and return True if it succeeded."""
    kind, strength = key
    faults = {"drop": f"drop {strength:g}% both", "flip": f"flip {strength:g}% both", "late": f"late by {strength:g}ms"}
    with serve(target, port, faults=faults.get(kind, ()), seed=seed, adjustable=["dead"]) as dev:
        if kind == "dead":
            _kill(dev, strength / 100, seed)
        driver = Driver(command_of(command, dev.ports), dev.ports)
        try:
            return bool(success(dev))
        except TactemuError:
            raise
        except Exception as error:
            raise TactemuError(f"--success: {type(error).__name__}: {error}") from error
        finally:
            driver.end()


def _kill(dev: Served, share: float, seed: int) -> None:
    """Make a share of each skin's taxels dead, at value 0."""
    for channel in dev.emulator.channels:
        if n := len(channel.device.layout):
            chosen = np.random.default_rng((seed, n)).permutation(n)[: round(share * n)]
            dev.dead(chosen.tolist(), 0.0, skin=channel.name)


def as_text(points: Mapping[tuple[str, float], Point]) -> list[str]:
    """Return the curve as text, a line for each strength."""
    lines, last = [], None
    for (kind, strength), point in points.items():
        if not point.tried:
            continue
        if kind != last:
            lines.append(title(kind))
            last = kind
        rate, (low, high) = point.succeeded / point.tried, point.interval
        bar = "#" * round(20 * rate)
        lines.append(
            f"  {f'{strength:g}' if kind else '':>5}  {bar:20}  {point.succeeded} of {point.tried}"
            f"  ({100 * low:.0f} to {100 * high:.0f} %)"
        )
    return lines


def as_data(points: Mapping[tuple[str, float], Point]) -> list[dict[str, Any]]:
    """Return the curve as JSON data."""
    return [
        {
            "fault": point.fault, "strength": point.strength, "of": title(point.fault), "tried": point.tried,
            "succeeded": point.succeeded, "interval": list(point.interval),
        }
        for point in points.values()
    ]  # fmt: skip
