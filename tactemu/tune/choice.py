"""Which setting is taken, of all that were measured, and how that is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tactemu.tune.cost import MOST_LOAD, MOST_LOST, Cost
from tactemu.tune.settings import Setting

ERRORS = {
    "taxels": "RMS over all taxels and moments, relative to the truth's",
    "total": "of the sum over the skin, RMS over moments, relative to the truth's",
    "worst": "largest of any taxel, relative to the largest of the truth",
}
ALIKE = 1.05
"""Errors within this factor are alike: the cheaper setting is taken."""


@dataclass(frozen=True)
class Pace:
    """What is asked of every setting."""

    rate_hz: float
    """Samples per second of every skin."""
    dt: float
    """The scene's time step [s]."""


@dataclass(frozen=True)
class Measured:
    """A setting, what it costs and how wrong it is."""

    setting: Setting
    cost: Cost
    pace: Pace
    error: float
    """By the measure asked for."""
    gain: float
    errors: dict[str, float] = field(default_factory=dict)
    """By every measure of :data:`ERRORS`."""

    @property
    def load(self) -> float:
        """Part of one core that the loop is busy."""
        return self.cost.load(self.pace.rate_hz, self.pace.dt)

    @property
    def lost(self) -> float:
        """Part of the samples that slow steps make the device miss."""
        return self.cost.lost(self.pace.rate_hz, self.pace.dt)

    @property
    def keeps_rate(self) -> bool:
        """Does the loop keep the rate?"""
        return self.cost.keeps(self.pace.rate_hz, self.pace.dt)

    @property
    def cost_us(self) -> float:
        """Of one sample, the steps that it needs included."""
        return 1e6 * self.load / self.pace.rate_hz

    def __str__(self) -> str:
        gain = "" if self.gain == 1.0 else f", strength x {self.gain:.3g}"
        lost = f", {self.lost:.0%} of the samples lost behind slow steps" if self.lost > MOST_LOST else ""
        step = f"a step {self.cost.step_us:.0f} µs, a sample {self.cost.sample_us:.0f} µs"
        return f"{self.setting.name}: {self.load:.2g} of a core ({step}){lost}, error {100 * self.error:.2g} %{gain}"


@dataclass(frozen=True)
class Choice:
    """What was found for one skin."""

    skin: str
    truth: str
    pace: Pace
    line_hz: float | None
    """Samples per second that its wire carries, where that is less than what is asked for."""
    chosen: Measured
    cheaper: Measured | None
    """The next best among the faster ones."""
    finer: Measured | None
    """The fastest among the more accurate ones."""
    all: tuple[Measured, ...]

    @property
    def keeps_rate(self) -> bool:
        """Does the loop keep the rate with the setting chosen?"""
        return self.chosen.keeps_rate


def pick(skin: str, truth: str, pace: Pace, line_hz: float | None, measured: list[Measured]) -> Choice:
    """Return the most accurate setting that keeps the rate, the cheapest of those that are alike; else the fastest."""
    fitting = [entry for entry in measured if entry.keeps_rate]
    if fitting:
        least = min(entry.error for entry in fitting)
        chosen = min((e for e in fitting if e.error <= ALIKE * least), key=lambda e: e.load)
    else:
        chosen = min(measured, key=lambda e: e.load)
    faster = [e for e in measured if e.load < chosen.load and e is not chosen]
    better = [e for e in measured if e.error * ALIKE < chosen.error]
    return Choice(
        skin=skin,
        truth=truth,
        pace=pace,
        line_hz=line_hz,
        chosen=chosen,
        cheaper=min(faster, key=lambda e: e.error, default=None),
        finer=min(better, key=lambda e: e.load, default=None),
        all=tuple(sorted(measured, key=lambda e: e.load)),
    )


def say(choice: Choice, error: str, report: Callable[[str], None]) -> None:
    """Tell it in lines of text."""
    rate, steps = choice.pace.rate_hz, 1 / choice.pace.dt
    asked = f"{rate:g} samples and {steps:g} steps a second, at most {MOST_LOAD:g} of a core"
    report(f"skin {choice.skin}: {asked}")
    report(f"  error: {ERRORS[error]}; truth: {choice.truth}")
    for entry in choice.all:
        report(f"  {'>' if entry is choice.chosen else ' '} {entry}")
    if choice.keeps_rate:
        report(f"chosen: {choice.chosen}")
    else:
        report(f"no setting keeps {rate:g} Hz here; the fastest is {choice.chosen}. Lower the rate, or raise dt")
    if choice.line_hz is not None:
        report(f"the line carries {choice.line_hz:.0f} Hz of it at its speed, and drops the rest, whatever the model")
    if choice.cheaper is not None:
        report(f"if that is too slow: {choice.cheaper}")
    if choice.finer is not None:
        report(f"more accurate{'' if choice.finer.keeps_rate else ', too slow here'}: {choice.finer}")


def as_dict(choice: Choice) -> dict[str, Any]:
    """For JSON."""

    def entry(measured: Measured | None) -> dict[str, Any] | None:
        if measured is None:
            return None
        setting, cost = measured.setting, measured.cost
        return {
            "name": setting.name, "model": setting.model, "dials": setting.dials, "dtype": setting.dtype,
            "load": measured.load, "lost": measured.lost, "cost_us": measured.cost_us, "step_us": cost.step_us,
            "late_us": cost.late_us, "sample_us": cost.sample_us, "gain": measured.gain,
            "error": measured.error, "errors": measured.errors,
        }  # fmt: skip

    return {
        "skin": choice.skin, "truth": choice.truth, "rate_hz": choice.pace.rate_hz, "dt": choice.pace.dt,
        "line_hz": choice.line_hz, "keeps_rate": choice.keeps_rate,
        "chosen": entry(choice.chosen), "cheaper": entry(choice.cheaper), "finer": entry(choice.finer),
        "all": [entry(measured) for measured in choice.all],
    }  # fmt: skip
