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


def possible_faults(line_model: LineModel | type[LineModel], *, is_real: bool = False) -> list[str]:
    """Return the words of the faults that a line can have; ``is_real``: a real one is behind its port."""
    without = line_model.only_modelled if is_real else ()
    words = [word for word, fault in FAULTS.items() if fault.every_line or word in line_model.faults]
    return [word for word in words if word not in without]


def check_fits(fault: Fault, line_model: LineModel | type[LineModel], *, is_real: bool = False) -> None:
    """Raise if a line cannot have a fault; ``is_real``: a real one is behind its port.

    Raises:
        SceneError: says that the line cannot have it, or why a real one cannot.
    """
    kind, can = line_model.kind, possible_faults(line_model, is_real=is_real)
    if is_real and (why := line_model.only_modelled.get(fault.word)):
        raise SceneError(f"fault {fault.text!r}: a real {kind} line cannot have it: {why}")
    if fault.word not in can:
        raise SceneError(f"fault {fault.text!r}: a {kind} wire cannot have it; `tactemu faults` lists those that can")
    if getattr(fault, "arbitration_id", None) is not None and not line_model.has_identifiers:
        raise SceneError(f"fault {fault.text!r}: 'id=': a {kind} wire has no identifiers; name frames by prefix=HEX")
