"""Frames that wait for a line, or are on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_protocols import WireFrame
from firmware_protocols.can_frames import CanFrames


@dataclass(order=True, slots=True)
class Pending:
    """A frame, or a run of frames, on its way; sorted in the order of its lane."""

    order: tuple[int, int]
    number: int
    frame: WireFrame | CanFrames = field(compare=False)
    """The frame, or a run of frames that follow one another."""
    source: str = field(compare=False)
    ready_ns: int = field(compare=False)
    """The time from which it may leave."""
    duration_ns: int = field(compare=False, default=0)
    end_ns: int = field(compare=False, default=0)
    """The time at which its last bit has gone; set when it wins the line."""
    sample: int | None = field(compare=False, default=None)
    """The number of the sample that it carries."""
    ends: list[int] | None = field(compare=False, default=None)
    """The end of each frame of a run whose first frame starts at 0 [ns]."""
    gone: int = field(compare=False, default=0)
    """The number of frames of a run that have left."""

    @property
    def frames(self) -> Sequence[WireFrame]:
        """The frames that have not left."""
        return self.frame[self.gone :] if isinstance(self.frame, CanFrames) else [self.frame]

    @property
    def head(self) -> WireFrame:
        """The next frame."""
        return self.frame[self.gone] if isinstance(self.frame, CanFrames) else self.frame
