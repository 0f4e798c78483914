"""The latest frames on the wire in hex, their fields by the device's own tables, and the faults among them."""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import matches, payload
from firmware_protocols.tables import Frame as Table
from firmware_protocols.tables import TableError
from tactemu.base import frame_text
from tactemu.truth import COMMAND
from tactemu.view.page.feed import DescribedRun, PageSkin
from tactemu.view.page.viewer_commands import answer_words

_MAX_LINES = 60
"""Maximum number of lines shown; older ones are dropped."""
_MAX_FRAME_BYTES = 40
"""Maximum number of bytes shown of a frame."""
_MAX_FIELD_VALUES = 6
"""Maximum number of values shown of a field."""
_UNHEARD = "no reader"
"""The reason in the log for a frame that was sent while no driver had the port open."""
_WHEN = re.compile(r" at \d+ns")
"""The time in a fault's words, which stands beside it anyway."""
_MARKS = {
    "question": "← question", "answer": "→ answer", "data": "→ data", "lost": "⌀ lost", "fault": "✕ fault",
    "event": "· event",
}  # fmt: skip
_CLASSES = {"answer": "tt-sent", "data": "tt-sent"}
_LEGEND = "<p>" + ", ".join(
    f'<b style="color:var(--tt-{colour})">{mark}</b> {text}'
    for mark, colour, text in (
        ("←", "question", "from driver"), ("→", "answer", "to driver"), ("⌀", "lost", "not sent"),
        ("✕", "fault", "fault"),
    )
) + "</p>"  # fmt: skip


class Wire:
    """The latest lines, newest first."""

    def __init__(self, run: DescribedRun):
        self._readers = {name: _Reader(skin) for name, skin in run.skins.items()}
        self._lines: deque[str] = deque(maxlen=_MAX_LINES)
        self._unheard: dict[str, int] = {}
        """The number of frames since the last driver closed the port of a device; absent if one has it open."""
        self._is_unheard_line = False
        """True if the newest line counts frames that no driver could read: the next one of these replaces it."""

    def is_unheard(self, device: str) -> bool:
        """Return True if the device's last frame was sent while no driver had the port open."""
        return any(device in names.split("+") for names in self._unheard)

    def add(self, rows: list[Mapping[str, Any]], missing: int) -> None:
        """Add the entries since the last state; ``missing`` is the number of those that were left out."""
        if missing and not self._unheard:
            self._push(
                '<div class="tt-frame tt-event"><span class="tt-mark">…</span>'
                f'<span class="tt-what">{missing} more</span></div>'
            )
        for row in rows[-_MAX_LINES:]:
            self._add_row(row)

    def html(self) -> str:
        """Return all lines as HTML."""
        if not self._lines:
            return '<div class="tt"><p>No frames yet.</p></div>'
        return f'<div class="tt">{_LEGEND}{"".join(self._lines)}</div>'

    def _push(self, line: str) -> None:
        self._lines.appendleft(line)
        self._is_unheard_line = False

    def _restart_counts(self) -> None:
        """Let the next line of frames that no driver could read count from 1."""
        self._unheard = dict.fromkeys(self._unheard, 0)

    def _add_row(self, row: Mapping[str, Any]) -> None:
        device = row.get("device", "")
        if row["kind"] != "drop" or row.get("why") != _UNHEARD:
            if row["kind"] in ("tx", "rx"):
                self._unheard.pop(device, None)
            self._restart_counts()
            self._push(self._line(row))
            return
        self._unheard[device] = self._unheard.get(device, 0) + 1
        if self._is_unheard_line:
            self._lines.popleft()
        self._push(self._unheard_line(row, self._unheard[device]))
        self._is_unheard_line = True

    def _unheard_line(self, row: Mapping[str, Any], seen: int) -> str:
        words = f"<b>no driver has the port open</b>, {seen} frames; the last: {self._frame(row)}"
        return _row(row, "lost", words)

    def _line(self, row: Mapping[str, Any]) -> str:
        kind = row["kind"]
        if kind == "inject":
            words = _WHEN.sub("", row["detail"]) or row["what"]
            code = f"<br><code>{escape(_change(row['before'], row['after']))}</code>" if row.get("before") else ""
            return _row(row, "fault", f"<b>{escape(words)}</b>{code}")
        if kind == "event":
            return _row(row, "event", _event(row["what"]))
        why = f"<b>{escape(row['why'])}</b>: " if row.get("why") else ""
        reader = self._reader(row["device"])
        shown = "lost" if kind == "drop" else "question" if kind == "rx" else reader.sent_kind if reader else "data"
        return _row(row, shown, why + self._frame(row))

    def _frame(self, row: Mapping[str, Any]) -> str:
        """Return the words of a frame, and below them its bytes."""
        reader = self._reader(row["device"])
        frame = frame_text.parse(row["data"])
        words = reader.words(frame, row["kind"], row.get("sample")) if reader else ""
        return f"{words}<br><code>{escape(_shown(frame))}</code>"

    def _reader(self, device: str) -> _Reader | None:
        return next((self._readers[name] for name in device.split("+") if name in self._readers), None)


class _Reader:
    """A decoder that names the commands and fields of a device's frames."""

    def __init__(self, skin: PageSkin):
        self._tables = [table for each in skin.about.get("tables", ()) if (table := _table(each)) is not None]
        self._commands = [(each["name"], each["request"]) for each in skin.about.get("commands", ())]
        self._channels = ", ".join(each.name for each in skin.channels("", len(skin.described.column_names(""))))
        self._taxels = len(skin.layout)
        self._question: str | None = None
        """The name of the driver's last question; None until there is one."""

    @property
    def sent_kind(self) -> str:
        """The kind of a frame to the driver: ``answer`` once the driver has asked, else ``data``."""
        return "data" if self._question is None else "answer"

    def words(self, frame: WireFrame, kind: str, sample: int | None) -> str:
        """Return the names of the command and of the table that the frame matches, with the values of its fields."""
        if kind == "rx":
            self._question = next((name for name, request in self._commands if matches(request, frame)), "")
        named = f"<b>{escape(self._question)}</b>" if kind == "rx" and self._question else ""
        carried = "" if sample is None else f' <span class="tt-dim">sample {sample}</span>'
        for table in self._tables:
            values = _fields(table, frame)
            if values is not None:
                about = {field.name: field.about for field in table.fields}
                fields = "; ".join(_field(name, value, about.get(name, "")) for name, value in values.items())
                return f"{named} <b>{escape(table.name)}</b>: {fields}{carried}"
        if sample is not None and not named:
            return f"<b>sample {sample}</b>: {escape(self._channels)} of {self._taxels} taxels"
        if kind == "tx" and self._question:
            return f"to <b>{escape(self._question)}</b>{carried}"
        return f"{named}{carried}" or f'<span class="tt-dim">{len(payload(frame))} bytes</span>'


def _field(name: str, value: Any, about: str) -> str:
    remark = f' <span class="tt-dim">({escape(about)})</span>' if about else ""
    return f"{escape(name.replace('_', ' '))} {escape(_value(value))}{remark}"


def _table(state: Mapping[str, Any]) -> Table | None:
    try:
        table = Table(state["text"])
        order = state["wire_order"]
        return table.bind(order, **state["bound"]) if order is not None or state["bound"] else table
    except (TableError, ValueError):
        return None


def _fields(table: Table, frame: WireFrame) -> dict[str, Any] | None:
    """Return the fields of a frame of this table and the parts of its identifier, or None if it does not match."""
    parts: Mapping[str, int] | None = {}
    if isinstance(frame, CanFrame):
        if table.id is None or table.id.extended != frame.is_extended_id:
            return None
        parts = table.id.read(frame.arbitration_id)
    elif table.id is not None or not (table.head or table.size):
        return None  # a table without a header and a length would match every frame
    try:
        values = table.unpack(payload(frame))
    except (TableError, ValueError, OverflowError):
        values = None
    return None if parts is None or values is None else {**parts, **values}


def _value(value: Any) -> str:
    if isinstance(value, bytes):
        return value[:_MAX_FIELD_VALUES].hex(" ") + ("…" if len(value) > _MAX_FIELD_VALUES else "")
    flat = np.ravel(value).tolist()
    return " ".join(f"{each:.5g}" for each in flat[:_MAX_FIELD_VALUES]) + ("…" if len(flat) > _MAX_FIELD_VALUES else "")


def _shown(frame: WireFrame) -> str:
    if isinstance(frame, CanFrame):
        text = frame_text.text(frame)
        return text[: 2 * _MAX_FRAME_BYTES] + ("…" if len(text) > 2 * _MAX_FRAME_BYTES else "")
    return frame[:_MAX_FRAME_BYTES].hex(" ") + (f" … {len(frame)} bytes" if len(frame) > _MAX_FRAME_BYTES else "")


def _change(before: str, after: Sequence[str]) -> str:
    """Return what a fault has made of a frame: the bytes that it changed, or the frames before and after."""
    if not after:
        return "the frame is lost"
    if len(after) > 1:
        return f"{len(after)} frames instead of one"
    head, old = before.rpartition("#")[::2]
    new = after[0].rpartition("#")[2]
    if len(old) != len(new):
        return f"{len(old) // 2} bytes became {len(new) // 2}"
    changed = [k for k in range(0, len(old), 2) if old[k : k + 2] != new[k : k + 2]]
    pairs = [f"byte {k // 2}: {old[k : k + 2]} → {new[k : k + 2]}" for k in changed[:_MAX_FIELD_VALUES]]
    more = ", …" if len(changed) > len(pairs) else ""
    return f"{head} {', '.join(pairs)}{more}".strip() if changed else "the same bytes, at another time"


def _event(what: str) -> str:
    if not what.startswith(COMMAND):
        return escape(what)
    try:
        said = json.loads(what[len(COMMAND) :])
        by = f", by {escape(str(said['by']))}" if said["by"] else ""  # a call in the emulator's own program has no name
        return f"<b>{escape(answer_words(str(said['verb']), said['args'])[:200])}</b>{by}"
    except (ValueError, KeyError, TypeError, AttributeError):
        return escape(what[:300])


def _row(row: Mapping[str, Any], kind: str, words: str) -> str:
    return (
        f'<div class="tt-frame {_CLASSES.get(kind, f"tt-{kind}")}"><span class="tt-mark">{_MARKS[kind]}</span>'
        f'<time>{row["t_ns"] / 1e9:.3f} s</time><span class="tt-what">{words}</span></div>'
    )
