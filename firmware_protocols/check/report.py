"""The report of a check: faults, and facts that no worked example pins."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from firmware_protocols.calls import AuthorError


@dataclass(frozen=True)
class Fault:
    """A mistake, in a sentence that names what, where, and what to do."""

    part: str
    """The part of the check that found it."""
    text: str
    file: str = ""
    line: int = 0
    data: str = ""
    """The bytes that showed it, in hex or candump notation."""

    @staticmethod
    def of(part: str, error: AuthorError, prefix: str = "") -> Fault:
        """Return the fault for an error in the device's code."""
        return Fault(part, prefix + str(error), error.file, error.line, error.data)

    def __str__(self) -> str:
        where = f"{Path(self.file).name}:{self.line}"
        tail = f" ({where})" if self.file and self.line and where not in self.text else ""
        return f"{self.part}: {self.text}{tail}"


@dataclass(frozen=True)
class Report:
    """The faults and unpinned facts of one device."""

    device: str
    faults: tuple[Fault, ...] = ()
    unpinned: tuple[str, ...] = ()
    """The changes of a declared fact with which all worked examples still pass."""
    notes: tuple[str, ...] = ()
    """The rate, if no example states it; a slow answer; the treatment of garbage."""
    examples: int = 0
    seconds: float = field(default=0.0, compare=False)

    @property
    def ok(self) -> bool:
        """True if there is no fault; facts may be unpinned."""
        return not self.faults

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        return {**asdict(self), "ok": self.ok}

    def lines(self) -> list[str]:
        """Return the report as lines of text."""
        count = f"{len(self.faults)} fault{'' if len(self.faults) == 1 else 's'}" if self.faults else "no fault"
        lines = [f"{self.device}: {count}, {_counted(self.examples, 'worked example')}, {self.seconds:.1f} s"]
        lines += [f"  {fault}" for fault in self.faults]
        if self.unpinned:
            lines.append(
                f"{_counted(len(self.unpinned), 'fact')} that no example pins; with each of these changes all pass:"
            )
            lines += [f"  {fact}" for fact in self.unpinned]
        if self.notes:
            lines += ["what no example pins:", *(f"  {note}" for note in self.notes)]
        return lines


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def distinct(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Return the faults without later ones of the same text, or raised at the same line."""
    found: dict[object, Fault] = {}
    for fault in faults:
        found.setdefault((fault.file, fault.line) if " raised " in fault.text else fault.text, fault)
    return tuple(found.values())
