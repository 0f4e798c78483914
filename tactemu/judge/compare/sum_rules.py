"""Checksums in frames: the rule that holds over all frames of a model, and the rule that a real sensor has instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from firmware_protocols.sums import SUMS

MIN_FRAMES = 4
"""Least number of different frames that prove a rule."""
MAX_FRAMES = 12
"""Number of frames on which rules are tried; the one that holds is checked on more."""
MAX_START = 10
"""Largest number of first bytes that a sum leaves out."""
MAX_FROM_END = 8
"""Largest distance of a sum's first byte from the end of the frame [bytes]."""
HOLDS = 0.9
"""Least share of frames in which a rule holds; noise on the line damages the others."""


@dataclass(frozen=True, slots=True)
class SumRule:
    """A checksum of all bytes of a frame from ``start`` up to its own place."""

    name: str
    from_end: int
    """The distance of its first byte from the end of the frame [bytes]."""
    order: str
    """``<`` or ``>``."""
    start: int
    change: int = 0
    """A number that is combined with the sum by exclusive or: another start or final value."""

    @property
    def size(self) -> int:
        """The number of its bytes."""
        return SUMS[self.name].size

    def value(self, frame: bytes) -> int:
        """Return the sum of a frame."""
        at = len(frame) - self.from_end
        return SUMS[self.name].function(frame[self.start : at]) ^ self.change

    def sent(self, frame: bytes) -> int:
        """Return the number at the place of the sum."""
        at = len(frame) - self.from_end
        return int.from_bytes(frame[at : at + self.size], "little" if self.order == "<" else "big")

    def holds(self, frame: bytes) -> bool:
        """Return True if the frame has its sum."""
        return len(frame) - self.from_end > self.start and self.value(frame) == self.sent(frame)

    def share(self, frames: Sequence[bytes]) -> float:
        """Return the share of frames in which it holds."""
        return sum(map(self.holds, frames)) / max(1, len(frames))

    def __str__(self) -> str:
        order = "" if self.size == 1 else " low byte first" if self.order == "<" else " high byte first"
        change = f", combined with {self.change:0{2 * self.size}X}" if self.change else ""
        return f"{self.name} from byte {self.start}{order}{change}"


def find(frames: Sequence[bytes]) -> SumRule | None:
    """Return the rule that holds in all frames, that with the longest sum and the earliest start; ``None``: unknown."""
    distinct = list(dict.fromkeys(frames))[:MAX_FRAMES]
    if len(distinct) < MIN_FRAMES:
        return None
    shortest = min(map(len, distinct))
    for name in sorted(SUMS, key=lambda each: -SUMS[each].size):
        size = SUMS[name].size
        for from_end in range(size, min(MAX_FROM_END, shortest - 2) + 1):
            for order in "<" if size == 1 else "<>":
                for start in range(min(MAX_START, shortest - from_end - 1) + 1):
                    rule = SumRule(name, from_end, order, start)
                    # A number that never changes proves nothing.
                    if all(map(rule.holds, distinct)) and len(set(map(rule.sent, distinct))) > 1:
                        return rule
    return None


def find_instead(model: SumRule, frames: Sequence[bytes]) -> SumRule | None:
    """Return the rule of frames in which a model's rule does not hold; ``None``: none of those that are known."""
    distinct = list(dict.fromkeys(frames))[:MAX_FRAMES]
    if len(distinct) < MIN_FRAMES:
        return None
    near = sorted(
        (replace(model, start=k) for k in range(MAX_START + 1)), key=lambda each: abs(each.start - model.start)
    )
    near += [replace(each, order="<" if each.order == ">" else ">") for each in near if each.size > 1]
    for rule in near:
        if sum(map(rule.holds, distinct)) >= HOLDS * len(distinct):
            return rule
    for rule in near:
        changes = {rule.value(frame) ^ rule.sent(frame) for frame in distinct}
        if len(changes) == 1:
            return replace(rule, change=changes.pop())
    return find(distinct)
