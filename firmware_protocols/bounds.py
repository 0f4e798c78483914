"""The unit and the range of a number, in the annotation of an option: ``Annotated[float, Bounds(unit="s", low=0)]``.

Options of devices, keys of scene files, arguments of commands and options in Python are declared with it; the check,
its message and the JSON schema follow from the annotation. Pydantic reads it, and so does :meth:`Bounds.check`.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, fields
from typing import Any

from firmware_protocols.messages import shown

LARGEST = 1e12
"""The largest magnitude of a number that is no integer, in SI units: the product of three still fits float32."""
LARGEST_INT = 2**63 - 1
"""The largest magnitude of an integer; serial numbers and times in nanoseconds fit."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The unit and the range of a number, or of each number of a list."""

    unit: str = ""
    low: float | None = None
    """The smallest valid value."""
    above: float | None = None
    """The largest value that is too small."""
    high: float | None = None
    """The largest valid value; ``inf``: infinity is valid too."""
    below: float | None = None
    """The smallest value that is too large."""

    def __repr__(self) -> str:
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        return f"Bounds({', '.join(f'{name}={value!r}' for name, value in given.items() if value not in (None, ''))})"

    def __str__(self) -> str:
        """Return the range and the unit: ``>= 0 and <= 1e+06 s``."""
        return " ".join(filter(None, (" and ".join(self.limits()), self.unit)))

    def check(self, value: Any, whole: bool = False) -> Any:
        """Return a number within the range; without an upper bound it is at most :data:`LARGEST`.

        Args:
            value: the value of the user; neither a text nor a truth value is a number.
            whole: the number must be whole, and is returned as an ``int``.

        Raises:
            ValueError: the value is no such number; the message goes on after its name: ``must be > 0 m, got -1``.
        """
        number = _number(value, whole)
        largest = LARGEST_INT if whole else LARGEST
        low = self.low if self.low is not None else -largest if self.above is None else -math.inf
        high = self.high if self.high is not None else largest if self.below is None else math.inf
        is_above = self.above is None or number > self.above
        is_below = self.below is None or number < self.below
        if low <= number <= high and is_above and is_below:
            return number
        limits = self.limits()
        if high < number < math.inf and self.high is None:
            limits.append(f"<= {largest:g}")
        elif -math.inf < number < low and self.low is None:
            limits.append(f">= {-largest:g}")
        is_text = isinstance(value, str)
        kind = "a whole number" if whole else "a number" if is_text else "" if limits else "a finite number"
        expected = " ".join(filter(None, (kind, " and ".join(limits), self.unit)))
        raise ValueError(f"must be {expected}, got {'the text ' if is_text else ''}{shown(value)}")

    def limits(self) -> list[str]:
        """Return the bounds as texts: ``[">= 0", "<= 10"]``."""
        given = {">": self.above, ">=": self.low, "<": self.below, "<=": self.high}
        return [f"{sign} {bound:g}" for sign, bound in given.items() if bound is not None and math.isfinite(bound)]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of a type with these bounds: a number is checked by :meth:`check` alone."""
        from pydantic_core import core_schema

        if source not in (int, float):
            return core_schema.no_info_after_validator_function(self._check_each, handler(source))
        limits = {"ge": self.low, "gt": self.above, "le": self.high, "lt": self.below}
        schema: Any = core_schema.int_schema if source is int else core_schema.float_schema
        inner = schema(**{name: limit for name, limit in limits.items() if limit is not None and math.isfinite(limit)})
        return core_schema.no_info_before_validator_function(lambda value: self.check(value, source is int), inner)

    def _check_each(self, value: Any) -> Any:
        for each in value if isinstance(value, list | tuple) else [value]:
            if isinstance(each, int | float) and not isinstance(each, bool):
                self.check(each, isinstance(each, int))
        return value


def _number(value: Any, whole: bool) -> Any:
    """Return a value as a number, or NaN if it is none, or is not whole."""
    if isinstance(value, bool | str | bytes):
        return math.nan
    try:
        if whole and hasattr(value, "__index__"):
            return operator.index(value)
        number = float(value)
        return number if not whole else int(number) if number.is_integer() else math.nan
    except (TypeError, ValueError, OverflowError):
        return math.nan
