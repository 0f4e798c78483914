"""Our own side's share of what a driver seems to be late by, so that no driver is accused of it."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import NamedTuple

from tactemu.judge.processes import queued_ns
from tactemu.judge.trial_record import TrialRecord


class SchedulingDelay(NamedTuple):
    """One look at the machine."""

    t: int
    overslept_ns: int
    """Time by which the thread that reads the driver's rows came late."""
    queued_ns: int
    """Time for which the driver's processes were ready to run and no processor was free, in all."""


MOST_QUEUED = 3.0
"""Multiple of a waiting time by which it may be prolonged on a busy machine."""


class DriverTimeout:
    """A time to wait for the driver, longer by the time for which it and this process wait for a processor.

    Args:
        seconds: on a machine that is not busy.
    """

    def __init__(self, seconds: float):
        self.seconds = seconds
        self._began, self._queued_ns = time.monotonic(), queued_ns(os.getpid())

    def is_over(self) -> bool:
        """Return True once the time has passed."""
        more = time.monotonic() - self._began - self.seconds
        if more <= 0.0:
            return False
        queued_s = (queued_ns(os.getpid()) - self._queued_ns) / 1e9  # the driver is a descendant of this process
        return more > min(queued_s, MOST_QUEUED * self.seconds)


def late_ms(record: TrialRecord, delays: Sequence[SchedulingDelay]) -> float:
    """Return the delay of a row for which the driver is not to blame [ms].

    It is the largest of: the lateness of the emulator's loop with the frames, the lateness of the thread that reads
    the rows, both but for one in a hundred, and the time for which the driver had to wait for a processor, per row.
    """
    during = [delay for delay in delays if record.on <= delay.t <= record.end]
    overslept = sorted(delay.overslept_ns for delay in during)
    own = overslept[len(overslept) * 99 // 100] / 1e6 if overslept else 0.0
    return max(_loop_ms(record), own, _queued_ms(record, during))


def _loop_ms(record: TrialRecord) -> float:
    """Return the lateness of the emulator's loop with its frames, beyond the quickest [ms]."""
    at = {sample.number: sample.t for sample in record.samples}
    waits = sorted(
        f.t - at[f.sample]
        for f in record.frames
        if f.way == "tx" and not f.answer and f.sample in at and f.t >= record.on and record.on
    )
    return (waits[len(waits) * 99 // 100] - waits[0]) / 1e6 if waits else 0.0


def _queued_ms(record: TrialRecord, during: Sequence[SchedulingDelay]) -> float:
    """Return the driver's waiting for a processor, per row [ms]."""
    if len(during) < 2:
        return 0.0
    rows = sum(during[0].t < printed.t <= during[-1].t for printed in record.rows)
    return max(0, during[-1].queued_ns - during[0].queued_ns) / 1e6 / max(1, rows)
