"""``.jsonl``: a truth log as one JSON object per line, for ``grep`` and for programs without a reader.

Numbers are the shortest decimals that read back to the same float, which costs about half a microsecond each.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from tactemu.base import frame_text
from tactemu.truth.entries import (
    MAX_TIME_NS,
    BodyPose,
    End,
    Entry,
    Header,
    Injection,
    Passage,
    PortEvent,
    Sample,
    Sink,
    checked_end,
    checked_header,
)

_NUMBERS_AT_ONCE = 64
"""Number of numbers that are converted to text before other threads may run."""
_TEXTS = 1024
"""Number of such texts that are cached, about 1 MB."""
_FLOAT32 = np.dtype(np.float32).str
_BLOCK = 1 << 16
"""Size of the lines that are written together [byte]."""
_MAX_LINE_BYTES = 1 << 28


class JsonlWriter:
    """A writer of entries as lines, to a file that is open for binary writing."""

    def __init__(self, file: Sink):
        self._file = file
        self._parts: list[str] = []
        self._size = 0

    @property
    def is_saved(self) -> bool:
        """True if all entries are in the file."""
        return not self._parts

    def begin(self, header: Header) -> None:
        """Write the first line."""
        scene = {} if header.scene is None else {"scene": header.scene}
        self._line({"kind": "log", "version": header.version, "origin_ns": header.origin_ns, "ends": True} | scene)

    def add(self, entry: Entry) -> Iterator[None]:
        """Write an entry, and yield between its parts, so that a large one can be written in slices of time."""
        row = row_of(entry)
        arrays = [name for name, value in row.items() if isinstance(value, np.ndarray)]
        head = json.dumps({name: value for name, value in row.items() if name not in arrays}, separators=(",", ":"))
        self._put(head[:-1])
        for name in arrays:
            self._put(f',"{name}":')
            for part in array_text(row[name]):
                self._put(part)
                yield
        self._put("}\n")
        if self._size > _BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write all buffered lines to the file."""
        block = "".join(self._parts).encode()
        self._parts, self._size = [], 0
        self._file.write(block)

    def finish(self, end: End) -> None:
        """Write the end of the log and all buffered lines."""
        self._line({"kind": "end", "lost": end.lost} | ({"summary": list(end.summary)} if end.summary else {}))
        self.flush()

    def _line(self, row: dict[str, Any]) -> None:
        self._put(json.dumps(row, separators=(",", ":")) + "\n")

    def _put(self, part: str) -> None:
        self._parts.append(part)
        self._size += len(part)


def row_of(entry: Entry) -> dict[str, Any]:
    """Return an entry as the object of its line: arrays stay arrays, frames are text, unknown values are left out."""
    if isinstance(entry, BodyPose):
        return {
            "t_ns": entry.t_ns, "body": entry.body, "kind": "pose",
            "position": list(entry.position), "quaternion": list(entry.quaternion),
        }  # fmt: skip
    row: dict[str, Any] = {"t_ns": entry.t_ns, "device": entry.device}
    if isinstance(entry, Sample):
        row |= {"kind": "sample", "sample": entry.number} | ({"sense": entry.sense} if entry.sense else {})
        return row | {"ideal": entry.ideal, "measured": entry.measured, "counts": entry.counts}
    if isinstance(entry, Passage):
        row |= {"kind": entry.kind, "data": entry.text}
        row |= {} if entry.sample is None else {"sample": entry.sample}
        return row | ({"why": entry.why} if entry.kind == "drop" else {})
    if isinstance(entry, Injection):
        row |= {"kind": "inject", "what": entry.what, "detail": entry.detail}
        row |= {} if entry.frame is None else {"frame": entry.frame}
        return row | ({"before": entry.before, "after": list(entry.after)} if entry.before or entry.after else {})
    return row | {"kind": "event", "what": entry.what}


def array_text(values: np.ndarray) -> Iterator[str]:
    """Yield an array as JSON, in pieces."""
    if values.ndim == 0:
        yield _numbers_text(values.reshape(1))
        return
    rows = max(1, _NUMBERS_AT_ONCE // max(1, values[:1].size))
    yield "["
    for start in range(0, len(values), rows):
        yield ("," if start else "") + _numbers_text(values[start : start + rows])
    yield "]"


def _numbers_text(values: np.ndarray) -> str:
    """Return an array of one or more dimensions as JSON, without its outer brackets."""
    return _text_of_bytes(values.tobytes(), values.dtype.str, values.shape)


@lru_cache(_TEXTS)
def _text_of_bytes(data: bytes, kind: str, shape: tuple[int, ...]) -> str:
    """Return the text of an array given as bytes, cached because most taxels repeat their last reading.

    NumPy's text of a float32 is its shortest decimal, so that reading it back gives the same bits, and valid JSON
    where it is finite.
    """
    values = np.frombuffer(data, kind)
    if kind != _FLOAT32 or not np.isfinite(values).all():
        return json.dumps(values.reshape(shape).tolist(), separators=(",", ":"))[1:-1]
    return _brackets(shape) % tuple(values)


@lru_cache
def _brackets(shape: tuple[int, ...]) -> str:
    """Return the text of an array of a shape with ``%s`` for each number, without its outer brackets."""
    return json.dumps(np.full(shape, "%s").tolist(), separators=(",", ":")).replace('"', "")[1:-1]


# -- reading -------------------------------------------------------------------------------------------------------


def read(path: Path) -> Iterator[Header | Entry | End]:
    """Yield the entries of a file of lines, without a last line that was cut off.

    Raises:
        OSError, ValueError: it cannot be read, or a line is no entry of a log; the message names the line.
    """
    with path.open("rb") as file:
        yield from _records(file)


def _records(file: IO[bytes]) -> Iterator[Header | Entry | End]:
    number = 0
    while line := file.readline(_MAX_LINE_BYTES):
        number += 1
        is_complete = line.endswith(b"\n")
        try:
            row = json.loads(line)
            kind = row.get("kind") if isinstance(row, dict) else None
            if kind == "log" and number == 1:
                entry = checked_header(row.get("version"), row.get("origin_ns"), row.get("scene"), row.get("ends"))
            elif kind == "end":
                entry = checked_end(row.get("lost"), row.get("summary", []))
            else:
                entry = entry_of(row)
        except RecursionError:
            raise ValueError(f"line {number}: nested too deeply") from None
        except (ValueError, OverflowError) as error:
            if not is_complete and number > 1 and len(line) < _MAX_LINE_BYTES:
                return
            raise ValueError(f"line {number}: {error}") from None
        yield entry


def entry_of(row: Any) -> Entry:
    """Return the entry of one line's object: the inverse of :func:`row_of`.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(row, dict):
        raise ValueError(f"expected an object, got {_short(row)}")
    kind = row.get("kind")
    t_ns, device = _number(row, "t_ns"), _text(row, "device", "")
    if kind == "pose":
        position, quaternion = (tuple(_numbers(row, name).tolist()) for name in ("position", "quaternion"))
        if (len(position), len(quaternion)) != (3, 4):
            raise ValueError(f"pose: expected 3 and 4 numbers, got {len(position)} and {len(quaternion)}")
        return BodyPose(t_ns, _text(row, "body"), position, quaternion)
    if kind == "sample":
        ideal, measured, counts = (_numbers(row, name) for name in ("ideal", "measured", "counts"))
        number, sense = _number(row, "sample", 0), _text(row, "sense", "")
        return Sample(t_ns, device, ideal, measured, counts, number, sense)
    if kind in ("tx", "rx", "drop"):
        frame = frame_text.parse(_text(row, "data"))
        sample = _number(row, "sample") if "sample" in row else None
        return Passage(t_ns, device, kind, frame, sample, _text(row, "why", ""))
    if kind == "inject":
        after = row.get("after", [])
        if not isinstance(after, list) or not all(isinstance(each, str) for each in after):
            raise ValueError(f"after: expected a list of texts, got {_short(after)}")
        what, detail, before = _text(row, "what"), _text(row, "detail", ""), _text(row, "before", "")
        frame = _number(row, "frame") if "frame" in row else None
        return Injection(t_ns, device, what, detail, before, tuple(after), frame)
    if kind == "event":
        return PortEvent(t_ns, device, _text(row, "what"))
    raise ValueError(f"kind: expected sample, tx, rx, drop, inject, event or pose, got {_short(kind)}")


def _number(row: dict[str, Any], name: str, default: int | None = None) -> int:
    value = row.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > MAX_TIME_NS:
        raise ValueError(f"{name}: expected an integer of 64 bits, got {_short(value)}")
    return value


def _text(row: dict[str, Any], name: str, default: str | None = None) -> str:
    value = row.get(name, default)
    if not isinstance(value, str):
        raise ValueError(f"{name}: expected a text, got {_short(value)}")
    return value


def _numbers(row: dict[str, Any], name: str) -> np.ndarray:
    """Return an array of numbers.

    Raises:
        ValueError: ragged, nested too deeply, or not numbers.
    """
    values = row.get(name)
    array = np.array(values) if isinstance(values, Iterable) and not isinstance(values, str | dict) else None
    if array is None or array.dtype.kind not in "biuf":
        raise ValueError(f"{name}: expected lists of numbers, got {_short(values)}")
    return array


def _short(value: Any) -> str:
    """Return a value for a message, cut to a readable length."""
    text = "nothing" if value is None else str(value) if isinstance(value, int) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
