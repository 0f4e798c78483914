"""A task that another thread gives to the loop, whose own thread runs it, and its result."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tactemu.base.clock import LockstepClock
from tactemu.base.loop import Loop

RECHECK_NS = 1_000_000
"""Interval at which a task checks whether every device has sampled its time."""


@dataclass(frozen=True)
class TaskResult:
    """The result of a task that has begun, and the condition on which it is done."""

    done_ns: int = 0
    """Time at which it is done; a past time: at once."""
    result: Any = None
    """The result, or a function that the waiting thread calls for it, so that a long computation does not stop the
    loop."""
    until_sampled: bool = False
    """True: it is done when every device that is not silent has sampled the scene of that time."""
    until_settled: bool = False
    """True: it is done when nothing else is due by then."""


class LoopTask:
    """A task that calls ``begin()`` in the loop; it is done on the condition of the returned result, or if it fails.

    Args:
        emulator: a loop that runs in another thread.
        begin: moves a body, schedules an event ...
        changes: True for a task that changes the emulator: it begins when the simulation does not lead the clock.
        on_done: called in the loop when the task is done; must be quick.
    """

    def __init__(
        self,
        emulator: Loop,
        begin: Callable[[], TaskResult],
        *,
        changes: bool = True,
        on_done: Callable[[LoopTask], None] | None = None,
    ):
        self.done = threading.Event()
        self.task_result = TaskResult()
        self.failed: Exception | None = None
        self.t_ns = 0
        """Emulation time at which it was done."""
        self._emulator, self._begin, self._changes, self._on_done = emulator, begin, changes, on_done
        emulator.call(self._run)

    def result(self) -> Any:
        """Return the result of the task.

        Raises:
            Exception: the exception that the task raised.
        """
        if self.failed is not None:
            raise self.failed
        result = self.task_result.result
        return result() if callable(result) else result

    def _run(self) -> None:
        emulator = self._emulator
        simulation = emulator.simulation
        if self._changes and simulation is not None and simulation.time_ns > emulator.now_ns:
            emulator.call(self._run, simulation.time_ns)
            return
        try:
            self.task_result = self._begin()
        except Exception as error:  # the caller's mistake: the waiting thread raises it
            self.failed = error
            self._finish()
            return
        result = self.task_result
        if result.done_ns <= emulator.now_ns and not (result.until_sampled or result.until_settled):
            self._finish()
        else:
            emulator.call(self._arrive, self.task_result.done_ns)

    def _arrive(self) -> None:
        """Finish the task if its condition holds, else check again later.

        A late loop takes its samples after its actions, and the scene of a sample may be a step older than the sample:
        so check until every device has sampled the time itself.
        """
        emulator, task_result = self._emulator, self.task_result
        now = emulator.now_ns
        if task_result.until_settled and not emulator.is_settled:
            emulator.call(self._arrive, now)
        elif task_result.until_sampled and not isinstance(emulator.clock, LockstepClock) and self._is_unsampled(now):
            emulator.call(self._arrive, now + RECHECK_NS)
        else:
            self._finish()

    def _is_unsampled(self, now: int) -> bool:
        simulation = self._emulator.simulation
        needed_ns = self.task_result.done_ns + (simulation.dt_ns if simulation is not None else 0)
        return any(c.statistics.last_ns < needed_ns and c.silent_until_ns <= now for c in self._emulator.channels)

    def _finish(self) -> None:
        self.t_ns = self._emulator.now_ns
        self.done.set()
        if self._on_done is not None:
            self._on_done(self)
