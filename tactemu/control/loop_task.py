"""What one thread has the loop do, in the loop's own thread, and waits for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from tactemu.base.clock import Clock, LockstepClock
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Simulated

LOOK_AGAIN_NS = 1_000_000


class Loop(Protocol):
    """What an errand asks of an emulator, or of a recording that is played."""

    now_ns: int
    clock: Clock

    @property
    def simulation(self) -> Simulated | None:
        """What is brought up to each sample's time, if anything is simulated."""
        ...

    @property
    def channels(self) -> Sequence[Channel]:
        """The devices."""
        ...

    @property
    def is_settled(self) -> bool:
        """Whether everything that is due in this turn has been done."""
        ...

    def call(self, action: Callable[[], None], at_ns: int = 0) -> None:
        """Have ``action`` run at the end of a turn, not before ``at_ns``. Safe from any thread."""
        ...


@dataclass(frozen=True)
class TaskResult:
    """Of something that has begun."""

    done_ns: int = 0
    """When it will be done; past: it is."""
    result: Any = None
    """What it gives, or a function that whoever waits calls for it: what takes long is no work for the loop."""
    until_sampled: bool = False
    """It is done when every device, beside those that are silent, has sampled the scene of that time."""
    until_settled: bool = False
    """It is done when nothing else is due by then."""


class LoopTask:
    """Has the loop call ``begin()``; it is done when its outcome says, or when it fails.

    Args:
        emulator: runs in another thread.
        begin: moves a body, schedules an event ...
        changes: it changes something, and so begins when the simulation is not ahead of the clock.
        tell: called in the loop when it is done; must be quick.
    """

    def __init__(
        self,
        emulator: Loop,
        begin: Callable[[], TaskResult],
        *,
        changes: bool = True,
        tell: Callable[[LoopTask], None] | None = None,
    ):
        self.done = threading.Event()
        self.outcome = TaskResult()
        self.failed: Exception | None = None
        self.t_ns = 0
        """When it was done."""
        self._emulator, self._begin, self._changes, self._tell = emulator, begin, changes, tell
        emulator.call(self._run)

    def result(self) -> Any:
        """What it gives.

        Raises:
            Exception: what went wrong in it.
        """
        if self.failed is not None:
            raise self.failed
        result = self.outcome.result
        return result() if callable(result) else result

    def _run(self) -> None:
        emulator = self._emulator
        simulation = emulator.simulation
        if self._changes and simulation is not None and simulation.time_ns > emulator.now_ns:
            emulator.call(self._run, simulation.time_ns)
            return
        try:
            self.outcome = self._begin()
        except Exception as error:  # a mistake of the caller's: for whoever waits to raise
            self.failed = error
            self._finish()
            return
        if self.outcome.done_ns <= emulator.now_ns and not (self.outcome.until_sampled or self.outcome.until_settled):
            self._finish()
        else:
            emulator.call(self._arrive, self.outcome.done_ns)

    def _arrive(self) -> None:
        """A loop that is late takes its samples after its actions, and the scene that a sample sees may be a step
        older than the sample: look again until one has seen the time."""
        emulator, outcome = self._emulator, self.outcome
        now = emulator.now_ns
        if outcome.until_settled and not emulator.is_settled:
            emulator.call(self._arrive, now)
        elif outcome.until_sampled and not isinstance(emulator.clock, LockstepClock) and self._unseen(now):
            emulator.call(self._arrive, now + LOOK_AGAIN_NS)
        else:
            self._finish()

    def _unseen(self, now: int) -> bool:
        simulation = self._emulator.simulation
        seen = self.outcome.done_ns + (simulation.dt_ns if simulation is not None else 0)
        return any(c.statistics.last_ns < seen and c.silent_until_ns <= now for c in self._emulator.channels)

    def _finish(self) -> None:
        self.t_ns = self._emulator.now_ns
        self.done.set()
        if self._tell is not None:
            self._tell(self)
