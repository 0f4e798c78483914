"""All faults by their words; a new one is its class and its line here."""

from __future__ import annotations

from tactemu.base.errors import SceneError
from tactemu.wire.faults import frames, link
from tactemu.wire.faults.fault import Fault
from tactemu.wire.line import LineModel

FAULTS: dict[str, type[Fault]] = {
    fault.word: fault
    for fault in (
        frames.Drop, frames.Flip, frames.Lose, frames.Truncate, frames.Length, frames.Checksum, frames.Duplicate,
        frames.Reorder, frames.Replace, frames.Garbage, frames.Split, frames.Chunk, frames.Merge, frames.Late,
        frames.Stray, frames.Silence, link.Latency, frames.Close, link.HalfOpen, link.Unplug, frames.ErrorFrame,
        link.BusOff, link.Babble, link.Load,
    )
}  # fmt: skip


def possible_faults(line_model: LineModel | type[LineModel]) -> list[str]:
    """Return the words of the faults that a line can have."""
    return [word for word, fault in FAULTS.items() if fault.every_line or word in line_model.faults]


def check_fits(fault: Fault, line_model: LineModel | type[LineModel]) -> None:
    """Raise if a line cannot have a fault.

    Raises:
        SceneError: names the faults that it can have.
    """
    kind, can = line_model.kind, possible_faults(line_model)
    if fault.word not in can:
        raise SceneError(f"fault {fault.text!r}: a {kind} wire cannot have it; expected one of: {', '.join(can)}")
    if getattr(fault, "arbitration_id", None) is not None and not line_model.has_identifiers:
        raise SceneError(f"fault {fault.text!r}: 'id=': a {kind} wire has no identifiers; name frames by prefix=HEX")
