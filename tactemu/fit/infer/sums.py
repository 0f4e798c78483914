"""The checksum of captured frames, and whether the frames prove it."""

from __future__ import annotations

from collections.abc import Sequence

from tactemu.base.sum_search import CRCS, HOLDS_SHARE, FrameSum, hypotheses

LEAST_FRAMES = 6
"""The fewest different frames that a sum is looked for in."""
PROOF_FRAMES = {1: 12, 2: 6, 4: 4}
"""The fewest different frames in which a sum of so many bytes must hold to be certain."""
CHECKED = 2000
"""The number of frames in which a sum is checked."""


def find_sum(frames: Sequence[bytes]) -> FrameSum | None:
    """Return a checksum that holds in these frames, of one length or several, or ``None``."""
    distinct = list(dict.fromkeys(frames))
    checked = distinct[:: max(1, len(distinct) // CHECKED)][:CHECKED]
    holding = [each for each in hypotheses(distinct, LEAST_FRAMES) if _share(each, checked) >= HOLDS_SHARE]
    return _best(holding, checked) if holding else None


def _share(each: FrameSum, frames: Sequence[bytes]) -> float:
    return each.share(frames) if each.share(frames[:40]) >= 0.5 else 0.0


def _best(found: list[FrameSum], frames: Sequence[bytes]) -> FrameSum:
    """Return the widest sum with the simplest constant and the longest range."""

    def rank(each: FrameSum) -> tuple:
        behind = each.at >= 0 or each.end == each.at
        simple = each.kit_name is not None
        return each.width, each.name in CRCS, simple, behind, each.name == "sum", -each.start

    best = max(found, key=rank)
    alike = [
        each
        for each in found
        if (each.at, each.width, each.name, each.order) == (best.at, best.width, best.name, best.order)
    ]
    starts = tuple(sorted({each.start for each in alike if each.constant == best.constant} - {best.start}))
    # A plain sum over all other bytes holds at every place at once: it says nothing against this one.
    elsewhere = [
        each for each in found if not best.at <= each.at < best.at + best.width and (each.start, each.end) != (0, 0)
    ]
    held = [frame for frame in frames if best.holds(frame)]
    values = {frame[best.place(len(frame)) :][: best.width] for frame in held}
    proven = not elsewhere and len(values) >= PROOF_FRAMES[best.width] and len(held) >= 0.98 * len(frames)
    return FrameSum(best.at, best.width, best.start, best.end, best.name, best.order, best.constant, proven, starts)
