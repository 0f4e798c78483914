"""Parsing of a driver's printed lines as rows of numbers: JSON, CSV with or without a header, ``name=number``."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

MAX_LINE_LENGTH = 1 << 18
"""Maximum length of a row; bounds the memory and time for one line [characters]."""
_PAIRS = re.compile(r"(?<![\w.\[\]])([A-Za-z_][\w.\[\]]*)\s*[=:]\s*(-?\d[\d.]*(?:[eE][-+]?\d+)?)\b")
_SEPARATORS = re.compile(r"[,;\t ]+")
_MAX_NAME_LENGTH = 40
"""Maximum length of a column name in the header of a table [characters]."""


class RowParser:
    """A parser of consecutive lines that keeps the header of a table."""

    def __init__(self):
        self.head: list[str] | None = None
        self._has_numbers = False

    def parse(self, line: str) -> dict[str, float] | None:
        """Return the numbers of a line by column, or None if it has none or is other text."""
        line = line.strip()
        if not line or len(line) > MAX_LINE_LENGTH:
            return None
        if line[0] in "{[":
            return self._json(line)
        if (numbers := self._numbers(line)) is not None:
            self._has_numbers = True
            if self.head is None or len(self.head) != len(numbers):  # the line before was a message, not a header
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
    """Yield the path and value of each number in a JSON value, without everything else."""
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
