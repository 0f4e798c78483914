"""The choice of trials by ``--only``: names that no plan can have are refused before anything is run."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_protocols import Can, Tcp
from tactemu.base.errors import TactemuError, nearest, no_such
from tactemu.judge import forged_replies
from tactemu.judge.plan import CLEAN, LineFacts, Plan, Trial
from tactemu.wire.line_models import line_model_for

LINES = (
    LineFacts(),
    LineFacts(asks=True, talks=True),
    LineFacts(line=line_model_for(Tcp(port=1))),
    LineFacts(line=line_model_for(Can())),
)
"""Lines whose plans have all trials between them, except those of forged answers and of a device's own counters."""


def planned_names() -> list[str]:
    """Return the names of all trials, except those of forged answers and of a device's own counters."""
    return list(dict.fromkeys(trial.name for facts in LINES for trial in Plan(facts).trials()))


def check_names(names: Sequence[str]) -> None:
    """Raise TactemuError for a name of --only that no plan can have, before anything is run."""
    if not names:  # plans take a while to make
        return
    known = list(dict.fromkeys((*planned_names(), *forged_replies.NAMES)))
    for name in names:
        words = {*name.split()}
        if name != CLEAN and not any(words <= {*each.split()} for each in known) and "wraps" not in words:
            raise TactemuError(f"--only: {no_such('trial', name, known)}")


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
