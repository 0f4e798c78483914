"""Frame tables: one text is the datasheet, the encoder and the decoder of a frame.

    READING = Frame('''
        reading, row by row
        0     9A                start
        1     00                crc
        2     u1                command
        3     u1                length = total - 4
        4     >u2 x taxels      touch              counts at rest: 1000
        ..    >i2 clip          warmth             [0.01 deg C]
        last  sum8 from 2       sum
    ''')
    reading = READING.bind(wire_order=layout.wire_order)
    reading.pack(command=0x61, touch=counts, warmth=2500)

First line: the name; for CAN the identifier's bits; any remark for the reader. Then one field a line, in columns two
spaces apart: offset, type, name (with ``= formula``), about.

=============== ====================================================================================================
offset          as the source gives it, decimal. It must equal the end of the fields before it; a table that contradicts
                itself does not import. ``..`` where that depends on a count; ``last`` for the last field
``55 AA``       constant bytes; ``00 x 26`` repeats
``u1 <i2 >u4``  integers of 1, 2, 4, 8 bytes with their byte order; ``f4 f8`` likewise
``x 3``         an array; ``x taxels``: one per taxel, in the wire order of :meth:`Frame.bind`; ``x taxels x 3``:
                shape (n, 3)
``wrap clip``   the firmware's treatment of a number that does not fit. Without it, such a number is an error
``bytes``       one field of open length, or ``bytes x 8``
``ignored``     bytes that the firmware ignores, of any number
``crc16_modbus``    a sum of :data:`~firmware_protocols.sums.SUMS` over all bytes before it (with ``<`` or ``>`` from
                two bytes on); ``from N`` leaves out the first N
``CONTACT x n``  records of another table, ``Frame(text, CONTACT=CONTACT)``, counted by ``n = count(field)``
``= formula``   lengths [bytes]: ``total``, ``len(field)``, and numbers of records: ``count(field)``; plus or minus a
                number. Filled in, and checked when read
``id 100 bbbb tttt (b board, t triangle)``  in the first line: the bits of a CAN identifier
=============== ====================================================================================================
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cached_property
from itertools import groupby
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from firmware_protocols.table_lines import Field, Identifier, TableError, length_formula, parse
from firmware_protocols.table_parts import FixedFields, OpenField, SumField

__all__ = ["Field", "Frame", "Identifier", "TableError"]


class Frame:
    """The table of a frame. Immutable; :meth:`bind` makes another one.

    Raises:
        TableError: a line is wrong, at import; the message has the frame, the field and the reason.
    """

    name: str
    about: str
    """The remark in the first line: the order of the taxels in words."""
    id: Identifier | None
    """The CAN identifier, if the table has one."""
    fields: tuple[Field, ...]
    open_field: str | None
    """The name of the field of open length, if there is one."""
    size: int | None
    """The number of bytes, if it is fixed."""
    head: bytes
    """The constant bytes that every frame begins with, for :class:`~firmware_protocols.framing.Packets`."""
    text: str
    """The table as written."""

    def __init__(self, text: str, **records: Frame):
        self._records = records
        self._compile(text, None, {})

    def bind(self, wire_order: ArrayLike | None = None, **values: int) -> Frame:
        """Return the table with numbers for its counts, and constants for any of its integer fields.

        Args:
            wire_order: index of the taxel sent first, second ..., for fields per taxel; it also sets ``taxels``.
            values: numbers by the name of a count or of a field.

        Raises:
            TableError: there is no such count or field, or a constant does not fit.
        """
        order = self._wire_order if wire_order is None else np.asarray(wire_order)
        if order is not None:
            values = {"taxels": len(order), **values}
        other = Frame.__new__(Frame)
        other._records = self._records
        other._compile(self.text, order, {**self._bound, **values})
        return other

    # Text and bindings define a frame; everything else is compiled from them.

    def __getstate__(self) -> dict[str, Any]:
        return {"text": self.text, "wire_order": self._wire_order, "bound": self._bound, "records": self._records}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._records = state["records"]
        self._compile(state["text"], state["wire_order"], state["bound"])

    def __deepcopy__(self, memo: dict) -> Frame:
        return self

    # -- compiler --------------------------------------------------------------------------------------------------

    def _compile(self, text: str, order: np.ndarray | None, bound: Mapping[str, int]) -> None:
        self.text, self._wire_order, self._bound = text, order, dict(bound)
        header, fields = parse(text, tuple(self._records.items()))
        self.name, self.about, self.id = header
        self._refuse_unknown(fields)
        self.fields = tuple(field.bound(bound) for field in fields)
        is_open = next((field for field in self.fields if field.is_open), None)
        self.open_field = is_open.name if is_open else None
        self._unit = is_open.record.size if is_open and is_open.record else 1
        sizes = [0 if field.is_open else field.size for field in self.fields]
        self._fixed = None if None in sizes else sum(size or 0 for size in sizes)
        self.size = None if self.open_field is not None else self._fixed
        self._lengths = self._find_lengths()
        self.head = next((field.const for field in self.fields[:1] if field.kind == "const"), b"")
        self._parts = [] if self._fixed is None else self._build_parts()
        self._names = {f.name for f in self.fields if f.kind in ("number", "bytes", "records")}
        if self._permutes():
            self._check_order()

    def _refuse_unknown(self, fields: tuple[Field, ...]) -> None:
        counts = {count for field in fields for count in field.shape if isinstance(count, str)}
        integers = {field.name for field in fields if field.is_single_integer and not field.formula}
        if unknown := set(self._bound) - counts - integers - {"taxels"}:
            raise TableError(
                f"{self.name}: cannot bind {', '.join(sorted(unknown))}: the table has {sorted(counts | integers)}"
            )

    def _check_order(self) -> None:
        taxels = self._bound["taxels"]
        if sorted(self._wire_order.tolist()) != list(range(taxels)):  # type: ignore[union-attr]
            raise TableError(f"{self.name}: wire_order must hold each of 0..{taxels - 1} once")

    def _permutes(self) -> bool:
        return self._wire_order is not None and not np.array_equal(self._wire_order, np.arange(len(self._wire_order)))

    def _find_lengths(self) -> dict[str, tuple[int, int]]:
        """Return the unit of each length in bytes of the open field, and the number to add; make those that are fixed
        constants."""
        if self._fixed is None:
            return {}
        lengths, fields = {}, list(self.fields)
        for k, field in enumerate(fields):
            if not field.formula:
                continue
            of, more = length_formula(field.formula)
            other = next((f for f in fields if f.name == of), None)
            value = more + (self._fixed if of == "total" else 0 if other is None or other.is_open else other.size or 0)
            if self.open_field is not None and of in ("total", self.open_field):
                lengths[field.name] = self._unit if field.formula.startswith("count") else 1, value
            else:
                fields[k] = field.constant(value)
        self.fields = tuple(fields)
        return lengths

    def _build_parts(self) -> list[FixedFields | OpenField | SumField]:
        """Return the parts of the frame: runs of neighbouring fields of known size; the open field and sums alone."""
        order = self._wire_order if self._permutes() else None
        parts: list[FixedFields | OpenField | SumField] = []
        for is_single, fields in groupby(self.fields, key=lambda field: field.is_open or field.kind == "sum"):
            if not is_single:
                parts.append(FixedFields(self.name, list(fields), order))
            else:
                parts += [OpenField(field) if field.is_open else SumField(field) for field in fields]
        return parts

    # -- bytes -----------------------------------------------------------------------------------------------------

    def pack(self, **values: Any) -> bytes:
        """Return the frame of these values by field, with constants, lengths and sums filled in.

        Arrays have the shape in the table, taxels in layout order, and hold integers.

        Raises:
            OverflowError: an integer does not fit, and its field has neither ``wrap`` nor ``clip``.
            TypeError: a field has no value, a value no field, or a float is given for an integer.
            ValueError: an array has another shape, or a count is not bound.
        """
        if self.open_field is not None:
            n = len(values.setdefault(self.open_field, b"")) if self.open_field else 0
            for name, (unit, more) in self._lengths.items():
                values[name] = n * self._unit // unit + more
        if values.keys() != self._names or not self._parts:
            self._refuse(values)
        data = b""
        for part in self._parts:
            data += part.pack(values, data)
        return data

    def _refuse(self, values: Mapping[str, Any]) -> NoReturn:
        if self._fixed is None:
            counts = {count for field in self.fields for count in field.shape if isinstance(count, str)}
            missing = ", ".join(f"{count}=..." for count in sorted(counts))
            raise ValueError(f"{self.name}: its counts are not bound: call bind({missing}) first")
        missing, odd = sorted(self._names - values.keys()), sorted(values.keys() - self._names)
        raise TypeError(f"{self.name}: no value for the fields {missing}, no field for the values {odd}")

    def unpack(self, data: bytes) -> dict[str, Any] | None:
        """Return the values by field, arrays in layout order; ``None`` if a size, constant, length or sum does not fit.

        This cannot verify :meth:`pack`: both share every mistake in the table.
        """
        return self.read(data)[0]

    def read(self, data: bytes) -> tuple[dict[str, Any] | None, str]:
        """Return what :meth:`unpack` returns, and the counter of the frame's flaw.

        The flaw is ``bad_checksum``, then ``bad_tail``; it is empty where only the size or a length does not fit.
        """
        if not self._parts:
            self._refuse({})
        size, at, flaw = len(data) - (self._fixed or 0), 0, ""
        if size < 0 or (size and self.open_field is None):
            return None, ""
        values: dict[str, Any] = {}
        for part in self._parts:
            end = at + (size if part.size is None else part.size)
            if not part.unpack(data, at, end, values):
                if isinstance(part, SumField):
                    return None, "bad_checksum"
                flaw = "bad_tail"
            at = end
        if flaw:
            return None, flaw
        for name, (unit, more) in self._lengths.items():
            if values[name] != size // unit + more:
                return None, ""
        return values, ""

    def length_of(self, data: bytes, most: int | None = None) -> int | str:
        """Return the length of the frame that begins ``data``, 0 while its length field is missing.

        Args:
            data: bytes that begin with the frame's head.
            most: the largest length of the field of open length; ``None``: any.

        Returns:
            The length in bytes; ``"bad_length"`` if the length field contradicts the table, or is too large.

        Raises:
            TypeError: the table states no length.
        """
        if self.size is not None:
            return self.size
        stop, packer, unit, more = self._stated_length
        if len(data) < stop:
            return 0
        size = (packer.unpack_from(data, stop - packer.size)[0] - more) * unit
        return "bad_length" if size < 0 or (most is not None and size > most) else (self._fixed or 0) + size

    @cached_property
    def _stated_length(self) -> tuple[int, struct.Struct, int, int]:
        """The end and the format of the first length, its unit, and the number that it adds."""
        for name, (unit, more) in self._lengths.items():
            field = next(field for field in self.fields if field.name == name)
            return self.slice_of(name).stop, struct.Struct((field.byte_order or "<") + field.code), unit, more
        raise TypeError(f"{self.name}: no field states its length: write `= len({self.open_field})` or `= total`")

    def pack_many(self, n: int, **values: ArrayLike) -> list[bytes]:
        """Return ``n`` frames; each value is one for all, or has a first axis of ``n``.

        Raises:
            OverflowError, TypeError: as :meth:`pack`.
            ValueError: as :meth:`pack`, or the frame has an open length.
        """
        if self.open_field is not None:
            raise ValueError(
                f"{self.name}: pack_many() needs a frame of fixed size, {self.open_field!r} is open: use pack()"
            )
        if values.keys() != self._names or self.size is None:
            self._refuse(values)
        if n == 0:
            return []
        frames = np.empty((n, self.size), np.uint8)
        at = 0
        for part in self._parts:
            end = at + (part.size or 0)
            part.fill(frames, at, end, values)
            at = end
        data = frames.tobytes()
        return [data[start : start + self.size] for start in range(0, n * self.size, self.size)]

    def slice_of(self, name: str) -> slice:
        """Return the bytes of a field as a slice of the frame.

        Raises:
            KeyError: there is no field of this name, or the fields before it have no fixed size.
        """
        at = 0
        for field in self.fields:
            if field.name == name and field.size is not None:
                return slice(at, at + field.size)
            if field.size is None:
                break
            at += field.size
        raise KeyError(f"{self.name}: no field {name!r} at a fixed place")

    def __str__(self) -> str:
        """Return the table as a datasheet prints it, with bound counts and offsets in place."""
        rows, at = [], 0
        for field in self.fields:
            name = f"{field.name} = {field.formula}" if field.formula else field.name
            rows.append((field.offset if at is None else str(at), field.words, name, field.about))
            at = None if at is None or field.size is None else at + field.size
        widths = [max(len(row[column]) for row in rows) for column in range(3)]
        lines = ["  ".join([*(cell.ljust(width) for cell, width in zip(row, widths)), row[3]]).rstrip() for row in rows]
        header = ", ".join(part for part in (self.name, f"id {self.id}" if self.id else "", self.about) if part)
        return "\n".join([header, *("  " + line for line in lines)])
