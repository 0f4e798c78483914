"""Outcomes of trials, and the facts from the run without faults, as plain data."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

ABOUT = {
    "wrong": "silent wrong values",
    "stale": "stale",
    "lost sync": "lost sync",
    "died": "died",
    "silent": "prints nothing",
    "late": "late",
    "leaks": "leaks",
    "blocks": "blocks",
    "spins": "spins",
    "collateral": "collateral loss",
    "loses": "loses readings",
    "again": "again or out of order",
    "order": "axes exchanged",
    "scale": "another scale",
    "clipped": "clipped or flat",
    "unread": "channels unread",
    "floods": "floods",
    "unlearned": "cannot be told",
}
"""Kinds of finding, worst first, with their titles in the reports."""
FAILING = ("wrong", "stale", "lost sync", "died", "silent", "clipped", "floods", "unlearned")
"""Kinds of finding that fail a run unless ``--fail-on`` names others."""


def titles(kinds: Sequence[str] = FAILING) -> str:
    """Return the titles of kinds of finding, as a list for a sentence."""
    return ", ".join(ABOUT[kind] for kind in kinds)


@dataclass(frozen=True)
class Finding:
    """A defect of the driver, as one trial shows it."""

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{ABOUT[self.kind]}: {self.text}" if self.text else ABOUT[self.kind]


@dataclass
class CleanRun:
    """The facts from the run without faults."""

    asks: bool = False
    """True if the driver polls the device; False if the device streams."""
    period_ms: float = 10.0
    """Period of the device's samples [ms]."""
    row_ms: float = 10.0
    """Median time from row to row [ms]."""
    p50_ms: float = 0.0
    """Median latency of a row [ms]."""
    p99_ms: float = 0.0
    """99th percentile of the latency [ms]."""
    keeps: bool = True
    """True if the driver hands out every sample, so that a lost one counts."""
    repeats: bool = False
    """True if the driver hands out readings more than once without any fault."""
    behind: int = 0
    """Number of samples by which a row may be older than its question, for a driver that polls."""
    ask_ms: float = 0.0
    """Time from question to row, 10th percentile, for a driver that polls [ms]."""
    numbered: bool = False
    """True if frames carry a number or a time, by which a driver can recognise old ones."""
    usual: list[str] = field(default_factory=list)
    """Messages that the driver prints without any fault, with digits replaced."""


@dataclass
class Outcome:
    """The outcome of a trial."""

    name: str
    why: str = ""
    findings: list[Finding] = field(default_factory=list)
    verdict: str = ""
    """The findings in one line, or another result such as ``right``."""
    injected: int = 0
    rows: int = 0
    right: int = 0
    wrong: int = 0
    marked: int = 0
    again: int = 0
    older: int = 0
    stale: int = 0
    behind: int = 0
    """Number of rows that answer an earlier question, for a driver that polls."""
    lost: int = 0
    """Number of undamaged samples that were sent and never handed out, although earlier and later ones were."""
    sent: int = 0
    """Number of samples that were sent."""
    notes: int = 0
    """Number of messages that the driver does not print without a fault."""
    said: list[str] = field(default_factory=list)
    """The first of these messages."""
    p50_ms: float | None = None
    p99_ms: float | None = None
    worst_ms: float | None = None
    age_ms: float | None = None
    """Median age of the samples, for a driver that polls [ms]."""
    waits_ms: list[float] = field(default_factory=list)
    """Latency of every right row [ms]."""
    recovered_s: float | None = None
    """Time from the end of the fault to the recovery [s]; None: there was none."""
    quiet_s: float = 0.0
    """The longest time without a row or a message during the fault [s]."""
    cpu: float = 0.0
    """Processor time of the driver during the fault, as a share of a core."""
    leak: float = 0.0
    """Growth of the memory for each reading [byte]."""
    grown: int = 0
    """Growth of the memory from before the fault until the recovery [byte]."""
    bad: list[dict[str, Any]] = field(default_factory=list)
    """The first wrong rows, each with its nearest sample."""
    seconds: float = 0.0
    """Duration of the trial [s]."""
    confirmed: bool | None = None
    """True if a second run confirms the findings, False if it does not; ``None``: there was none."""
    untried: str = ""
    """The reason why there was no second run, although findings do not count without one."""
    skipped: str = ""
    """The reason why the trial was not tried."""
    lacks_time: bool = False
    """True if it was not tried because the budget was spent."""
    remark: str = ""
    """A reason for the wrong values that is not the driver's."""
    case: dict[str, Any] | None = None
    """The smallest case, from :mod:`tactemu.judge.smallest_case`."""

    def has(self, *kinds: str) -> bool:
        """Return True if there is a finding of one of these kinds."""
        return any(finding.kind in kinds for finding in self.findings)

    def seen_again(self, other: Outcome, kinds: Collection[str]) -> None:
        """Keep of the findings of these kinds only those that another run of the trial confirms, if it confirms any."""
        came = {finding.kind for finding in other.findings}
        self.confirmed = any(finding.kind in came for finding in self.findings if finding.kind in kinds)
        if self.confirmed:
            self.findings = [each for each in self.findings if each.kind in came or each.kind not in kinds]
            self.verdict = "; ".join(map(str, self.findings))

    @property
    def doubt(self) -> str:
        """The reason why its findings do not count, for the reports; empty where they do."""
        return f" (not counted: {self.untried or 'a second run did not show it'})" if self.confirmed is False else ""

    def fails(self, kinds: Sequence[str]) -> bool:
        """Return True if a finding of these kinds counts, so that the run fails."""
        return self.has(*kinds) and self.confirmed is not False

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON data."""
        return asdict(self)
