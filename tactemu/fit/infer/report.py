"""The report of an inference, as lines of text and as data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from tactemu.fit.infer.analysis import Draft, families_of, rates_of
from tactemu.fit.infer.catalogue import Match
from tactemu.fit.infer.channels import answers_of
from tactemu.fit.infer.fields import Group
from tactemu.fit.infer.frame_texts import Coverage, table_text
from tactemu.fit.infer.running import unframed_places
from tactemu.fit.infer.segments import LEAST_ROWS

MAX_TABLES = 12
MAX_LISTED = 8
MAX_ALIKE = 4
"""Largest number of other devices that are named."""


def report_lines(draft: Draft, coverage: Coverage, match: Match | None = None, shown: Sequence[str] = ()) -> list[str]:
    """Return the report as lines."""
    lines = []
    if match is not None:
        lines.append(_catalogue_line(match))
    lines += _framing_lines(draft)
    groups = sorted(draft.groups, key=lambda group: -group.rows.size)
    known = [group for group in groups if len(group.rows) >= LEAST_ROWS]
    for group in known[:MAX_TABLES]:
        lines += ["", f"{len(group.rows)} messages: {group.key}", table_text(group, "message").split("\n", 1)[1]]
    if len(known) > MAX_TABLES:
        lines.append(f"\nand {len(known) - MAX_TABLES} more kinds of message; --json and the device file have all")
    if rare := [group for group in groups if len(group.rows) < LEAST_ROWS]:
        lines.append(
            f"\n{len(rare)} kinds of message came fewer than {LEAST_ROWS} times: nothing is said of their fields"
        )
    lines += ["", *_channel_lines(draft), *shown, *_coverage_lines(draft, coverage), *_decision_lines(draft)]
    return lines


def _catalogue_line(match: Match) -> str:
    more = f" and {len(match.alike) - MAX_ALIKE} more" if len(match.alike) > MAX_ALIKE else ""
    alike = f"; as well they may be of {', '.join(match.alike[:MAX_ALIKE])}{more}" if match.alike else ""
    if match.is_recognised:
        return f"these are the bytes of {match.name}: {match.share:.0%} of them are in messages like its own{alike}"
    return (
        f"no device of the catalogue is recognised; nearest is {match.name}: {match.share:.0%} of the bytes are in "
        f"messages like its own{alike}; `tactemu compare {match.name} --from CAPTURE` tells what differs"
    )


def _framing_lines(draft: Draft) -> list[str]:
    framing = draft.framing
    if framing.kind == "unknown":
        return [f"framing: unknown. What would decide it: {framing.decide}"]
    word = (
        f"certain: {framing.why}"
        if framing.is_certain
        else f"likely; what would decide it: {framing.decide or 'a longer capture'}"
    )
    lines = [f"framing ({word}): {framing}"]
    found = framing.sum or next((group.sum for group in draft.groups if group.sum is not None), None)
    if found is not None:
        lines.append(f"sum: {found} ({'certain: it holds in every message' if found.is_certain else 'likely'})")
    if draft.pairs:
        answered = sum(bool(pair.answer) for pair in draft.pairs)
        lines.append(f"questions: {len(draft.pairs)}, answered: {answered}")
    for read in draft.reads:
        lines.append(f"Modbus RTU: {read}")
    if draft.is_can:
        lines += _bus_lines(draft)
    return lines


def _bus_lines(draft: Draft) -> list[str]:
    ids = sorted({group.id for group in draft.groups if group.id is not None})
    rates = rates_of(draft.chunks)
    lines = []
    for base, step, count in families_of(ids):
        first = f"{base:X}" if count == 1 else f"{base:X} + {step:X} * k, k = 0 to {count - 1}"
        rate = f", {rates[base][0]:.4g} Hz, jitter {rates[base][1] * 1e3:.2g} ms" if base in rates else ""
        lines.append(f"identifiers {first}{rate}")
    return lines


def _channel_lines(draft: Draft) -> list[str]:
    answers = answers_of(draft)
    if answers is None:
        return []
    order = [str(answers.channels[k].field.at) for k in answers.order[:40]]
    lines = [
        f"channels in the order of their first answer, by byte of {answers.channels[0].group.key}: {' '.join(order)}"
    ]
    for alike in answers.together[:4]:
        lines.append(f"these answer together: {' '.join(str(answers.channels[k].field.at) for k in alike[:40])}")
    return lines


def _coverage_lines(draft: Draft, coverage: Coverage) -> list[str]:
    total = max(coverage.sent, 1)
    lines = [
        f"{coverage.sent} bytes: {coverage.values / total:.1%} are behind values, {coverage.checks / total:.1%} behind "
        f"sums, lengths and selectors, {coverage.still / total:.1%} never move",
        f"{coverage.encoded / total:.1%} of them come back when the decoded values are encoded",
    ]
    places = unframed_places(draft)
    if places:
        words = ", ".join(f"{size} at {at}" for at, size in places)
        lines.append(f"bytes in no message, that do not come back: {words}{' ...' if len(places) >= 5 else ''}")
    return lines


def _decision_lines(draft: Draft) -> list[str]:
    decisions = Counter(each.decide for _, each in draft.fields if each.decide and not each.is_certain)
    certain = sum(each.is_certain for _, each in draft.fields)
    lines = [f"{certain} of {len(draft.fields)} fields are certain"]
    lines += [f"{count} would be decided by {decide}" for decide, count in decisions.most_common(MAX_LISTED)]
    return lines


def as_dict(draft: Draft, coverage: Coverage, match: Match | None = None) -> dict[str, Any]:
    """Return the report as data: every group with every field."""
    framing = draft.framing
    cut = framing.cut
    return {
        "kind": "can" if draft.is_can else "serial",
        "catalogue": _match_dict(match) if match is not None and match.is_recognised else None,
        "nearest": _match_dict(match) if match is not None and not match.is_recognised else None,
        "framing": {
            "kind": framing.kind,
            "text": str(framing),
            "is_certain": framing.is_certain,
            "why": framing.why,
            "decide": framing.decide,
            "size": cut.size if cut is not None else None,
            "head": cut.head.hex() if cut is not None else None,
            "mask": {str(at): value for at, value in framing.mask.items()},
            "messages": len(framing.messages),
        },
        "questions": len(draft.pairs),
        "modbus": [vars(read) for read in draft.reads],
        "rates": {f"{identifier:X}": rate for identifier, rate in rates_of(draft.chunks).items()},
        "groups": [_group_dict(group) for group in draft.groups],
        "coverage": vars(coverage),
    }


def _match_dict(match: Match) -> dict[str, Any]:
    return {"device": match.name, "share": match.share, "alike": list(match.alike)}


def _group_dict(group: Group) -> dict[str, Any]:
    return {
        "key": group.key,
        "messages": len(group.rows),
        "length": group.length,
        "id": group.id,
        "question": group.question.hex() if group.question is not None else None,
        "selectors": {str(at): list(found) for at, found in group.selectors.items()},
        "sum": None if group.sum is None else {**vars(group.sum), "kit_name": group.sum.kit_name},
        "fields": [{**vars(each), "width": each.width} for each in group.fields],
    }
