"""A DBC file of the CAN signals that an inference found, for cantools, SavvyCAN and similar programs."""

from __future__ import annotations

from collections import defaultdict

from tactemu.fit.infer.analysis import Draft
from tactemu.fit.infer.fields import VALUE_KINDS, Field, Group

_EXTENDED = 1 << 31
"""The bit that marks 29-bit identifiers in a DBC file."""
_FLOATS = {4: 1, 8: 2}
DBC_HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_:'
"""The begin of each DBC file that is written here; other programs list the symbols after ``NS_``."""


def dbc_text(draft: Draft) -> str:
    """Return the text of a DBC file.

    Groups of one identifier that a byte or nibble distinguishes become multiplexed signals. A DBC file cannot say what
    distinguishes answers to different questions: of those the largest group alone is written, and a comment says so.
    """
    by_id: defaultdict[int, list[Group]] = defaultdict(list)
    for group in draft.groups:
        if group.id is not None:
            by_id[group.id].append(group)
    blocks, remarks = [], []
    for identifier, groups in sorted(by_id.items()):
        block, remark = _message(identifier, groups)
        blocks.append(block)
        if remark:
            number = identifier | _EXTENDED * (identifier > 0x7FF)
            remarks.append(f'CM_ BO_ {number} "{remark}";')
    floats = [line for groups in by_id.values() for line in _value_types(groups)]
    return "\n\n".join([DBC_HEAD, *blocks, *remarks, *floats]) + "\n"


def _shown(groups: list[Group]) -> tuple[list[Group], str]:
    """Return the groups of an identifier that one DBC message can have, and what is left out."""
    largest = max(groups, key=lambda group: len(group.rows))
    selectors = list(largest.selectors)
    alike = [
        group
        for group in groups
        if group.question == largest.question and list(group.selectors) == selectors[:1] == list(largest.selectors)
    ]
    shown = alike if selectors and alike else [largest]
    left = len(groups) - len(shown)
    return shown, f"{left} other kinds of message have this identifier" if left else ""


def _message(identifier: int, groups: list[Group]) -> tuple[str, str]:
    shown, remark = _shown(groups)
    number = identifier | _EXTENDED * (identifier > 0x7FF)
    size = max(group.length for group in groups)
    lines = [f"BO_ {number} M{identifier:X}: {size} Vector__XXX"]
    if len(shown) > 1:
        at, (_, mask) = next(iter(shown[0].selectors.items()))
        bits, shift = (8, 0) if mask == 0xFF else (4, 4 if mask == 0xF0 else 0)
        lines.append(f' SG_ selector M : {8 * at + shift}|{bits}@1+ (1,0) [0|0] "" Vector__XXX')
    for group in shown:
        kind = ""
        if len(shown) > 1:
            value, mask = next(iter(group.selectors.values()))
            kind = f" m{value >> 4 if mask == 0xF0 else value}"
        lines += [_signal(each, kind) for each in group.fields if each.kind in (*VALUE_KINDS, "bits")]
    return "\n".join(lines), remark


def _name(each: Field, kind: str) -> str:
    word = each.kind if each.kind in ("clock", "counter") else "value"
    return f"{word}{kind.strip()}_{each.at}{f'_{each.shift}' if each.bits else ''}"


def _signal(each: Field, kind: str) -> str:
    """Return the line of a signal; a big-endian one begins at its top bit."""
    sign = "-" if each.kind in ("i", "f") else "+"
    if each.order == ">":
        top = each.shift + each.width - 1
        start, order = 8 * (each.end - 1 - top // 8) + top % 8, 0
    else:
        start, order = 8 * each.at + each.shift, 1
    return f' SG_ {_name(each, kind)}{kind} : {start}|{each.width}@{order}{sign} (1,0) [0|0] "" Vector__XXX'


def _value_types(groups: list[Group]) -> list[str]:
    """Return the lines that mark signals as floats."""
    shown, _ = _shown(groups)
    number = (shown[0].id or 0) | _EXTENDED * ((shown[0].id or 0) > 0x7FF)
    found = []
    for group in shown:
        kind = ""
        if len(shown) > 1:
            value, mask = next(iter(group.selectors.values()))
            kind = f" m{value >> 4 if mask == 0xF0 else value}"
        found += [
            f"SIG_VALTYPE_ {number} {_name(each, kind)} : {_FLOATS[each.size]};"
            for each in group.fields
            if each.kind == "f"
        ]
    return found
