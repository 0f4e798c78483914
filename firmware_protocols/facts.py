"""The facts about a sensor beside its byte tables, each with its basis.

A device declares them: ``facts = (stated(...), measured(...), assumed(...))``. A datasheet counts them by part, so that
the author of a driver sees how far each part can be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Part = Literal["touch", "identity", "configuration", "timing"]
"""The values that drivers decode; the sensor's identification; settings, power-up state, refusals; rates and clocks."""
Basis = Literal["stated", "measured", "assumed"]
"""The basis of a fact, best first: a source, a recording of a real sensor, or our choice alone."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One fact with its basis."""

    part: Part
    what: str
    basis: Basis
    where: str
    """``repository@commit file:line`` of a source, the recording, or the files that were read in vain."""

    def __str__(self) -> str:
        return f"{self.what} [{'looked in' if self.basis == 'assumed' else self.basis}: {self.where}]"


def stated(part: Part, what: str, where: str) -> Fact:
    """Return a fact that a source states, at ``repository@commit file:line``."""
    return Fact(part, what, "stated", where)


def measured(part: Part, what: str, recording: str) -> Fact:
    """Return a fact that a recording of a real sensor shows."""
    return Fact(part, what, "measured", recording)


def assumed(part: Part, what: str, looked: str) -> Fact:
    """Return a fact that we chose, with the files that we read from end to end and that do not state it."""
    return Fact(part, what, "assumed", looked.removeprefix("looked in: "))
