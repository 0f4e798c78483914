"""The draft of a device file: a frame table for each group of messages, and a class that `tactemu check` takes.

Its taxels are the largest arrays of one type; all other fields keep the value that the capture showed last, until the
author gives them a meaning.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from firmware_protocols import Frame
from tactemu.fit.infer.analysis import Draft, rates_of
from tactemu.fit.infer.fields import Group
from tactemu.fit.infer.frame_texts import Line, lines_of, table_of, table_text
from tactemu.fit.infer.segments import LEAST_ROWS

MAX_GROUPS = 64
DEFAULT_RATE_HZ = 100.0
FULL_SCALE_N = 20.0
"""The force at which a taxel of the draft reaches the end of its range that is farther from its rest."""
TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class Message:
    """A group with the names of its parts in the file."""

    group: Group
    constant: str
    """The name of its table."""
    taxels: Line | None
    """The line of the taxels, ``None`` if it has none."""
    first: int
    """The number of its first taxel."""

    @property
    def count(self) -> int:
        """The number of its taxels."""
        return len(self.taxels.fields) if self.taxels is not None else 0

    @property
    def table(self) -> Frame:
        """The compiled table."""
        return table_of(self.group)


def device_file(draft: Draft, path: Path, captures: Sequence[Path]) -> str:
    """Return the text of a device file for a draft."""
    messages = messages_of(draft)
    words = [word for word in path.stem.lower().replace("-", "_").replace(".", "_").split("_") if word]
    is_name = bool(words) and "_".join(words).isidentifier()
    name = "_".join(words) if is_name else "my_sensor"
    low, high, rest = _range(messages)
    is_float = any(each.taxels is not None and each.taxels.fields[0].kind == "f" for each in messages)
    commands = _commands(messages, draft, ", ".join(each.name for each in captures))
    kind = "can" if draft.is_can else "answers" if draft.pairs else "stream"
    text = Template((TEMPLATES / f"{kind}.txt").read_text(encoding="utf-8"))
    return text.substitute(
        framing=draft.framing,
        file=path.name,
        name=name,
        cls="".join(word.capitalize() for word in name.split("_")),
        source=", ".join(each.name for each in captures),
        tables="\n".join(
            f'{each.constant} = Frame("""\n{table_text(each.group, each.constant.lower())}\n""")' for each in messages
        ),
        entries="".join(_entry(each) for each in messages),
        streamed="".join(f'\n    "{each.constant}",' for each in messages if not _is_answer(each, draft)),
        answers="".join(_answers(messages, draft)),
        taxels=max(1, sum(each.count for each in messages)),
        low=repr(low),
        high=repr(high),
        rest=repr(rest),
        scale=f"{max(high - rest, low - rest, key=abs) / FULL_SCALE_N:.6g}",
        rate=f"{_rate(draft):g}",
        dtype="np.float32" if is_float else "int",
        line=_line(draft),
        counts="counts" if is_float else "np.rint(counts)",
        commands="".join(commands),
        imported="    command,\n" if commands else "",
    )


def messages_of(draft: Draft) -> list[Message]:
    """Return the groups that become tables, the largest first, with their taxels: the commonest type of arrays."""
    groups = [group for group in draft.groups if len(group.rows) >= LEAST_ROWS]
    groups.sort(key=lambda group: -group.rows.size)
    arrays = {id(group): [line for line in lines_of(group) if line.name.startswith("values_")] for group in groups}
    types: dict[str, int] = {}
    for line in [line for lines in arrays.values() for line in lines]:
        code = line.type.split()[0]
        types[code] = types.get(code, 0) + len(line.fields)
    usual = max(types, key=lambda code: types[code], default="")
    messages, first = [], 0
    answered: set[bytes] = set()
    for number, group in enumerate(groups[:MAX_GROUPS], 1):
        is_sent = draft.is_can or not group.question or group.question not in answered
        answered |= {group.question} if group.question else set()
        own = [line for line in arrays[id(group)] if is_sent and line.type.split()[0] == usual]
        message = Message(group, f"MESSAGE_{number}", max(own, key=lambda line: len(line.fields), default=None), first)
        first += message.count
        messages.append(message)
    return messages


def _entry(each: Message) -> str:
    """Return the line of a message: its table, its taxels, its identifier, and all other values."""
    table = each.table
    unpacked = (table.unpack(row.tobytes()) for row in each.group.rows[::-1])
    values = next((found for found in unpacked if found is not None), {})
    if each.taxels is not None:
        values.pop(each.taxels.name, None)
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    field = each.taxels.name if each.taxels is not None else ""
    identifier = "" if each.group.id is None else f"0x{each.group.id:X}, "
    return f'\n    "{each.constant}": ({each.constant}, {identifier}{field!r}, {each.first}, {each.count}, {plain!r}),'


def _is_answer(each: Message, draft: Draft) -> bool:
    return bool(draft.pairs) and bool(each.group.question)


def _answers(messages: list[Message], draft: Draft) -> list[str]:
    """Return the messages after each question on CAN."""
    names: dict[bytes, list[str]] = {}
    for each in messages:
        if _is_answer(each, draft) and each.group.question is not None:
            names.setdefault(each.group.question, []).append(each.constant)
    return [f"\n    bytes.fromhex({_hex(question)!r}): {tuple(found)!r}," for question, found in names.items()]


def _commands(messages: list[Message], draft: Draft, source: str) -> list[str]:
    """Return the declarations of the questions: on serial lines each with its method, on CAN for ``receive``."""
    found, known = [], set()
    for each in messages:
        question = each.group.question
        if not _is_answer(each, draft) or question is None or question in known:
            continue
        known.add(question)
        number = len(known)
        if draft.is_can:
            frame = _frame_text(int.from_bytes(question[:4], "big"), len(question) - 4)
            request, reply = f"{frame}{question[4:].hex().upper()}", repr(_can_patterns(messages, question))
            found.append(f"    @command({request!r}, reply={reply}, name='question {number}', origin={source!r})\n")
        else:
            found.append(
                f"\n    @command({_hex(question)!r}, reply={_short(_pattern(each))!r}, origin={source!r})\n"
                f"    def question_{number}(self, request: Request) -> Transmissions:\n"
                f'        """Send ``{each.constant}``."""\n'
                f"        return [self._message({each.constant!r})]\n"
            )
    return found


def _can_patterns(messages: list[Message], question: bytes) -> tuple[str, ...]:
    """Return the answers on CAN, with their identifiers."""
    found = []
    for each in messages:
        if each.group.question == question and each.group.id is not None:
            found.append(_frame_text(each.group.id, each.group.length) + _pattern(each).replace(" ", ""))
    return tuple(found)


def _frame_text(identifier: int, length: int) -> str:
    """Return the beginning of a CAN frame in candump's notation."""
    return f"{identifier:0{8 if identifier > 0x7FF else 3}X}{'##0' if length > 8 else '#'}"


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()


def _pattern(each: Message) -> str:
    """Return an answer with ``..`` for bytes that change."""
    rows = each.group.rows
    varies = (rows != rows[0]).any(axis=0)
    words: list[str] = []
    for value, moves in zip(rows[0].tolist(), varies.tolist()):
        words.append(".." if moves else f"{value:02X}")
    return " ".join(words)


def _short(pattern: str) -> str:
    """Return a pattern with ``..{12}`` for twelve bytes that change."""
    return re.sub(r"\.\.(?: \.\.){3,}", lambda found: f"..{{{found[0].count('..')}}}", pattern)


def _range(messages: list[Message]) -> tuple[float, float, float]:
    """Return the smallest, largest and resting count of the taxels."""
    best = next((each for each in messages if each.taxels is not None), None)
    if best is None or best.taxels is None:
        return 0, 255, 0
    values = np.concatenate([each.values(best.group.rows) for each in best.taxels.fields[:200]])
    first = best.taxels.fields[0]
    if first.kind == "f":
        reach = float(np.float32(10 * np.abs(values).max() + 1))
        return -reach, reach, 0.0
    is_signed = best.taxels.type.lstrip("<>")[0] == "i"
    low, high = (-(1 << first.width - 1), (1 << first.width - 1) - 1) if is_signed else (0, (1 << first.width) - 1)
    return low, high, min(max(int(np.median(values)), low), high)


def _line(draft: Draft) -> str:
    """Return the connector of the class."""
    if not draft.is_can:
        return "Serial(baud=115200)"
    is_fd = any(group.length > 8 for group in draft.groups)
    return f"Can(bitrate=1_000_000{', data_bitrate=5_000_000' if is_fd else ''})"


def _rate(draft: Draft) -> float:
    times = [chunk.t_ns for chunk in draft.chunks if chunk.direction == "tx" and chunk.t_ns is not None]
    if draft.is_can:
        rates = [rate for rate, _ in rates_of(draft.chunks).values()]
        return round(float(np.median(rates)), 1) if rates else DEFAULT_RATE_HZ
    if draft.pairs or len(times) < 10 or times[-1] <= times[0]:
        return DEFAULT_RATE_HZ
    return round(max(0.1, len(draft.framing.messages) / ((times[-1] - times[0]) / 1e9)), 1)
