"""The choice among all measured settings, and its report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any

from tactemu.sensors.sensor_model import Setting
from tactemu.tune.cost import MAX_CPU_SHARE, MAX_LOST_SHARE, Cost
from tactemu.tune.errors import ERRORS, Criterion

ALIKE = 1.05
"""Errors within this factor count as equal: the cheaper setting is chosen."""
AS_FAST = 1.15
"""Costs within this factor count as equal: one setting measured twice on a busy machine differs by as much."""


@dataclass(frozen=True)
class Pace:
    """The rate and the time step that every setting must keep."""

    rate_hz: float
    """Samples per second of every skin."""
    dt: float
    """The scene's time step [s]."""


@dataclass(frozen=True)
class Measured:
    """A setting with its measured cost and errors."""

    setting: Setting
    cost: Cost
    pace: Pace
    error: float
    """The error that decides."""
    gain: float
    errors: dict[str, float] = field(default_factory=dict)
    """The error by every measure of :data:`~tactemu.tune.errors.ERRORS` for which the truth has a value."""

    @property
    def cpu_share(self) -> float:
        """The share of one core that the loop uses."""
        return self.cost.cpu_share(self.pace.rate_hz, self.pace.dt)

    @property
    def lost_share(self) -> float:
        """The share of samples that the device misses because of slow steps."""
        return self.cost.lost_share(self.pace.rate_hz, self.pace.dt)

    @property
    def keeps_rate(self) -> bool:
        """True if the loop keeps the rate."""
        return self.cost.keeps_rate(self.pace.rate_hz, self.pace.dt)

    @property
    def cost_us(self) -> float:
        """The cost of one sample, including its share of the steps."""
        return 1e6 * self.cpu_share / self.pace.rate_hz

    def __str__(self) -> str:
        gain = "" if self.gain == 1.0 else f", strength x {self.gain:.3g}"
        misses = self.lost_share > MAX_LOST_SHARE
        lost = f", {self.lost_share:.0%} of the samples lost behind slow steps" if misses else ""
        step = f"a step {self.cost.step_us:.0f} µs, a sample {self.cost.sample_us:.0f} µs"
        return (
            f"{self.setting.name}: {self.cpu_share:.2g} of a core ({step}){lost}, error {100 * self.error:.2g} %{gain}"
        )


@dataclass(frozen=True)
class Choice:
    """The chosen setting of one skin, and its alternatives."""

    skin: str
    truth: str
    pace: Pace
    line_hz: float | None
    """The samples per second that its wire carries, if fewer than the required rate; else None."""
    chosen: Measured
    cheaper: Measured | None
    """The most accurate of the faster settings."""
    finer: Measured | None
    """The fastest of the more accurate settings."""
    all: tuple[Measured, ...]
    criterion: Criterion
    """The measures of the errors by which it was chosen."""

    @property
    def keeps_rate(self) -> bool:
        """True if the loop keeps the rate with the chosen setting."""
        return self.chosen.keeps_rate


def pick(
    skin: str, truth: str, pace: Pace, line_hz: float | None, measured: list[Measured], criterion: Criterion
) -> Choice:
    """Return the most accurate setting that keeps the rate, else of the fastest; the cheapest of equal ones."""
    among = [entry for entry in measured if entry.keeps_rate] or _fastest(measured)
    least = min(entry.error for entry in among)
    chosen = min((e for e in among if e.error <= ALIKE * least), key=lambda e: e.cpu_share)
    faster = [e for e in measured if AS_FAST * e.cpu_share < chosen.cpu_share]
    better = [e for e in measured if e.error * ALIKE < chosen.error]
    return Choice(
        skin=skin,
        truth=truth,
        pace=pace,
        line_hz=line_hz,
        chosen=chosen,
        cheaper=min(faster, key=lambda e: e.error, default=None),
        finer=min(better, key=lambda e: e.cpu_share, default=None),
        all=tuple(sorted(measured, key=lambda e: e.cpu_share)),
        criterion=criterion,
    )


def _fastest(measured: Sequence[Measured]) -> list[Measured]:
    """Return the settings that cost the least or as little, without those that lose many more samples."""
    alike = [entry for entry in measured if entry.cpu_share <= AS_FAST * min(each.cpu_share for each in measured)]
    kept = 1 - min(entry.lost_share for entry in alike)
    return [entry for entry in alike if AS_FAST * (1 - entry.lost_share) >= kept]


def report_choice(choice: Choice, report: Callable[[str], None]) -> None:
    """Report the choice in lines of text."""
    rate, steps = choice.pace.rate_hz, 1 / choice.pace.dt
    required = f"{rate:g} samples and {steps:g} steps a second, at most {MAX_CPU_SHARE:g} of a core"
    report(f"skin {choice.skin}: {required}")
    _report_criterion(choice, report)
    for entry in choice.all:
        report(f"  {'>' if entry is choice.chosen else ' '} {entry}")
    if choice.keeps_rate:
        report(f"chosen: {choice.chosen}")
    else:
        report(f"no setting keeps {rate:g} Hz here. {_next_step(choice)}")
        report(f"chosen, as the most accurate of the {len(_fastest(choice.all))} fastest: {choice.chosen}")
    report("  its errors: " + ", ".join(f"{name} {100 * error:.2g} %" for name, error in choice.chosen.errors.items()))
    if choice.line_hz is not None:
        report(f"the line carries {choice.line_hz:.0f} Hz of it at its speed, and drops the rest, whatever the model")
    if choice.cheaper is not None:
        report(f"if that is too slow: {choice.cheaper}")
    if choice.finer is not None:
        report(f"more accurate{'' if choice.finer.keeps_rate else ', too slow here'}: {choice.finer}")


def _next_step(choice: Choice) -> str:
    """Return what a user may do if no setting keeps the rate."""
    cost, dt = choice.chosen.cost, choice.pace.dt
    if highest := cost.highest_rate_hz(dt):
        return f"The chosen one keeps {highest:g} Hz: ask for that (--rate {highest:g}), or use a faster machine"
    longer = 1e-3 * ceil(1e-3 * cost.step_us / MAX_CPU_SHARE)
    return f"The steps alone are too much for it: raise dt to {longer:g} s, and ask again"


def _report_criterion(choice: Choice, report: Callable[[str], None]) -> None:
    """Report the measures of the error and, if they follow the scene, the reasons."""
    measures, reasons = choice.criterion.measures, choice.criterion.reasons
    if not reasons:
        report(f"  error: {'; '.join(ERRORS[name] for name in measures)}; truth: {choice.truth}")
        return
    largest = "the largest of " if len(measures) > 1 else ""
    report(f"  error: {largest}{', '.join(measures)}, as the scene shows (--error chooses one); truth: {choice.truth}")
    for name, reason in reasons.items():
        report(f"    {name}: {ERRORS[name]}; {'judged' if name in measures else 'not judged'}, {reason}")


def as_dict(choice: Choice) -> dict[str, Any]:
    """Return the choice as a dictionary for JSON."""

    def entry(measured: Measured | None) -> dict[str, Any] | None:
        if measured is None:
            return None
        setting, cost = measured.setting, measured.cost
        return {
            "name": setting.name, "model": setting.model, "dials": dict(setting.options), "dtype": setting.dtype,
            "load": measured.cpu_share, "lost": measured.lost_share, "cost_us": measured.cost_us,
            "step_us": cost.step_us, "late_us": cost.late_us, "sample_us": cost.sample_us, "gain": measured.gain,
            "error": measured.error, "errors": measured.errors,
        }  # fmt: skip

    return {
        "skin": choice.skin, "truth": choice.truth, "rate_hz": choice.pace.rate_hz, "dt": choice.pace.dt,
        "line_hz": choice.line_hz, "keeps_rate": choice.keeps_rate,
        "highest_rate_hz": choice.chosen.cost.highest_rate_hz(choice.pace.dt),
        "judged_by": list(choice.criterion.measures), "reasons": dict(choice.criterion.reasons),
        "chosen": entry(choice.chosen), "cheaper": entry(choice.cheaper), "finer": entry(choice.finer),
        "all": [entry(measured) for measured in choice.all],
    }  # fmt: skip
