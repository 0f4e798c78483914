"""The latest frames on the wire in hex, their fields by the device's own tables, and the faults among them."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
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

_MAX_LINES = 60
"""Maximum number of lines shown; older ones are dropped."""
_MAX_FRAME_BYTES = 48
"""Maximum number of bytes shown of a frame."""
_MAX_FIELD_VALUES = 6
"""Maximum number of values shown of a field."""


class Wire:
    """The latest lines, newest first."""

    def __init__(self, run: DescribedRun):
        self._readers = {name: _Reader(skin) for name, skin in run.skins.items()}
        self._lines: deque[str] = deque(maxlen=_MAX_LINES)

    def add(self, rows: list[Mapping[str, Any]], missing: int) -> None:
        """Add the entries since the last state; ``missing`` is the number of those that were left out."""
        if missing:
            self._lines.appendleft(f'<tr class="more"><td></td><td></td><td>… {missing} more</td></tr>')
        for row in rows[-_MAX_LINES:]:
            self._lines.appendleft(self._line(row))

    def html(self) -> str:
        """Return all lines as HTML."""
        if not self._lines:
            return f"<p>no frames yet</p>{_STYLE}"
        return f'<div class="wire"><table>{"".join(self._lines)}</table></div>{_STYLE}'

    def _line(self, row: Mapping[str, Any]) -> str:
        kind = row["kind"]
        if kind == "inject":
            became = f"{row['before']} → {', '.join(row['after']) or 'nothing'}" if row.get("before") else ""
            words = f"<b>{escape(row['what'])}</b> {escape(row['detail'])} <code>{escape(became[:200])}</code>"
            return _row(row, "fault", words)
        if kind == "event":
            return _row(row, "event", _event(row["what"]))
        reader = self._reader(row["device"])
        frame = frame_text.parse(row["data"])
        words = f"<code>{escape(_shown(frame))}</code> {reader.words(frame, kind) if reader else ''}"
        words += f" <small>sample {row['sample']}</small>" if "sample" in row else ""
        words += f" <b>{escape(row['why'])}</b>" if row.get("why") else ""
        return _row(row, kind, words)

    def _reader(self, device: str) -> _Reader | None:
        return next((self._readers[name] for name in device.split("+") if name in self._readers), None)


class _Reader:
    """A decoder that names the commands and fields of a device's frames."""

    def __init__(self, skin: PageSkin):
        self._tables = [table for each in skin.about.get("tables", ()) if (table := _table(each)) is not None]
        self._commands = [(each["name"], each["request"]) for each in skin.about.get("commands", ())]

    def words(self, frame: WireFrame, kind: str) -> str:
        """Return the names of the command and of the table that the frame matches, with the values of its fields."""
        command = next((name for name, request in self._commands if kind == "rx" and matches(request, frame)), None)
        named = f"<b>{escape(command)}</b> " if command else ""
        for table in self._tables:
            values = _fields(table, frame)
            if values is not None:
                fields = ", ".join(f"{escape(name)} {escape(_value(value))}" for name, value in values.items())
                return f"{named}<b>{escape(table.name)}</b> {fields}"
        return named


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


def _event(what: str) -> str:
    if not what.startswith(COMMAND):
        return escape(what)
    try:
        said = json.loads(what[len(COMMAND) :])
        words = " ".join(f"{name}={value}" for name, value in said["args"].items())
        return f"<b>{escape(str(said['verb']))}</b> {escape(words[:200])} <small>{escape(str(said['by']))}</small>"
    except (ValueError, KeyError, TypeError, AttributeError):
        return escape(what[:300])


_MARKS = {"tx": "→ driver", "rx": "← driver", "drop": "lost", "fault": "fault", "event": "·"}


def _row(row: Mapping[str, Any], kind: str, words: str) -> str:
    return f'<tr class="{kind}"><td>{row["t_ns"] / 1e9:.4f}</td><td>{_MARKS[kind]}</td><td>{words}</td></tr>'


_STYLE = """<style>
.wire { overflow: auto; max-height: 60vh; font-size: 11px; }
.wire td { vertical-align: top; padding: 1px 6px 1px 0; white-space: nowrap; }
.wire td:last-child { white-space: normal; overflow-wrap: anywhere; }
.wire .rx td:nth-child(2) { color: #1c7ed6; }
.wire .tx td:nth-child(2) { color: #2b8a3e; }
.wire .fault td, .wire .drop td:nth-child(2) { color: #e03131; }
.wire .event td, .wire .more td { opacity: 0.65; }
</style>"""
