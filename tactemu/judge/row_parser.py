"""Lines that a driver prints, as rows of numbers: JSON, CSV with or without a head, or ``name=number``."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

MAX_LINE_LENGTH = 1 << 18
"""A longer line is no row [characters]."""
_PAIRS = re.compile(r"(?<![\w.\[\]])([A-Za-z_][\w.\[\]]*)\s*[=:]\s*(-?\d[\d.]*(?:[eE][-+]?\d+)?)\b")
_SEPARATORS = re.compile(r"[,;\t ]+")
_MAX_NAME_LENGTH = 40
"""A head of a table has no longer names."""


class RowParser:
    """Parses line after line; remembers the head of a table."""

    def __init__(self):
        self.head: list[str] | None = None
        self._has_numbers = False

    def parse(self, line: str) -> dict[str, float] | None:
        """Return numbers by column; ``None`` where the line holds none, or words beside them."""
        line = line.strip()
        if not line or len(line) > MAX_LINE_LENGTH:
            return None
        if line[0] in "{[":
            return self._json(line)
        if (numbers := self._numbers(line)) is not None:
            self._has_numbers = True
            if self.head is None or len(self.head) != len(numbers):  # what stood before was talk
                self.head = [str(k) for k in range(len(numbers))]
            return dict(zip(self.head, numbers))
        pairs = _PAIRS.findall(line) if "=" in line or ":" in line else []
        if pairs and 2 * sum(len(name) + len(number) for name, number in pairs) > len(line) - 2 * len(pairs):
            return {name: float(number) for name, number in pairs}
        if not self._has_numbers:
            cells = [cell.strip() for cell in line.split(",")]
            if all(0 < len(cell) < _MAX_NAME_LENGTH for cell in cells):
                self.head = cells
        return None

    def _numbers(self, line: str) -> list[float] | None:
        cells = [cell for cell in _SEPARATORS.split(line.strip("()[] ")) if cell]
        try:
            numbers = [float(cell) for cell in cells]
        except ValueError:
            return None
        return numbers or None

    def _json(self, line: str) -> dict[str, float] | None:
        try:
            found = json.loads(line)
        except (ValueError, RecursionError):
            numbers = self._numbers(line)
            return None if numbers is None else dict(zip(map(str, range(len(numbers))), numbers))
        return dict(flatten("", found)) or None


def flatten(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers in a value, with where they are; what is no number is left out."""
    if isinstance(value, bool | int | float):
        try:
            yield name or "0", float(value)
        except OverflowError:
            yield name or "0", math.inf
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from flatten(f"{name}.{key}" if name else str(key), each)
    elif isinstance(value, list | tuple):
        for k, each in enumerate(value):
            yield from flatten(f"{name}.{k}" if name else str(k), each)
