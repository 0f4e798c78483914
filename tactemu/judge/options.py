"""JudgeOptions of a run of the judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactemu.judge.outcome import FAILING

START_S = 15.0
"""Default time for a driver to be imported, to connect and to print a row [s]."""
PATIENCE_S = 1.5
"""Default time for a driver to recover after a fault [s]."""


@dataclass
class JudgeOptions:
    """The options of a run of the judge."""

    no_contact_s: float = 1.0
    """Time without loads after the first row, in which drivers tare [s]."""
    seed: int = 0
    budget_s: float | None = None
    """Time for the whole run [s]; None: no limit."""
    every: bool = False
    """True: try every position of a frame; False: only some of those of values."""
    fail_on: Sequence[str] = FAILING
    shrink: bool = True
    """True: repeat trials with findings, and search for the smallest case."""
    only: Sequence[str] = ()
    """Names of the trials to run after the one without faults, or words of them; empty: all trials."""
    columns: Path | None = None
    """File of the columns: read if it exists, written otherwise."""
    record: Path | None = None
    """Folder for the trial records."""
    patience_s: float = PATIENCE_S
    start_s: float = START_S
    """Time for the driver to print its first row [s]."""
    device_options: Mapping[str, Any] = field(default_factory=dict)
    port: str | Mapping[str, str] | None = None
    rate_hz: float | None = None
