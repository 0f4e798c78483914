"""Delays that our own processes or a busy machine cause, so that no driver is blamed for them."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import NamedTuple

from tactemu.judge.processes import queued_ns
from tactemu.judge.trial_record import TrialRecord


class SchedulingDelay(NamedTuple):
    """One measurement of scheduling delays."""

    t_ns: int
    overslept_ns: int
    """Time by which the thread that reads the driver's rows woke up late."""
    queued_ns: int
    """Total time for which the driver's processes were ready to run and waited for a processor."""


MAX_EXTENSION = 3.0
"""Largest extension of a timeout on a busy machine, as a multiple of it."""


class DriverTimeout:
    """A timeout for the driver, extended by the time for which it and this process wait for a processor.

    Args:
        seconds: the timeout on an idle machine.
    """

    def __init__(self, seconds: float):
        self.seconds = seconds
        self._began, self._queued_ns = time.monotonic(), queued_ns(os.getpid())

    def is_over(self) -> bool:
        """Return True once the timeout has passed."""
        more = time.monotonic() - self._began - self.seconds
        if more <= 0.0:
            return False
        queued_s = (queued_ns(os.getpid()) - self._queued_ns) / 1e9  # the driver is a descendant of this process
        return more > min(queued_s, MAX_EXTENSION * self.seconds)


def late_ms(record: TrialRecord, delays: Sequence[SchedulingDelay]) -> float:
    """Return the delay of a row for which the driver is not to blame [ms].

    It is the largest of three: the lateness of the emulator's loop with the frames and that of the thread that reads
    the rows, each as its 99th percentile, and the time per row for which the driver waited for a processor.
    """
    during = [delay for delay in delays if record.on <= delay.t_ns <= record.end]
    overslept = sorted(delay.overslept_ns for delay in during)
    own = overslept[len(overslept) * 99 // 100] / 1e6 if overslept else 0.0
    return max(_loop_ms(record), own, _queued_ms(record, during))


def _loop_ms(record: TrialRecord) -> float:
    """Return the lateness of the emulator's loop with its frames, compared with the earliest frame [ms]."""
    at = {sample.number: sample.t_ns for sample in record.samples}
    waits = sorted(
        f.t_ns - at[f.sample]
        for f in record.frames
        if f.kind == "tx" and not f.is_answer and f.sample in at and f.t_ns >= record.on and record.on
    )
    return (waits[len(waits) * 99 // 100] - waits[0]) / 1e6 if waits else 0.0


def _queued_ms(record: TrialRecord, during: Sequence[SchedulingDelay]) -> float:
    """Return the time per row for which the driver waited for a processor [ms]."""
    if len(during) < 2:
        return 0.0
    rows = sum(during[0].t_ns < printed.t_ns <= during[-1].t_ns for printed in record.rows)
    return max(0, during[-1].queued_ns - during[0].queued_ns) / 1e6 / max(1, rows)
