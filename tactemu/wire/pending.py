"""A frame that waits for its line, or is on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_protocols import WireFrame
from firmware_protocols.can_frames import CanFrames


@dataclass(order=True, slots=True)
class Pending:
    """A frame on its way, in the order of its lane."""

    order: tuple[int, int]
    number: int
    frame: WireFrame | CanFrames = field(compare=False)
    """Or a run of frames that follow one another."""
    source: str = field(compare=False)
    ready_ns: int = field(compare=False)
    """When it may leave."""
    duration_ns: int = field(compare=False, default=0)
    end_ns: int = field(compare=False, default=0)
    """When its last bit has gone; set when it wins the line."""
    sample: int | None = field(compare=False, default=None)
    """Number of the sample that it carries."""
    ends: list[int] | None = field(compare=False, default=None)
    """Of a run: when each would have gone had the first started at 0 [ns]."""
    gone: int = field(compare=False, default=0)
    """Of a run: how many have left."""

    @property
    def frames(self) -> Sequence[WireFrame]:
        """What has not left."""
        return self.frame[self.gone :] if isinstance(self.frame, CanFrames) else [self.frame]

    @property
    def head(self) -> WireFrame:
        """The frame that is next."""
        return self.frame[self.gone] if isinstance(self.frame, CanFrames) else self.frame
