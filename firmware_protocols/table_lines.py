"""The reader of the lines of a frame table; :mod:`firmware_protocols.tables` documents their syntax."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from firmware_protocols.sums import SUMS, Sum


class TableError(ValueError):
    """A table that contradicts itself, or a binding of a name that the table does not have."""


@dataclass(frozen=True)
class Identifier:
    """The bits of a CAN identifier, such as ``100 bbbb tttt`` with the parts ``board`` and ``triangle``."""

    bits: str
    """The 11 or 29 bits, each 0, 1 or the letter of a part."""
    parts: Mapping[str, str]
    """The letters by the name of the part."""

    @property
    def extended(self) -> bool:
        """True for an identifier of 29 bits."""
        return len(self.bits) == 29

    def __str__(self) -> str:
        names = ", ".join(f"{letter} {name}" for name, letter in self.parts.items())
        return f"{self.bits} ({names})" if names else self.bits

    def of(self, **parts: ArrayLike) -> Any:
        """Return the identifier with these parts, integers or arrays of them.

        Raises:
            TypeError: a part is missing or unknown.
            OverflowError: a part does not fit its bits.
        """
        if set(parts) != set(self.parts):
            raise TypeError(f"identifier {self.bits} has the parts {sorted(self.parts)}, got {sorted(parts)}")
        return self._with(parts)

    def filter(self, **parts: int) -> tuple[int, int]:
        """Return identifier and mask of a filter for these parts; parts not given may have any value."""
        free = "".join(letter for name, letter in self.parts.items() if name not in parts)
        mask = "".join("0" if bit in free else "1" for bit in self.bits)
        return self._with(parts), int(mask, 2)

    def read(self, identifier: int) -> dict[str, int] | None:
        """Return the parts of an identifier, ``None`` if its constant bits differ."""
        base, mask = self.filter()
        if identifier & mask != base:
            return None
        return {
            name: identifier >> self._shift(letter) & (1 << self.bits.count(letter)) - 1
            for name, letter in self.parts.items()
        }

    def _shift(self, letter: str) -> int:
        return len(self.bits) - 1 - self.bits.rindex(letter)

    def _with(self, parts: Mapping[str, Any]) -> Any:
        identifier: Any = int(re.sub("[a-z]", "0", self.bits), 2)
        for name, value in parts.items():
            letter = self.parts[name]
            width = self.bits.count(letter)
            if np.any(np.asarray(value) >> width != 0):
                raise OverflowError(f"identifier {self.bits}: {name}: {value} does not fit {width} bits")
            identifier = identifier | value << self._shift(letter)
        return identifier


_CODES = {"u1": "B", "i1": "b", "u2": "H", "i2": "h", "u4": "I", "i4": "i", "u8": "Q", "i8": "q", "f4": "f", "f8": "d"}
_BYTE = np.dtype("u1")


@dataclass(frozen=True)
class Field:
    """A line of a table."""

    offset: str
    text: str
    """The type as written."""
    name: str
    formula: str = ""
    about: str = ""
    kind: str = "number"
    """The kind of field: ``const``, ``number``, ``bytes``, ``records``, ``ignored`` or ``sum``."""
    dtype: np.dtype = _BYTE
    shape: tuple[Any, ...] = ()
    """The counts, each a name until it is bound."""
    const: bytes = b""
    policy: str = "strict"
    """The treatment of a number that does not fit: ``strict`` (an error), ``wrap`` or ``clip``."""
    sum: Sum | None = None
    start: int = 0
    """The number of leading bytes that a sum leaves out."""
    record: Any = None
    """The table of its records."""

    @property
    def size(self) -> Any:
        """The number of bytes, ``None`` if it is not known."""
        if self.kind == "const":
            return len(self.const)
        if self.is_open or any(isinstance(count, str) for count in self.shape):
            return None
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def byte_order_name(self) -> Literal["little", "big"]:
        """The byte order as an argument of :meth:`int.to_bytes`."""
        return "big" if self.byte_order == ">" else "little"

    @property
    def is_open(self) -> bool:
        """True for a field of any length."""
        return self.kind in ("ignored", "records") or (self.kind == "bytes" and not self.shape)

    @property
    def is_single(self) -> bool:
        """True for one number, no array."""
        return self.kind == "number" and not self.shape

    @property
    def is_single_integer(self) -> bool:
        """True for one integer, no array."""
        return self.is_single and self.dtype.kind != "f"

    @property
    def byte_order(self) -> str:
        """The byte order: ``<``, ``>``, or empty for single bytes."""
        return self.dtype.str[0] if self.dtype.itemsize > 1 else ""

    @property
    def code(self) -> str:
        """The format of one number for :mod:`struct`."""
        return _CODES[self.dtype.str[1:]]

    @property
    def is_per_taxel(self) -> bool:
        """True if the first axis counts taxels."""
        return " x taxels" in self.text

    @property
    def words(self) -> str:
        """The type with bound counts."""
        if self.kind == "const" and not re.match("[0-9A-F]{2}( |$)", self.text):
            return self.const.hex(" ").upper()
        counts = iter(self.shape)
        return re.sub(r" x \w+", lambda found: f" x {next(counts, found[0][3:])}", self.text)

    def bound(self, values: Mapping[str, int]) -> Field:
        """Return the field with counts as numbers, and as a constant if ``values`` has its name."""
        if self.is_single_integer and self.name in values:
            return self.constant(values[self.name])
        return replace(self, shape=tuple(values.get(n, n) if isinstance(n, str) else n for n in self.shape))

    def constant(self, value: int) -> Field:
        """Return the field with a constant value."""
        return replace(self, kind="const", const=self.fitted("constant", np.asarray(value)).tobytes())

    def fitted(self, frame: str, values: np.ndarray) -> np.ndarray:
        """Return ``values`` as the field stores them, of its type.

        Raises:
            OverflowError: a value does not fit, and the field has neither ``wrap`` nor ``clip``.
            TypeError: the values are floats, the field holds integers.
        """
        if values.dtype == self.dtype or self.dtype.kind == "f":
            return values.astype(self.dtype, copy=False)
        if values.dtype.kind not in "iub":
            raise TypeError(
                f"{frame}: {self.name}: expected integers, got {values.dtype}: quantize in `measure`, with adc.quantize"
            )
        if self.policy == "clip":
            values = np.asarray(np.minimum(np.maximum(values, self.limits[0]), self.limits[1]))  # not a native scalar
        elif self.policy == "strict" and not self._holds(values):
            raise OverflowError(
                f"{frame}: {self.name}: {values.min()}..{values.max()} does not fit "
                f"{self.limits[0]}..{self.limits[1]}: clip in the ADC, or write `wrap` or `clip` behind its type"
            )
        return values.astype(self.dtype)

    @cached_property
    def limits(self) -> tuple[int, int]:
        """The smallest and the largest integer of its type."""
        return int(np.iinfo(self.dtype).min), int(np.iinfo(self.dtype).max)

    def _holds(self, values: np.ndarray) -> bool:
        low, high = self.limits
        # argmin and argmax take a third of the time of min and max on so few numbers.
        return not values.size or (low <= values.item(values.argmin()) and values.item(values.argmax()) <= high)


Header = tuple[str, str, "Identifier | None"]

_FORMULA = re.compile(r"(total|(?:len|count)\((\w+)\))\s*(?:([+-])\s*(\d+))?")
_HEADER = re.compile(r"([^,]+?)(?:,\s*id ([01a-z ]+?)\s*(?:\(([^)]*)\))?)?(?:,\s*(.*))?")
_TYPES = "types are hex bytes (55 AA), u1 <u2 >i4 ... with `x N`, f4, f8, bytes, ignored and " + ", ".join(SUMS)


def length_formula(formula: str) -> tuple[str, int]:
    """Return what a length or count is of (``total`` or the name of a field), and the number that it adds."""
    found = _FORMULA.fullmatch(formula)
    assert found is not None
    return found[2] or found[1], int((found[3] or "") + (found[4] or "0"))


@cache
def parse(text: str, records: tuple[tuple[str, Any], ...] = ()) -> tuple[Header, tuple[Field, ...]]:
    """Return header and fields of a table; ``records`` are the tables of records, by the names of their types.

    Raises:
        TableError: a line is wrong; the message has the frame, the field and the reason.
    """
    first, *lines = [line.strip() for line in text.splitlines() if line.strip()] or [""]
    header = _header(first)
    if not lines:
        raise TableError(f"{header[0]}: no fields")
    fields = []
    for line in lines:
        try:
            fields.append(_field(line, dict(records)))
        except TableError as error:
            raise TableError(f"{header[0]}: line {line!r}: {_name_in_type(line) or error}") from None
    _check_names(header[0], fields)
    _check_offsets(header[0], fields)
    return header, tuple(fields)


def _header(line: str) -> Header:
    found = _HEADER.fullmatch(line)
    if not found:
        raise TableError(f"the first line of a table is `name[, id BITS (letter part, ...)][, words]`, got {line!r}")
    name, bits, letters, about = found.groups()
    return name, about or "", _identifier(name, bits.replace(" ", ""), letters or "") if bits else None


def _identifier(frame: str, bits: str, letters: str) -> Identifier:
    parts = {name: letter for letter, name in (part.split() for part in letters.split(",") if part)}
    if len(bits) not in (11, 29):
        raise TableError(f"{frame}: id {bits}: a CAN identifier has 11 or 29 bits, got {len(bits)}")
    if set(parts.values()) != set(bits) - set("01"):
        raise TableError(f"{frame}: id {bits}: name its letters, as in (b board, t triangle); got ({letters})")
    if split := [letter for letter in parts.values() if letter * bits.count(letter) not in bits]:
        raise TableError(f"{frame}: id {bits}: the bits of {split[0]} must stand together")
    return Identifier(bits, parts)


def _field(line: str, records: Mapping[str, Any]) -> Field:
    columns = re.split(r"\s{2,}", line, maxsplit=3)
    begin, _, behind = columns[0].partition(" ")
    if len(columns) > 1 and behind and (begin.isdigit() or begin in ("..", "last")):
        raise TableError(f"offset {columns[0]!r}: put two spaces between the offset {begin!r} and the type {behind!r}")
    if len(columns) < 2:
        raise TableError("expected `offset  type  name  about`, in columns two spaces apart")
    offset, text, name, about = [*columns, "", ""][:4]
    name, equals, formula = (part.strip() for part in name.partition("="))
    field = Field(offset, text, name, formula, about)
    if not (offset.isdigit() or offset in ("..", "last")):
        raise TableError(f"offset {offset!r}: expected a decimal number, `..` or `last`")
    if equals and not _FORMULA.fullmatch(formula):
        raise TableError(f"formula {formula!r}: only lengths: `total - 5`, `len(data) + 2`, `count(records)`")
    if found := re.fullmatch(r"([0-9A-F]{2}(?: [0-9A-F]{2})*)(?: x (\d+))?", text):
        return replace(field, kind="const", const=bytes.fromhex(found[1]) * int(found[2] or 1))
    if not re.fullmatch(r"[A-Za-z]\w*", name) and text != "ignored":
        begin = re.match(r"[A-Za-z]\w*(?= )", name)
        hint = f"; put two spaces behind {begin[0]!r}" if begin else ""
        raise TableError(f"{name!r} is no name: letters, digits and _{hint}")
    if text.partition(" ")[0] in records:
        return _with_records(field, records)
    return _typed(field, *text.split())


_TYPE_AND_MORE = re.compile(
    r"((?:[<>]?[a-z][a-z0-9_]*|[0-9A-F]{2}(?: [0-9A-F]{2})*)(?: x \w+)*(?: wrap| clip)?(?: from \d+)?)"
    r" ((?!(?:x|from) |(?:wrap|clip)$)[A-Za-z]\w*(?: = .*)?)"
)


def _name_in_type(line: str) -> str:
    """Return the mistake of a line whose column of the type also holds the name; empty if it does not."""
    _, text, name, *_ = [*re.split(r"\s{2,}", line, maxsplit=3), "", ""]
    found = None if re.fullmatch(r"[A-Za-z]\w*( *=.*)?", name) else _TYPE_AND_MORE.fullmatch(text)
    return f"type {text!r}: put two spaces between the type {found[1]!r} and the name {found[2]!r}" if found else ""


def _with_records(field: Field, records: Mapping[str, Any]) -> Field:
    """Return the field with the table of its records, whose number another field counts."""
    kind, mark, count = [*field.text.split(), "", ""][:3]
    if mark != "x" or not re.fullmatch(r"[A-Za-z]\w*", count) or records[kind].size is None:
        raise TableError(f"type {field.text!r}: expected `{kind} x n`, with `n = count({field.name})`, of a fixed size")
    return replace(field, kind="records", record=records[kind])


def _typed(field: Field, word: str, *more: str) -> Field:
    """Return the field with the type that its words describe."""
    order, bare = (word[0], word[1:]) if word[0] in "<>" else ("", word)
    if bare in SUMS:
        return _with_sum(field, bare, order, more)
    words = list(more)
    shape: list[int | str] = []
    while words[:1] == ["x"] and len(words) > 1:
        shape.append(int(words[1]) if words[1].isdigit() else words[1])
        words = words[2:]
    if "taxels" in shape[1:]:
        raise TableError("taxels come first: `x taxels x 3`")
    if bare in ("bytes", "ignored") and not order and not words:
        return replace(field, kind=bare, shape=tuple(shape))
    if not re.fullmatch(r"[ui][1248]|f[48]", bare) or words not in ([], ["wrap"], ["clip"]):
        raise TableError(f"unknown type {field.text!r}: {_TYPES}")
    if bare[1] != "1" and not order:
        raise TableError(f"{word} needs a byte order, <{bare} or >{bare}")
    policy = words[0] if words else "strict"
    return replace(field, dtype=np.dtype(order + bare), shape=tuple(shape), policy=policy)


def _with_sum(field: Field, name: str, order: str, more: tuple[str, ...]) -> Field:
    if more and not (len(more) == 2 and more[0] == "from" and more[1].isdigit()):
        raise TableError(f"{' '.join(more)!r} behind a sum: expected `from N`")
    if SUMS[name].size > 1 and not order:
        raise TableError(f"{name} needs a byte order, <{name} or >{name}")
    dtype = np.dtype(f"{order}u{SUMS[name].size}")
    return replace(field, kind="sum", dtype=dtype, sum=SUMS[name], start=int(more[1]) if more else 0)


def _check_names(frame: str, fields: list[Field]) -> None:
    names = [field.name for field in fields if field.kind != "const"]
    if twice := {name for name in names if names.count(name) > 1}:
        raise TableError(f"{frame}: {sorted(twice)[0]!r} occurs twice: give each field its own name")
    if sum(field.is_open for field in fields) > 1:
        raise TableError(f"{frame}: more than one field of open length: give all but one a count or `bytes x N`")
    for field in fields:
        if not field.formula:
            continue
        of, _ = length_formula(field.formula)
        if not field.is_single_integer:
            raise TableError(f"{frame}: {field.name!r}: a length is one integer, got {field.text!r}")
        if of != "total" and of not in names:
            raise TableError(f"{frame}: {field.name!r} is the length of {of!r}, which is no field; there are {names}")


def _check_offsets(frame: str, fields: list[Field]) -> None:
    """Raise TableError if a written offset contradicts the sizes of the fields before it."""
    at: int | None = 0
    for k, field in enumerate(fields):
        what = field.name or field.text
        if field.offset == "last" and k < len(fields) - 1:
            raise TableError(f"{frame}: {what!r} is at `last`, but {fields[k + 1].name!r} comes after it")
        if field.offset.isdigit() and at is None:
            raise TableError(
                f"{frame}: {what!r} is at {field.offset}, but the size of the fields before it is not fixed: write `..`"
            )
        if field.offset.isdigit() and int(field.offset) != at:
            raise TableError(f"{frame}: {what!r} is at {field.offset}, but the fields before it end at {at}")
        if field.offset == ".." and at is not None:
            raise TableError(f"{frame}: {what!r} is at `..`, but the fields before it end at {at}: write {at}")
        if field.kind == "sum" and at is not None and field.start > at:
            raise TableError(f"{frame}: {what!r} sums from {field.start}, but is at {at}")
        at = None if at is None or field.size is None else at + field.size
