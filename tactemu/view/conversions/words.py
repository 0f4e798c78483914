"""Frames, faults and events as a line of text."""

from __future__ import annotations

from tactemu.base.frame_text import text
from tactemu.truth.entries import BodyPose, Entry, Injection, Passage, PortEvent, Sample


def words_of(entry: Entry) -> str:
    """What a log panel shows of an entry that is no sample."""
    assert not isinstance(entry, Sample | BodyPose)
    if isinstance(entry, PortEvent):
        return entry.what
    if isinstance(entry, Passage):
        words = [entry.kind, text(entry.frame)]
        words += [] if entry.sample is None else [f"sample {entry.sample}"]
        return "  ".join([*words, *([entry.why] if entry.why else [])])
    became = f"{entry.before} -> {', '.join(entry.after) or 'nothing'}" if entry.before or entry.after else ""
    return "  ".join(filter(None, (f"inject {entry.what}", entry.detail, became)))


def warns(entry: Entry) -> bool:
    """Whether something went wrong: a fault, or a frame that never left."""
    return isinstance(entry, Injection) or (isinstance(entry, Passage) and entry.kind == "drop")
