"""Findings of a comparison: of the protocol, which must agree, and of the specimen, which are numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

ABOUT = {
    "nothing": "nothing came",
    "framing": "framing",
    "identifier": "identifiers",
    "length": "length",
    "constant": "constant",
    "sum": "checksum",
    "counter": "counter",
    "byte order": "byte order",
    "range": "range of values",
    "extra": "extra frames",
    "missing": "missing frames",
    "silent": "no answer",
    "unexpected answer": "unexpected answer",
    "answer": "answer",
    "rate": "rate",
    "latency": "time of an answer",
    "taxel order": "order of the taxels",
}
"""Kinds of protocol finding, with their titles in the reports."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A difference of the protocol."""

    kind: str
    where: str
    """The frames or the command: ``frames of 16 bytes``, ``answer to `version```."""
    text: str

    def __str__(self) -> str:
        return f"{ABOUT[self.kind]}: {self.where}: {self.text}" if self.where else f"{ABOUT[self.kind]}: {self.text}"


@dataclass
class Verdicts:
    """All that a comparison found."""

    protocol: list[Finding] = field(default_factory=list)
    agrees: list[str] = field(default_factory=list)
    """The parts that were compared and agree, as text."""
    notes: list[str] = field(default_factory=list)
    """The differences that a real sensor may have: settings, states, identity."""
    unjudged: list[str] = field(default_factory=list)
    """The parts that this capture could not show, each with what would."""

    def find(self, kind: str, where: str, text: str) -> None:
        """Add a finding, once."""
        finding = Finding(kind, where, text)
        if finding not in self.protocol:
            self.protocol.append(finding)

    def add(self, other: Verdicts) -> None:
        """Add all of another comparison."""
        self.protocol += [each for each in other.protocol if each not in self.protocol]
        for name in ("agrees", "notes", "unjudged"):
            mine = getattr(self, name)
            mine += [each for each in getattr(other, name) if each not in mine]
