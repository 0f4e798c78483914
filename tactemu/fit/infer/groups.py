"""The division of messages into groups of one kind, by length, selector or question, and the fields of each group."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactemu.base.sum_search import FrameSum
from tactemu.fit.infer.arrays import LONG_ARRAY, PROVEN_SHARE, SLOW
from tactemu.fit.infer.costs import bits_of
from tactemu.fit.infer.counters import find_counters
from tactemu.fit.infer.fields import Field, Group
from tactemu.fit.infer.links import Link
from tactemu.fit.infer.proofs import Prover
from tactemu.fit.infer.segments import LEAST_ROWS, find_runs

MIXED = "each question asked more often: these were alike, not the same"
PACKED = "slow presses: values of 12 bits are likely beside it"
CERTAIN_KINDS = ("sum", "length", "selector")
MAX_ROWS = 6000
"""The largest number of messages of a group that proofs look at."""
MAX_CELLS = 2_000_000
LEAST_TEXT = 6
"""The least length of messages that are text if all of their bytes are printable."""
LEAST_PROVEN = 3
"""The fewest groups of one layout in which a field is certain, so that it is in the others."""
LEAST_SUMMED = 12
"""The fewest bytes of sums of a group that make its sum certain: in few messages it may hold by chance."""
MAX_DEPTH = 3
MAX_RANDOM_AT = 5
"""The offset below which a byte that comes in turn selects; behind it, the others must be smoother by it."""
MAX_SELECTOR_AT = 8
MAX_SELECTORS = 64
LEAST_OF_EACH = 6
LEAST_IN_TURN = 12
"""The fewest messages for each value of a selector that comes in turn: so do those of a motion that repeats."""
LEAST_PER_QUESTION = 12
NEXT_SHARE = 0.9
"""The least share of selectors that the one before foretells: messages come in turn."""
SURER_SHARE = 0.02
"""The least difference of the shares of a nibble and its byte by which the nibble selects, not the byte."""
SELECTOR_BITS = 16.0
DIGIT_BITS = 10.0
"""The bits from which on a byte is a digit of its neighbour's number."""
MAX_QUESTION_DEPTH = 4
QUESTION_GAIN = 0.85
"""The largest share of the bits that is left where a byte of the question selects the answer."""
MIXED_SHARE = 0.1


def by_length(messages: Sequence[bytes], key: str = "") -> list[Group]:
    """Return groups of messages of one length and selector."""
    lengths: defaultdict[int, list[int]] = defaultdict(list)
    for number, message in enumerate(messages):
        if message:
            lengths[len(message)].append(number)
    groups = []
    for length, index in sorted(lengths.items()):
        rows = np.array([np.frombuffer(messages[number], np.uint8) for number in index])
        groups += by_selector(Group(f"{key}{length} bytes", rows, np.array(index)))
    return groups


def by_selector(group: Group, depth: int = 0) -> list[Group]:
    """Return a group divided by a byte or nibble whose value tells what the others mean, if it has one."""
    found = _selector(group.rows) if depth < MAX_DEPTH and len(group.rows) > 30 else None
    if found is None:
        return [group]
    at, mask = found
    if mask == 0xFF and not (group.rows[:, at] & 0x0F).any():
        mask = 0xF0  # nothing says that its other nibble belongs to it
    parts = []
    for value in np.unique(group.rows[:, at] & mask):
        same = (group.rows[:, at] & mask) == value
        part = Group(
            f"{group.key}, byte {at}{'' if mask == 0xFF else f' & {mask:02X}'} = {value:02X}",
            group.rows[same],
            group.index[same],
            group.question,
            group.id,
            {**group.selectors, at: (int(value), mask)},
        )
        parts += by_selector(part, depth + 1)
    return parts


def _selector(rows: np.ndarray) -> tuple[int, int] | None:
    """Return offset and mask of a byte or nibble with few values, by each of which the others are smoother."""
    rows = rows[:3000]
    whole = _price(rows)
    best: tuple[float, int, int] | None = None
    counted = {k for each in find_counters(rows, ()) for k in range(each.at, each.end)}
    for at in sorted(set(range(min(rows.shape[1], MAX_SELECTOR_AT))) - counted):
        masks = _masks(rows, at)
        for mask in masks:
            column = rows[:, at] & mask
            values = np.unique(column)
            is_in_turn = _comes_in_turn(column) and len(rows) >= LEAST_IN_TURN * len(values)
            if is_in_turn and len(values) > 2 and at < MAX_RANDOM_AT:
                return at, mask
            split = sum(_price(rows[column == value]) for value in values) + SELECTOR_BITS * len(values)
            limit = 0.7 if not is_in_turn else 1.1 if at < MAX_RANDOM_AT else 0.97
            if split < limit * whole and (best is None or split < best[0]):
                best = split, at, mask
    return best[1:] if best else None


def _masks(rows: np.ndarray, at: int) -> list[int]:
    """Return the masks by which a byte may select: the whole byte, or a nibble that comes in turn more surely."""
    nibbles = [mask for mask in (0xF0, 0x0F) if _is_selector(rows, at, mask) and _comes_in_turn(rows[:, at] & mask)]
    share = _next_share(rows[:, at])
    if share >= NEXT_SHARE:
        surer = [mask for mask in nibbles if _next_share(rows[:, at] & mask) > share + SURER_SHARE]
        return surer or ([0xFF] if _is_selector(rows, at, 0xFF) else [])
    can_be_random = at < MAX_RANDOM_AT - 2 and _is_selector(rows, at, 0xFF)
    can_be_random = can_be_random and not _is_digit(rows, at) and not _takes_all(rows[:, at])
    return nibbles or ([0xFF] if can_be_random else [])


def _is_selector(rows: np.ndarray, at: int, mask: int) -> bool:
    """Return True if a byte or nibble has few values, each of them often."""
    column = rows[:, at] & mask
    if mask != 0xFF and (rows[:, at] == column).all():
        return False  # the whole byte says the same
    values, counts = np.unique(column, return_counts=True)
    return 1 < len(values) <= MAX_SELECTORS and counts[counts >= LEAST_OF_EACH].sum() >= 0.9 * len(rows)


def _takes_all(column: np.ndarray) -> bool:
    """Return True if a byte takes every multiple of its step: it is the low digit of a coarse number."""
    values = np.unique(column)
    return len(values) * int(np.gcd.reduce(values)) == 256


def _is_digit(rows: np.ndarray, at: int) -> bool:
    """Return True if a neighbour carries into a byte: it is an upper digit, and selects nothing."""
    columns = rows.astype(np.int64).T
    return any(Link(columns[low], columns[at]).bits > DIGIT_BITS for low in (at - 1, at + 1) if 0 <= low < len(columns))


def _price(rows: np.ndarray) -> float:
    if len(rows) < 3:
        return 8.0 * rows.size
    return float(bits_of(rows.astype(np.int64)).sum())


def _comes_in_turn(column: np.ndarray) -> bool:
    """Return True if each value nearly always has the same next one, another."""
    return _next_share(column) >= NEXT_SHARE


def _next_share(column: np.ndarray) -> float:
    """Return the share of values that the one before foretells; 0 if fewer than half of them differ from it."""
    if (column[1:] != column[:-1]).mean() < 0.5:
        return 0.0
    pairs, counts = np.unique(column[:-1].astype(int) * 256 + column[1:], return_counts=True)
    usual: dict[int, int] = {}
    for pair, count in zip(pairs.tolist(), counts.tolist()):
        usual[pair >> 8] = max(usual.get(pair >> 8, 0), count)
    return sum(usual.values()) / (len(column) - 1)


def by_question(questions: Sequence[bytes], answers: Sequence[bytes], ids: Sequence[int | None]) -> list[Group]:
    """Return groups of answers of one length to one kind of question: divided by what in it selects the answer."""
    classes: defaultdict[tuple, list[int]] = defaultdict(list)
    for number, (question, answer) in enumerate(zip(questions, answers)):
        if answer:
            classes[ids[number], len(question), len(answer)].append(number)
    groups = []
    for (identifier, _, length), index in classes.items():
        asked = np.array([np.frombuffer(questions[k], np.uint8) for k in index])
        rows = np.array([np.frombuffer(answers[k], np.uint8) for k in index])
        for chosen in _by_columns(asked, rows, np.arange(len(index))):
            own = asked[chosen]
            name = "" if identifier is None else f"{identifier:03X}, "
            still = (own == own[0]).all(axis=0)
            text = " ".join(f"{byte:02X}" if same else "xx" for byte, same in zip(own[0][:16], still))
            number = index[int(chosen[_usual(own)])]
            group = Group(
                f"{name}{text} -> {length} bytes", rows[chosen], np.array(index)[chosen], questions[number], identifier
            )
            group.is_mixed = not still.all() and _are_rare(own)
            groups += by_selector(group)
    return groups


def _by_columns(asked: np.ndarray, rows: np.ndarray, chosen: np.ndarray, depth: int = 0) -> list[np.ndarray]:
    """Return sets of answers, divided by the byte of the question by which they are smoothest, and so on."""
    if depth >= MAX_QUESTION_DEPTH or len(chosen) < 2 * LEAST_OF_EACH:
        return [chosen]
    own, whole = asked[chosen], _price(rows[chosen])
    best: tuple[float, int] | None = None
    for column in range(own.shape[1]):
        values, counts = np.unique(own[:, column], return_counts=True)
        if not 1 < len(values) <= MAX_SELECTORS or counts[counts >= LEAST_OF_EACH].sum() < 0.8 * len(own):
            continue
        split = sum(_price(rows[chosen][own[:, column] == value]) for value in values) + SELECTOR_BITS * len(values)
        if split < QUESTION_GAIN * whole and (best is None or split < 0.98 * best[0]):
            best = split, column
    if best is None:
        return [chosen]
    parts = []
    for value in np.unique(own[:, best[1]]):
        parts += _by_columns(asked, rows, chosen[own[:, best[1]] == value], depth + 1)
    return parts


def _usual(asked: np.ndarray) -> int:
    """Return the number of a question that is the most frequent one."""
    _, first, counts = np.unique(asked, axis=0, return_index=True, return_counts=True)
    return int(first[counts.argmax()])


def _are_rare(asked: np.ndarray) -> bool:
    _, counts = np.unique(asked, axis=0, return_counts=True)
    return counts[counts < LEAST_PER_QUESTION].sum() > MIXED_SHARE * len(asked)


def find_fields(
    group: Group, found: FrameSum | None, length: Field | None = None, words_from: int | None = None
) -> None:
    """Find the fields of a group's messages, with their sum and length field."""
    taken: list[Field] = []
    if found is not None and _mostly_holds(found, group.rows):
        is_certain = found.is_certain and len(group.rows) * found.width >= LEAST_SUMMED
        group.sum = replace(found, is_certain=is_certain)
        at = found.place(group.length)
        taken.append(
            Field(
                at,
                found.width,
                "sum",
                found.order,
                is_certain=is_certain,
                why=str(found),
            )
        )
    if length is not None and length.end <= group.length:
        taken.append(length)
    for at, (_, mask) in group.selectors.items():
        bits, shift = (0, 0) if mask == 0xFF else (4, 4 if mask == 0xF0 else 0)
        taken.append(Field(at, 1, "selector", bits=bits, shift=shift, is_certain=True))
    group.fields = sorted(taken, key=lambda each: each.at)
    if len(group.rows) < LEAST_ROWS or _is_text(group.rows):
        return
    rows = group.rows[: max(LEAST_ROWS, min(MAX_ROWS, MAX_CELLS // group.length))]
    taken += find_counters(rows, taken)
    if group.is_mixed:
        taken = [each for each in taken if each.kind not in ("counter", "clock")] + [
            replace(each, is_certain=False, decide=MIXED) for each in taken if each.kind in ("counter", "clock")
        ]
    prover = Prover(
        rows, taken, head_of(rows) if found is not None or length is not None else 0, words_from is not None
    )
    found_fields = prover.fields(find_runs(rows, taken, words_from))
    if group.is_mixed:
        for each in found_fields:
            each.is_certain, each.decide = False, MIXED
    group.fields = sorted([*taken, *found_fields], key=lambda each: (each.at, each.shift))


def _is_text(rows: np.ndarray) -> bool:
    return rows.shape[1] >= LEAST_TEXT and bool((np.isin(rows, (10, 13)) | (rows >= 32) & (rows < 127)).all())


def head_of(rows: np.ndarray) -> int:
    """Return how many bytes at the beginning never change."""
    moving = np.nonzero((rows != rows[0]).any(axis=0))[0]
    return int(moving[0]) if len(moving) else rows.shape[1]


def _mostly_holds(found: FrameSum, rows: np.ndarray) -> bool:
    some = rows[:60]
    return sum(found.holds(row.tobytes()) for row in some) > 0.9 * len(some)


def agree(groups: Sequence[Group]) -> None:
    """Compare groups of one length and identifier, such as the rows of a matrix, that a selector distinguishes.

    Where their layouts are equal, what is proven in many of them holds for the others. Where they contradict each
    other, nothing is certain: values of 12 bits in one make single bytes of another doubtful, and two packings each
    other.
    """
    alike: defaultdict[tuple[int | None, int], list[Group]] = defaultdict(list)
    for group in groups:
        alike[group.id, group.length].append(group)
    for same in alike.values():
        _share_proofs([group for group in same if group.selectors])
        packed = [each for group in same for each in group.fields if each.width == 12]
        for each in [each for group in same for each in group.fields]:
            is_doubtful = bool(packed) and each.width == 8 and each.kind not in CERTAIN_KINDS
            if is_doubtful or (each.width == 12 and len({other.order for other in packed}) > 1):
                each.is_certain, each.decide = False, PACKED


def _share_proofs(groups: Sequence[Group]) -> None:
    """Make fields certain that only lack carries, if the same field is certain in many groups of the same layout.

    The layout of a long array is proven as a whole: fields between those that are proven in any of its groups are as
    these, if the groups with proven ones are many, and their proven fields.
    """
    layouts: defaultdict[tuple, list[Group]] = defaultdict(list)
    for group in groups:
        values = [each for each in group.fields if each.kind in ("u", "i", "?")]
        layouts[tuple((each.at, each.size, each.order) for each in values)].append(group)
    for layout, same in layouts.items():
        if len(layout) < 2:
            continue
        places = {at for at, _, _ in layout}
        proven = [[each for each in group.fields if each.at in places and each.is_certain] for group in same]
        inside = _inside(proven, len(layout))
        for at, _, _ in layout:
            fields = [each for group in same for each in group.fields if each.at == at]
            own = [each for each in fields if each.is_certain]
            if len(own) >= max(LEAST_PROVEN, PROVEN_SHARE * len(fields)):
                why = f"as in {len(own)} of {len(fields)} messages that a selector distinguishes"
            elif at in inside:
                why = f"in an array of {len(layout)}, of which a selector distinguishes {len(same)}"
            else:
                continue
            for each in fields:
                is_alike = each.kind in {other.kind for other in own} | {"?"}
                if each.decide == SLOW and is_alike and not each.is_width_open:
                    each.is_certain, each.decide, each.why = True, "", why


def _inside(proven: list[list[Field]], length: int) -> range:
    """Return the offsets between the proven fields of a long array that several groups have."""
    some = [fields for fields in proven if fields]
    many = sum(map(len, some))
    if length < LONG_ARRAY or len(some) < LEAST_PROVEN or many < PROVEN_SHARE * length * len(proven):
        return range(0)
    ats = [each.at for fields in some for each in fields]
    return range(min(ats), max(ats))
