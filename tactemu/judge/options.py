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
"""Default time for a driver to read well again after a fault [s]."""


@dataclass
class JudgeOptions:
    """The way in which a driver is judged."""

    no_contact_s: float = 1.0
    """Time without contact after the first row [s]: drivers tare."""
    seed: int = 0
    budget_s: float | None = None
    """Time for the whole run [s]; None: no limit."""
    every: bool = False
    """Try every position of a frame, not only some of the values'."""
    fail_on: Sequence[str] = FAILING
    shrink: bool = True
    """Repeat trials with findings, and look for the smallest case."""
    only: Sequence[str] = ()
    """Trials whose names contain one of these words."""
    columns: Path | None = None
    record: Path | None = None
    """Folder for the recorded trials."""
    patience_s: float = PATIENCE_S
    start_s: float = START_S
    """Time for the driver to print its first row [s]."""
    device_options: Mapping[str, Any] = field(default_factory=dict)
    port: str | Mapping[str, str] | None = None
    rate_hz: float | None = None
