"""The choice of trials by ``--only``: names that no plan can have are refused before anything is run."""

from __future__ import annotations

from collections.abc import Sequence

from tactemu.base.errors import TactemuError, nearest, no_such
from tactemu.judge import forged_replies
from tactemu.judge.plan import CLEAN, Trial

NAMES = (
    "flipped", "cut", "one cut", "byte lost", "one byte lost", "dropped", "burst", "doubled", "garbage", "chunked",
    "split", "merged", "late", "reordered", "late answer", *forged_replies.NAMES, "another answer", "requests damaged",
    "requests lost", "foreign frames", "busy bus", "error frames", "bus off", "old frame", "slow reader", "silence",
    "hang", "unplug", "half open", "wrong baud", "reset", "counter wraps", "saturated", "dead taxel", "half the rate",
    "high rate", "memory",
)  # fmt: skip
"""Names of the trials of all plans; a device's counters and clocks add trials such as "tick wraps"."""


def check_names(names: Sequence[str]) -> None:
    """Raise TactemuError for a name of --only that no plan can have, before anything is run."""
    for name in names:
        words = {*name.split()}
        if name != CLEAN and not any(words <= {*each.split()} for each in NAMES) and "wraps" not in words:
            raise TactemuError(f"--only: {no_such('trial', name, NAMES)}")


def chosen(trials: Sequence[Trial], names: Sequence[str]) -> list[Trial]:
    """Return the trials of these names: exactly so, else all whose names have these words.

    For a name that is none, as on another line, there is a trial that says so and is skipped.
    """
    wanted, unknown = set(), []
    for name in names:
        known = [trial.name for trial in trials]
        found = {name} & {*known} or {each for each in known if {*name.split()} <= {*each.split()}}
        if not found and name != CLEAN:
            about = f"there is no trial of this name here{nearest(name, known)}"
            unknown.append(Trial(name, "named in --only", skipped=about))
        wanted |= found
    return [*(trial for trial in trials if trial.name in wanted), *unknown]
