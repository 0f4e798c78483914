"""The table of fields that `tactemu infer` missed: one row for each device, kind of message and kind of mistake."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

REASONS = {
    "selector": (
        "The byte takes few values, so it was taken for one that tells what the others mean. The messages were divided"
        " by it, which leaves few of each kind for the proofs of the other fields."
    ),
    "single bytes": (
        "No byte was seen to step as its neighbour wrapped: there are few messages of this kind, or the values leap."
    ),
    "flags": "Only a few bits of the number ever moved.",
    "wider integers": (
        "Neighbours that move together look like one number: the two coordinates of a contact, for example, or packed"
        " numbers of 12 bits in few messages."
    ),
    "12-bit numbers": "A number was cut at another nibble.",
    "floats": "The bytes of neighbouring integers pass for a float: there are few messages of this kind.",
    "the other sign": "Too few small steps across zero, or across the middle of the range, tell the sign.",
    "an unknown sign": "No small steps across zero, or across the middle of the range, tell the sign.",
    "the other byte order": "The capture does not show which byte carries into which.",
    "another type": "The bytes fit both an integer and a float.",
    "a narrower number": "The upper bytes moved too little to belong to the number.",
    "nothing": "No field was found there.",
}
"""The kinds of mistakes as the table names them, and the cause of each."""

MISSES_INTRODUCTION = """\
The tables count the fields that were not found as they are, with times. The first says what was found instead and
why; the second has a row for each device, kind of message and kind of mistake. A message is named by the question
that it answers (`question -> length`; `xx` stands for a byte that differs) or by its CAN identifier. `<12 at 26` is
a number of 12 bits, low byte first, that begins in byte 26; `u1`, `i2` and `f4` are unsigned, signed and float
numbers of 1, 2 and 4 bytes. The last column shows what was found in place of the first of the fields, with widths
in bits: `?8` has an unknown sign, `or wider` may have further bytes."""

_WORD_OF_VERDICT = {
    "sign": "the other sign",
    "order": "the other byte order",
    "type": "another type",
    "sign unknown": "an unknown sign",
    "width": "a narrower number",
}


class MissedField(NamedTuple):
    """A field that was not found as it is, in the words of the page."""

    device: str
    message: str
    truth: str
    """The true type and place, such as ``<u2 at 5``."""
    verdict: str
    """``place``, or the one property that is wrong: ``sign``, ``order``, ``type``, ``width``, ``sign unknown``."""
    found: str
    """The fields found in its place, such as ``u8 at 5, ?8 at 6``, or ``nothing``."""


def misses_table(missed: Iterable[MissedField]) -> list[str]:
    """Return the lines of two tables: the kinds of mistakes that occur, and the missed fields folded by kind."""
    rows: defaultdict[tuple[str, str, str], list[tuple[str, MissedField]]] = defaultdict(list)
    for each in missed:
        message, value = _message_and_value(each.message)
        rows[each.device, message, mistake_of(each)].append((value, each))
    counts = dict.fromkeys(REASONS, 0)
    lines = []
    for (device, message, mistake), fields in rows.items():
        counts[mistake] += len(fields)
        values = list(dict.fromkeys(value for value, _ in fields if value))
        places = _places([each.truth for _, each in fields])
        found = ", ".join(f"`{field}`" for field in fields[0][1].found.split(", "))
        example = "" if mistake == "nothing" else f": {found}{', …' if len(fields) > 1 else ''}"
        lines.append(f"| `{device}` | {message}{_values(values)} | {places} | {mistake}{example} |")
    return [
        "| found as | fields | cause |",
        "| --- | --- | --- |",
        *(f"| {mistake} | {count} | {REASONS[mistake]} |" for mistake, count in counts.items() if count),
        "",
        "| device | message | missed fields | found as |",
        "| --- | --- | --- | --- |",
        *lines,
    ]


def mistake_of(missed: MissedField) -> str:
    """Return the kind of the mistake, a key of :data:`REASONS`."""
    if missed.found == "nothing":
        return "nothing"
    if missed.verdict != "place":
        return _WORD_OF_VERDICT[missed.verdict]
    found = [(kind, int(bits)) for kind, bits in re.findall(r"[<>]?([a-z]+|\?)(\d+)(?: >> \d+)? at \d+", missed.found)]
    kinds = {kind for kind, _ in found}
    if "selector" in kinds:
        return "selector"
    if "f" in kinds and not re.match("[<>]?f", missed.truth):
        return "floats"
    widest = max(bits for _, bits in found)
    if widest <= 8:
        return "flags" if kinds == {"bits"} else "single bytes"
    return "12-bit numbers" if widest == 12 else "wider integers"


def _message_and_value(message: str) -> tuple[str, str]:
    """Return a message without the value of its last selector, and that value."""
    parts = re.fullmatch(r"(.*, byte \d+(?: & [0-9A-F]{2})?) = ([0-9A-F]{2})", message)
    return (parts[1], parts[2]) if parts else (message, "")


def _values(values: list[str]) -> str:
    if not values:
        return ""
    return f" = {', '.join(values)}" if len(values) <= 3 else f" = {values[0]} to {values[-1]} ({len(values)} values)"


def _places(truths: list[str]) -> str:
    """Return types with their places, such as ``<12 at 26 to 69, 27 fields``."""
    by_type: defaultdict[str, list[int]] = defaultdict(list)
    for truth in truths:
        code, _, at = truth.partition(" at ")
        by_type[code].append(int(at))
    texts = []
    for code, all_places in by_type.items():
        places = sorted(set(all_places))
        where = f"{places[0]} to {places[-1]}" if len(places) > 2 else " and ".join(map(str, places))
        texts.append(f"`{code}` at {where}" + (f", {len(all_places)} fields" if len(all_places) > 1 else ""))
    return "; ".join(texts)
