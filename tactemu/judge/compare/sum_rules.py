"""Checksums in frames: the sum that holds over all frames of a model, and the sum that a real sensor has instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from firmware_protocols.sums import SUMS
from tactemu.base.sum_search import FrameSum, hypotheses

MIN_FRAMES = 4
"""Least number of different frames that prove a sum."""
MAX_FRAMES = 12
"""Number of different frames in which a sum must hold."""
HOLDS = 0.9
"""Least share of frames in which a sum holds; noise on the line damages the others."""


def words(found: FrameSum) -> str:
    """Return a sum in words."""
    order = {"": "", "<": " low byte first", ">": " high byte first"}[found.order]
    name, constant = found.kit_name, ""
    if name is None:  # with a constant that the kit has not
        name = replace(found, constant=0).kit_name or f"negative sum{8 * found.width}"
        number = f"{found.constant:0{2 * found.width}X}"
        added = f"plus {number}" if found.name in ("sum", "neg") else f"XOR {number}"
        constant = f", {added}" if found.constant else ""
    return f"{name} from byte {found.start}{order}{constant}"


def find(frames: Sequence[bytes]) -> FrameSum | None:
    """Return the sum of the kit that holds in all frames: the longest, with the earliest start; ``None``: unknown."""
    order = list(SUMS).index
    held = ((each.kit_name, each) for each in _held(frames, 1.0))
    known = [((-each.width, order(name), -each.at, each.order, each.start), each) for name, each in held if name]
    return min(known, key=lambda ranked: ranked[0])[1] if known else None


def find_instead(model: FrameSum, frames: Sequence[bytes]) -> FrameSum | None:
    """Return the sum of frames in which a model's does not hold; ``None``: none of those that are known.

    It differs from the model's in its start or byte order, or in a constant; else it is any sum of the kit.
    """

    def rank(each: FrameSum) -> tuple:
        return each.constant != model.constant, each.order != model.order, abs(each.start - model.start)

    near = [
        each for each in _held(frames, HOLDS) if (each.name, each.at, each.width) == (model.name, model.at, model.width)
    ]
    return min(near, key=rank) if near else find(frames)


def _held(frames: Sequence[bytes], least: float) -> list[FrameSum]:
    """Return the sums of all bytes up to their own place that hold in this share of the first different frames."""
    first = list(dict.fromkeys(frames))[:MAX_FRAMES]
    return [each for each in hypotheses(frames, MIN_FRAMES) if each.end == each.at and each.share(first) >= least]
