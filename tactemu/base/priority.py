"""The loop goes before other programs: Linux's real-time scheduling, for whoever may have it."""

from __future__ import annotations

import os
import sys

from tactemu.base.errors import TactemuError

_LEAST = 1
"""Of the priorities from 1 to 99: above every ordinary program, below all that the machine's owner has raised."""
_SWITCH_S = 0.0005
"""How long another thread of this process keeps the interpreter when the loop wants it; Python's own: 5 ms."""


def enable_realtime_priority() -> None:
    """From now on this process, and threads that it makes, run as soon as they have something to do.

    Raises:
        TactemuError: this machine or user has no such right.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise TactemuError("--preempt: this system has no real-time scheduling")
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_LEAST))
    except PermissionError:
        raise TactemuError(
            "--preempt: this user may not go before other programs; run as root, or allow it once: add the line "
            f"'{os.environ.get('USER', 'USER')} - rtprio 1' to /etc/security/limits.conf and log in again"
        ) from None
    sys.setswitchinterval(_SWITCH_S)


def may_go_first() -> bool:
    """Whether :func:`enable_realtime_priority` will work."""
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_LEAST))
        os.sched_setscheduler(0, *before)
    except (AttributeError, PermissionError):
        return False
    return True
