"""What one thread has the loop do, in the loop's own thread, and waits for."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tactemu.emulator import Emulator


class Errand:
    """Runs ``begin(now_s)`` in the loop; it is done at the time [s] that ``begin`` returns, or when it fails.

    Args:
        emulator: runs in another thread.
        begin: moves a body, schedules an event ...
        sampled: it is done when every device, beside those that are silent, has sampled the scene of that time.
    """

    def __init__(self, emulator: Emulator, begin: Callable[[float], float], *, sampled: bool):
        self.done = threading.Event()
        self.failed: Exception | None = None
        self._emulator, self._begin, self._sampled = emulator, begin, sampled
        self._step_ns = emulator.simulation.dt_ns if emulator.simulation else 0
        emulator.call(self._run)

    def _run(self) -> None:
        try:
            t_ns = round(self._begin(self._emulator.now_ns / 1e9) * 1e9)
            self._emulator.call(lambda: self._arrive(t_ns), t_ns)
        except Exception as error:  # a mistake of the caller's: for whoever waits to raise
            self.failed = error
            self.done.set()

    def _arrive(self, t_ns: int) -> None:
        """A loop that is late takes its samples after its actions, and the scene that a sample sees may be a step
        older than the sample: look again until one has seen ``t_ns``."""
        now = self._emulator.now_ns
        seen = t_ns + self._step_ns
        late = any(c.statistics.last_ns < seen and c.silent_until_ns <= now for c in self._emulator.channels)
        if self._sampled and late:
            self._emulator.call(lambda: self._arrive(t_ns), now + 1_000_000)
        else:
            self.done.set()
