"""The time budget of a run: the order of the trials by their value, and the deadline that ends them."""

from __future__ import annotations

import time
from collections.abc import Sequence

from tactemu.judge.plan import Trial

MOST_TELLING_FIRST = (
    "flip", "unplug", "hang", "silence", "drop", "truncate", "replace", "stray", "load", "late", "reset", "lose",
    "wrap", "garbage", "split", "rate", "busoff", "reorder", "halfopen", "stop", "baud", "chunk", "merge", "saturate",
)  # fmt: skip
"""Kinds of fault and actions, in the order of how much they reveal about a driver; all others come after them."""
SHUTDOWN_S = 0.4
"""Time reserved for ending the driver and writing the report [s]."""
EVERY_POSITION_BUDGET_S = 120.0
"""Budget from which every position of a frame is tried [s]."""
EVERY_POSITION_BUDGET = "2m"
"""The same time, as you write it for ``--budget``."""


class BudgetSpentError(Exception):
    """The deadline has passed during a trial."""


def kind_of(trial: Trial) -> str:
    """Return the kind of a trial's first fault, or its action."""
    return trial.faults[0].word if trial.faults else trial.action


def ordered(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials sorted by the value of their kinds, with one trial of each kind before any second one.

    Trials that are skipped from the beginning come last.
    """
    seen: dict[str, int] = {}

    def rank(trial: Trial) -> tuple[bool, int, int]:
        kind = kind_of(trial)
        turn = seen[kind] = seen.get(kind, -1) + (not trial.skipped)
        return (
            bool(trial.skipped),
            turn,
            MOST_TELLING_FIRST.index(kind) if kind in MOST_TELLING_FIRST else len(MOST_TELLING_FIRST),
        )

    return sorted(trials, key=rank)  # it calls `rank` once for each trial, in the order of the plan


class Budget:
    """The deadline of a run, and the measured duration of trials compared with the expected one.

    Args:
        seconds: time from now to the deadline; None: no limit.
    """

    def __init__(self, seconds: float | None):
        self.seconds = seconds
        self._end = float("inf") if seconds is None else time.monotonic() + seconds - SHUTDOWN_S
        self._limit = float("inf")
        """Monotonic time at which the current trial is ended [s]."""
        self._expected, self._took = 0.0, 0.0

    @property
    def left_s(self) -> float:
        """Time until the deadline [s]."""
        return self._end - time.monotonic()

    def expected_s(self, seconds: float) -> float:
        """Return the likely duration of trials planned for ``seconds``, scaled as the earlier ones were slower [s]."""
        return seconds * max(1.0, self._took / self._expected if self._expected else 1.0)

    def lacks(self, seconds: float, times: int = 1) -> str:
        """Return why trials planned for ``seconds``, repeated ``times``, exceed the budget; empty if they fit."""
        if self.seconds is None:
            return ""
        takes, left = self.expected_s(seconds), self.left_s
        if takes * times <= left:
            return ""
        again = " and may have to be repeated" if times > 1 else ""
        return f"takes {takes:.1f} s{again}, {max(left, 0):.1f} s of the budget are left"

    def begin(self, reserve_s: float = 0.0) -> None:
        """Make :meth:`sleep` raise from ``reserve_s`` before the deadline on."""
        self._limit = self._end - reserve_s
        self.sleep(0.0)

    def end(self, expected_s: float = 0.0, took_s: float = 0.0) -> None:
        """Stop :meth:`sleep` from raising, and record the expected and the real duration of the trial."""
        self._limit = float("inf")
        self._expected, self._took = self._expected + expected_s, self._took + took_s

    def sleep(self, seconds: float) -> None:
        """Sleep, unless the deadline comes first.

        Raises:
            BudgetSpentError: the deadline has passed, or would pass during the sleep.
        """
        if time.monotonic() + seconds > self._limit:
            raise BudgetSpentError
        if seconds > 0:
            time.sleep(seconds)
