"""The real-time scheduling of Linux, which runs the loop before other programs, for users who may use it."""

from __future__ import annotations

import os

from tactemu.base.errors import TactemuError

_MIN_REALTIME_PRIORITY = 1
"""Lowest of the priorities from 1 to 99: above every ordinary program, below other real-time programs."""


def enable_realtime_priority() -> None:
    """Give this process and its future threads real-time scheduling priority.

    Raises:
        TactemuError: the system has no real-time scheduling, or the user has no right to it.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise TactemuError("--preempt: this system has no real-time scheduling")
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_MIN_REALTIME_PRIORITY))
    except PermissionError:
        raise TactemuError(
            "--preempt: you have no right to real-time priority; run as root, or allow it once: add the line "
            f"'{os.environ.get('USER', 'USER')} - rtprio 1' to /etc/security/limits.conf and log in again"
        ) from None


def can_enable_realtime_priority() -> bool:
    """Return True if :func:`enable_realtime_priority` will succeed."""
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_MIN_REALTIME_PRIORITY))
        os.sched_setscheduler(0, *before)
    except (AttributeError, PermissionError):
        return False
    return True
