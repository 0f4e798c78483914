"""The settings of a loop's thread and process that make it late by microseconds rather than milliseconds.

None needs a privilege, none keeps a processor busy, and all are restored when the loop ends:

* Timer slack of 1 ns: the kernel delays what waits with a timeout by 50 µs otherwise, such as a wait for Python's
  interpreter.
* A time slice of 0.1 ms (Linux 6.12): the scheduler runs a thread that wakes up the sooner, the less it asks for.
* A switch interval of 0.1 ms: another thread of the process keeps the interpreter for 5 ms otherwise.
* No full garbage collections (:mod:`tactemu.base.gc_tuning`).
"""

from __future__ import annotations

import ctypes
import gc
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from tactemu.base.gc_tuning import no_full_collections
from tactemu.base.shared_setting import SharedSetting

_SWITCH_INTERVAL_S = 1e-4
"""Longest time that another thread of this process keeps the interpreter from the loop; Python's default is 5 ms."""
_TIMER_SLACK_NS = 1
SLICE_NS = 100_000
"""The shortest time slice that Linux gives."""
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_SET_SCHEDULING, _GET_SCHEDULING = {"x86_64": (314, 315), "aarch64": (274, 275)}.get(platform.machine(), (0, 0))
"""The numbers of the system calls ``sched_setattr`` and ``sched_getattr``, for which most C libraries have no
function."""

_short_switch_interval = SharedSetting(
    sys.getswitchinterval, sys.setswitchinterval, lambda before: min(before, _SWITCH_INTERVAL_S)
)


class _Scheduling(ctypes.Structure):
    """``struct sched_attr``."""

    _fields_ = (
        ("size", ctypes.c_uint32), ("policy", ctypes.c_uint32), ("flags", ctypes.c_uint64), ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32), ("runtime", ctypes.c_uint64), ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )  # fmt: skip


@contextmanager
def low_latency() -> Iterator[None]:
    """Make the calling thread wake up on time inside the ``with`` block, as far as every user may."""
    gc.collect(1)  # the first collection of what was built takes 1.5 ms, a sample at 1 kHz
    with ExitStack() as undo:
        undo.enter_context(no_full_collections)
        undo.enter_context(_short_switch_interval)
        slack, slice_ns = timer_slack_ns(), time_slice_ns()
        if slack:
            set_timer_slack(_TIMER_SLACK_NS)
            undo.callback(set_timer_slack, slack)
        if slice_ns:
            set_time_slice(SLICE_NS)
            undo.callback(set_time_slice, slice_ns)
        yield


def timer_slack_ns() -> int:
    """Return the timer slack of the calling thread [ns]; 0 if unknown, or for one with real-time priority."""
    return max(0, ctypes.PyDLL(None).prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))


def set_timer_slack(slack_ns: int) -> None:
    """Set the timer slack of the calling thread; on a system without it this does nothing."""
    ctypes.PyDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0)


def time_slice_ns() -> int:
    """Return the time slice that the calling thread asks the scheduler for [ns]; 0 if unknown, or for one with
    real-time priority."""
    scheduling = _scheduling()
    return scheduling.runtime if scheduling is not None else 0


def set_time_slice(slice_ns: int) -> None:
    """Ask the scheduler for a time slice of the calling thread. On a kernel before 6.12, and for a thread with
    real-time priority, this does nothing."""
    scheduling = _scheduling()
    if scheduling is not None:
        scheduling.runtime = slice_ns
        ctypes.PyDLL(None).syscall(_SET_SCHEDULING, 0, ctypes.byref(scheduling), 0)


def _scheduling() -> _Scheduling | None:
    """Return the scheduling of the calling thread; None if unknown, or for one with real-time priority."""
    scheduling = _Scheduling(size=ctypes.sizeof(_Scheduling))
    is_known = _GET_SCHEDULING and not ctypes.PyDLL(None).syscall(
        _GET_SCHEDULING, 0, ctypes.byref(scheduling), scheduling.size, 0
    )
    return scheduling if is_known and scheduling.policy == os.SCHED_OTHER else None
