"""A frame that waits for its line, or is on it."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_protocols import Frame


@dataclass(order=True, slots=True)
class Pending:
    """A frame on its way, in the order of its lane."""

    order: tuple[int, int]
    number: int
    frame: Frame = field(compare=False)
    source: str = field(compare=False)
    ready_ns: int = field(compare=False)
    """When it may leave."""
    duration_ns: int = field(compare=False, default=0)
    end_ns: int = field(compare=False, default=0)
    """When its last bit has gone; set when it wins the line."""
    sample: int | None = field(compare=False, default=None)
    """Number of the sample that it carries."""
