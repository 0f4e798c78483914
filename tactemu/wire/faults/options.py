"""The options of faults: the word of each, and how text gives its value within its bounds.

A fault declares an option as a field whose annotation has an :class:`Option`, such as :data:`Bytes`. From that follow
the text that is read, its errors, the list of ``tactemu faults``, and the text of a fault that is made in Python.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, get_args

from tactemu.base.units import DURATIONS_S, TIMES_S, scaled

Direction = Literal["to_driver", "from_driver", "both"]
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
Ranges = tuple[tuple[int, int], ...]
"""First and last numbers of frames."""

_MOST = 65_536
"""The largest number of bytes, bits or frames."""
_MAX_TIME_NS = 10**18
_MAX_FRAME = 10**9
_UNITS_NS = {unit: round(seconds * 1e9) for unit, seconds in DURATIONS_S.items()}


@dataclass(frozen=True)
class Option:
    """An option: ``WORD VALUE``, ``WORD=VALUE`` if its word ends with ``=``, or its value alone."""

    word: str
    read: Callable[[str], Any]
    """A function that returns the value of a text; it raises ValueError with what is expected."""
    text: Callable[[Any], str] = str
    """A function that returns a value as text."""
    alone: str = ""
    """A pattern of values that may stand alone, without the word."""
    digits: bool = False
    """True if the word gives this option only before plain digits: ``to 5``, as opposed to ``to 5s``."""
    sample: str = "N"
    """The value in the list of faults."""
    is_target: bool = False
    """True if it chooses frames, or their share, not what becomes of them."""
    rank: int = 0
    """The place in the text of a fault that is made in Python: the lowest stands first."""

    def value_of(self, word: str, following: list[str]) -> str | None:
        """Return the text of the value if a word gives this option, and take it off the words that follow.

        Raises:
            ValueError: the value is missing.
        """
        if self.alone and re.fullmatch(self.alone, word):
            return word
        if self.word.endswith("="):
            return word[len(self.word) :] if word.startswith(self.word) else None
        if word != self.word or (self.digits and not "".join(following[:1]).isdigit()):
            return None
        if not following:
            raise ValueError("a value must follow, as in 'at 3s', 'every 10', 'bits 2'")
        return following.pop(0)

    def show(self, value: Any) -> str:
        """Return the option with a value as text."""
        space = "" if self.alone or self.word.endswith("=") else " "
        return f"{'' if self.alone else self.word}{space}{self.text(value)}"


def _integer(least: int, most: int, text: str) -> int:
    try:
        number = int(text, 0)
    except ValueError:
        number = None
    if number is None or not least <= number <= most:
        raise ValueError(f"expected a whole number from {least} to {most} (0x{most:X}), got {text!r}")
    return number


def number(word: str, least: int = 1, most: int = _MOST, **more: Any) -> Option:
    """Return the option of a whole number, ``bits 3``."""
    return Option(word, partial(_integer, least, most), **more)


def _nanoseconds(text: str) -> int:
    time_ns = scaled(text, _UNITS_NS)
    if time_ns is None or not 0 <= time_ns <= _MAX_TIME_NS:
        raise ValueError(f"expected a time such as 3s, 16ms or 200us, got {text!r}")
    return round(time_ns)


def _time_text(time_ns: int) -> str:
    whole = (f"{time_ns // _UNITS_NS[unit]}{unit}" for unit in TIMES_S if time_ns % _UNITS_NS[unit] == 0)
    return next(whole, f"{time_ns}ns")  # NaN and infinity, which an altered state may have, are multiples of no unit


def duration(word: str, rank: int = 1, **more: Any) -> Option:
    """Return the option of a time, ``by 30ms`` [ns]."""
    return Option(word, _nanoseconds, _time_text, sample="T", rank=rank, **more)


def _bytes(text: str) -> bytes:
    try:
        return bytes.fromhex(text.removeprefix("0x"))
    except ValueError:
        raise ValueError(f"expected bytes in hex such as 55aa, got {text!r}") from None


def hex_bytes(word: str, **more: Any) -> Option:
    """Return the option of bytes, ``hex=aa07``."""
    return Option(word, _bytes, bytes.hex, sample="aa07", **more)


def _share(text: str) -> float:
    try:
        share = float(text.removesuffix("%")) / 100
    except ValueError:
        share = -1.0
    if not 0 <= share <= 1:
        raise ValueError("expected 0% to 100%")
    return share


def _ranges(text: str) -> Ranges:
    pairs = []
    for part in text.split(",") if text else ():
        first, dash, last = part.partition("-")
        low = _integer(1, _MAX_FRAME, first)
        pairs.append((low, _integer(low, _MAX_FRAME, last) if dash else low))
    return tuple(pairs)


def _ranges_text(ranges: Ranges) -> str:
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)


def _direction(text: str) -> str:
    if text not in DIRECTIONS:
        raise ValueError(f"expected {', '.join(DIRECTIONS)}")
    return text


def _file_name(text: str) -> str:
    if "/" in text or text in (".", ".."):
        raise ValueError(f"expected a name in the same folder, such as ttyUSB1, got {text!r}")
    return text


START = duration("from", rank=3)
END = duration("to", rank=3)
LASTS = duration("for", rank=3)
SHARE = Option("N%", _share, lambda share: f"{100 * share:.12g}%", alone=r"[\d.]+%", is_target=True)
DIRECTION = Option(", ".join(DIRECTIONS), _direction, alone="|".join(DIRECTIONS), is_target=True, rank=2)
EVERY = number("every", is_target=True)
FRAMES = Option("frame", _ranges, _ranges_text, is_target=True)
IDENTIFIER = number("id=", 0, 0x1FFF_FFFF, text=hex, is_target=True)
PREFIX = hex_bytes("prefix=", is_target=True)

Bytes = Annotated[int | None, number("bytes")]
Byte = Annotated[int | None, number("byte", -_MOST)]
"""A place in the frame, from 0; from the end if negative."""
After = Annotated[int | None, number("after", 0)]
"""The number of bytes before a cut or an insertion."""
By = Annotated[int, duration("by")]
"""A delay [ns]."""
Data = Annotated[bytes, hex_bytes("hex=")]
PortName = Annotated[str, Option("as", _file_name, sample="NAME")]
