"""The facts about a sensor besides its byte tables, each with its basis.

A device declares them in a table, or one by one (:func:`stated`, :func:`measured`, :func:`assumed`)::

    facts = fact_table(f'''
        stated touch: taxels row by row @ {MANUAL}, page 3
        measured timing: a frame each 32 ms @ the recordings of {SOURCE}
        assumed configuration: the zero is forgotten at power-off;
            the filter is a first-order low-pass
    ''', looked=f"all of {SOURCE}")

A fact begins with its basis and its part, and goes on to the line that begins the next; its source stands behind ``@``.
A datasheet counts facts by part, so that the author of a driver sees how far each part can be trusted.
"""

from __future__ import annotations

import re
import typing
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


_BEGIN = re.compile(rf"({'|'.join(typing.get_args(Basis))}) ({'|'.join(typing.get_args(Part))}): ")


def fact_table(text: str, *, looked: str = "") -> tuple[Fact, ...]:
    """Return the facts in a table, as above.

    Args:
        text: the table.
        looked: the files that were read in vain, for the assumed facts that name none.

    Raises:
        ValueError: a line begins no fact and continues none, or a fact has no source; the message names it.
    """
    facts: list[str] = []
    for line in filter(None, map(str.strip, text.splitlines())):
        if _BEGIN.match(line):
            facts.append(line)
        elif facts:
            facts[-1] += f" {line}"
        else:
            raise ValueError(f"fact {line!r}: expected `stated touch: ... @ source`: basis, part, fact and source")
    return tuple(_fact(fact, looked) for fact in facts)


def _fact(text: str, looked: str) -> Fact:
    found = _BEGIN.match(text)
    what, _, where = text[found.end() if found else 0 :].partition(" @ ")
    where = where or looked * text.startswith("assumed")
    if found is None or not where:
        raise ValueError(f"fact {text!r}: name its source behind ` @ `")
    return Fact(typing.cast(Part, found[2]), what.strip(), typing.cast(Basis, found[1]), where.strip())
