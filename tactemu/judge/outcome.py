"""What came of a trial, and what the run without faults has shown: plain data."""

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
"""Kinds of finding, worst first, with the words of the reports."""
FAILING = ("wrong", "stale", "lost sync", "died", "silent", "clipped", "floods", "unlearned")
"""Those that fail a run unless ``--fail-on`` says otherwise."""


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with the driver."""

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{ABOUT[self.kind]}: {self.text}" if self.text else ABOUT[self.kind]


@dataclass
class CleanRun:
    """What the run without faults has shown."""

    asks: bool = False
    """The driver asks for readings; a stream comes by itself."""
    period_ms: float = 10.0
    """Of the device's samples."""
    row_ms: float = 10.0
    """Median time from row to row."""
    p50_ms: float = 0.0
    p99_ms: float = 0.0
    keeps: bool = True
    """Every sample comes out, so that a lost one counts."""
    repeats: bool = False
    """It hands out readings more than once, also when nothing is wrong."""
    behind: int = 0
    """Of a driver that asks: by how many samples a row may be older than the question."""
    ask_ms: float = 0.0
    """Of a driver that asks: from the question to the row, in the quickest tenth."""
    numbered: bool = False
    """Frames carry a number or a time, by which a driver can tell an old one from a new one."""
    usual: list[str] = field(default_factory=list)
    """What the driver says when nothing is wrong, digits aside."""


@dataclass
class Outcome:
    """What came of a trial."""

    name: str
    why: str = ""
    findings: list[Finding] = field(default_factory=list)
    verdict: str = ""
    """One line: the findings, or what there is instead."""
    injected: int = 0
    rows: int = 0
    right: int = 0
    wrong: int = 0
    marked: int = 0
    again: int = 0
    older: int = 0
    stale: int = 0
    behind: int = 0
    """Of a driver that asks: rows that answer an earlier question."""
    lost: int = 0
    """Unharmed samples that left and never came, though earlier and later ones did."""
    sent: int = 0
    """Samples that left."""
    notes: int = 0
    """New things that it said."""
    said: list[str] = field(default_factory=list)
    p50_ms: float | None = None
    p99_ms: float | None = None
    worst_ms: float | None = None
    age_ms: float | None = None
    """Of a driver that asks: how old the samples were, median."""
    waits_ms: list[float] = field(default_factory=list)
    """Of every right row."""
    recovered_s: float | None = None
    quiet_s: float = 0.0
    """The longest time without a row or a word while the fault lasted."""
    cpu: float = 0.0
    """Share of a core."""
    leak: float = 0.0
    """Growth for each reading [byte]."""
    grown: int = 0
    """Growth from before the fault until the driver was well again [byte]."""
    bad: list[dict[str, Any]] = field(default_factory=list)
    """The first rows that are no sample, each beside the sample that it is nearest to."""
    seconds: float = 0.0
    confirmed: bool | None = None
    """Whether the findings came again in a second run; ``None``: not tried."""
    untried: str = ""
    """Why they were not tried again, although they do not count before they came again."""
    skipped: str = ""
    case: dict[str, Any] | None = None
    """The smallest case, as :mod:`tactemu.judge.smallest_case` found it."""

    def has(self, *kinds: str) -> bool:
        """Whether there is a finding of one of these kinds."""
        return any(finding.kind in kinds for finding in self.findings)

    def seen_again(self, other: Outcome, kinds: Collection[str]) -> None:
        """Keep of the findings of these kinds only those that another run of the trial has, too, if there are any."""
        came = {finding.kind for finding in other.findings}
        self.confirmed = any(finding.kind in came for finding in self.findings if finding.kind in kinds)
        if self.confirmed:
            self.findings = [each for each in self.findings if each.kind in came or each.kind not in kinds]
            self.verdict = "; ".join(map(str, self.findings))

    @property
    def doubt(self) -> str:
        """The reason why its findings do not count, for the reports; empty where they do."""
        return f" ({self.untried or 'once, and not again'})" if self.confirmed is False else ""

    def fails(self, kinds: Sequence[str]) -> bool:
        """Whether it fails a run."""
        return self.has(*kinds) and self.confirmed is not False

    def as_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)
