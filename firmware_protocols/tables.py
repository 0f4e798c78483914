"""Frames by table: one text is the datasheet, the encoder and the decoder.

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

First line: the name; for CAN the identifier's bits; anything else that a reader should know. Then a field a line, in
columns two spaces apart: offset, type, name (with ``= formula``), about.

=============== ====================================================================================================
offset          as the source gives it, decimal. It must be where the fields before it end; a table that contradicts
                itself does not import. ``..`` where that depends on a count; ``last`` for the last field
``55 AA``       constant bytes; ``00 x 26`` repeats
``u1 <i2 >u4``  integers of 1, 2, 4, 8 bytes with their byte order; ``f4 f8`` likewise
``x 3``         an array; ``x taxels`` as many as :meth:`Frame.bind` says, in wire order; ``x taxels x 3``: shape (n, 3)
``wrap clip``   what the firmware does with a number that does not fit. Without it that is an error
``bytes``       one field of open length, or ``bytes x 8``
``rest``        what the firmware does not look at
``crc16_modbus``    a sum of :data:`~firmware_protocols.sums.SUMS` over everything before it (with ``<`` or ``>`` from
                two bytes on), ``from N`` leaves out the first N
``= formula``   lengths [bytes]: ``total``, ``len(field)``, plus or minus a number. Filled in, and checked when read
``id 100 bbbb tttt (b board, t triangle)``  in the first line: the bits of a CAN identifier
=============== ====================================================================================================
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from itertools import groupby
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from firmware_protocols.table_lines import Field, Identifier, TableError, length_formula, parse

__all__ = ["Field", "Frame", "Identifier", "TableError"]


class Frame:
    """A table of bytes. Immutable; :meth:`bind` makes another one.

    Raises:
        TableError: at import, naming the frame, the field and what is wrong with its line.
    """

    name: str
    about: str
    """What the first line says besides: the order of the taxels in words."""
    id: Identifier | None
    """CAN identifier, if the table has one."""
    fields: tuple[Field, ...]
    size: int | None
    """Bytes, if that is fixed."""
    head: bytes
    """Constant bytes that every frame begins with: what :class:`~firmware_protocols.framing.Packets` looks for."""
    text: str
    """As it was written."""

    def __init__(self, text: str):
        self._compile(text, None, {})

    def bind(self, wire_order: ArrayLike | None = None, **values: int) -> Frame:
        """Return the table with every count a number, and any integer field a constant.

        Args:
            wire_order: index of the taxel sent first, second ...; fields per taxel are sent like that. Their number is
                ``taxels`` then.
            values: by the name of a count or of a field.

        Raises:
            TableError: no such count or field, or a constant that does not fit.
        """
        order = self._wire_order if wire_order is None else np.asarray(wire_order)
        if order is not None:
            values = {"taxels": len(order), **values}
        other = Frame.__new__(Frame)
        other._compile(self.text, order, {**self._bound, **values})
        return other

    # A frame is what its text and bindings say; the rest is compiled from them.

    def __getstate__(self) -> dict[str, Any]:
        return {"text": self.text, "wire_order": self._wire_order, "bound": self._bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._compile(state["text"], state["wire_order"], state["bound"])

    def __deepcopy__(self, memo: dict) -> Frame:
        return self

    # -- compiler --------------------------------------------------------------------------------------------------

    def _compile(self, text: str, order: np.ndarray | None, bound: Mapping[str, int]) -> None:
        self.text, self._wire_order, self._bound = text, order, dict(bound)
        header, fields = parse(text)
        self.name, self.about, self.id = header
        self._refuse_unknown(fields)
        self.fields = tuple(field.bound(bound) for field in fields)
        self._open = next((field.name for field in self.fields if field.is_open), None)
        sizes = [0 if field.is_open else field.size for field in self.fields]
        self._fixed = None if None in sizes else sum(size or 0 for size in sizes)
        self.size = None if self._open is not None else self._fixed
        self._lengths = self._measure()
        self.head = next((field.const for field in self.fields[:1] if field.kind == "const"), b"")
        self._parts = [] if self._fixed is None else self._in_parts()
        self._names = {f.name for f in self.fields if f.kind in ("number", "bytes")}
        if self._permutes():
            self._check_order()

    def _refuse_unknown(self, fields: tuple[Field, ...]) -> None:
        counts = {count for field in fields for count in field.shape if isinstance(count, str)}
        integers = {field.name for field in fields if field.is_single_integer and not field.formula}
        if unknown := set(self._bound) - counts - integers - {"taxels"}:
            raise TableError(
                f"{self.name}: cannot bind {', '.join(sorted(unknown))}: it has {sorted(counts | integers)}"
            )

    def _check_order(self) -> None:
        taxels = self._bound["taxels"]
        if sorted(self._wire_order.tolist()) != list(range(taxels)):  # type: ignore[union-attr]
            raise TableError(f"{self.name}: wire_order must hold each of 0..{taxels - 1} once")

    def _permutes(self) -> bool:
        return self._wire_order is not None and not np.array_equal(self._wire_order, np.arange(len(self._wire_order)))

    def _measure(self) -> dict[str, int]:
        """What to add to the size of the open field for each length; lengths that are fixed become constants."""
        if self._fixed is None:
            return {}
        lengths, fields = {}, list(self.fields)
        for k, field in enumerate(fields):
            if not field.formula:
                continue
            of, more = length_formula(field.formula)
            other = next((f for f in fields if f.name == of), None)
            value = more + (self._fixed if of == "total" else 0 if other is None or other.is_open else other.size or 0)
            if self._open is not None and of in ("total", self._open):
                lengths[field.name] = value
            else:
                fields[k] = field.constant(value)
        self.fields = tuple(fields)
        return lengths

    def _in_parts(self) -> list[_Run | _Open | _Sum]:
        """Neighbouring fields of known size together; the open one and sums alone."""
        order = self._wire_order if self._permutes() else None
        parts: list[_Run | _Open | _Sum] = []
        for alone, fields in groupby(self.fields, key=lambda field: field.is_open or field.kind == "sum"):
            if not alone:
                parts.append(_Run(self.name, list(fields), order))
            else:
                parts += [_Open(field) if field.is_open else _Sum(field) for field in fields]
        return parts

    # -- bytes -----------------------------------------------------------------------------------------------------

    def pack(self, **values: Any) -> bytes:
        """Return the frame of these values by field; constants, lengths and sums are filled in.

        Arrays have the shape that the table says, taxels in layout order, and hold integers.

        Raises:
            OverflowError: an integer that does not fit, in a field without ``wrap`` or ``clip``.
            TypeError: a field without value, a value without field, or a float where an integer belongs.
            ValueError: an array of another shape, or counts that are not bound.
        """
        if self._open is not None:
            size = len(values.setdefault(self._open, b"")) if self._open else 0
            for name, more in self._lengths.items():
                values[name] = size + more
        if values.keys() != self._names or not self._parts:
            self._refuse(values)
        data = b""
        for part in self._parts:
            data += part.pack(values, data)
        return data

    def _refuse(self, values: Mapping[str, Any]) -> NoReturn:
        if self._fixed is None:
            counts = {count for field in self.fields for count in field.shape if isinstance(count, str)}
            raise ValueError(f"{self.name}: how many? bind({', '.join(f'{count}=...' for count in sorted(counts))})")
        missing, odd = sorted(self._names - values.keys()), sorted(values.keys() - self._names)
        raise TypeError(f"{self.name}: missing {missing}, without field {odd}")

    def unpack(self, data: bytes) -> dict[str, Any] | None:
        """Values by field, arrays in layout order; ``None`` if a size, constant, length or sum does not fit.

        No second witness: it agrees with every mistake in the table.
        """
        if not self._parts:
            self._refuse({})
        size = len(data) - (self._fixed or 0)
        if size < 0 or (size and self._open is None):
            return None
        values: dict[str, Any] = {}
        at = 0
        for part in self._parts:
            end = at + (size if part.size is None else part.size)
            if not part.unpack(data, at, end, values):
                return None
            at = end
        if any(values[name] != size + more for name, more in self._lengths.items()):
            return None
        return values

    def rows(self, n: int, **values: ArrayLike) -> list[bytes]:
        """``n`` frames at once; each value is one for all, or has a first axis of ``n``.

        Raises:
            As :meth:`pack`; ValueError for a frame of open length.
        """
        if self._open is not None:
            raise ValueError(f"{self.name}: rows() is for frames of fixed size, {self._open!r} is open")
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

    def place(self, name: str) -> slice:
        """Where a field lies in the frame.

        Raises:
            KeyError: there is none of this name, or what is before it has no fixed size.
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


_FEW = 16
"""Numbers that one struct packs faster than NumPy."""


class _Run:
    """Fields of known size that are packed by one struct; arrays go in as bytes."""

    def __init__(self, frame: str, fields: list[Field], order: np.ndarray | None):
        self._frame, self._fields = frame, fields
        self._orders = [order if field.per_taxel else None for field in fields]
        byte_order = next((f.byte_order for f in fields if f.is_single and f.byte_order), "<")
        direct = [f.is_single and f.byte_order in ("", byte_order) for f in fields]
        self._struct = struct.Struct(
            byte_order + "".join(f.code if d else f"{f.size}s" for f, d in zip(fields, direct))
        )
        self.size: int | None = self._struct.size
        self._items: list[tuple[str | None, Any]] = [
            (None, field.const) if field.kind == "const" else (field.name, self._encoder(field, order, as_it_is))
            for field, order, as_it_is in zip(fields, self._orders, direct)
        ]
        self._decoders = [None if d else self._decoder(f, o) for f, o, d in zip(fields, self._orders, direct)]

    def _encoder(self, field: Field, order: np.ndarray | None, direct: bool) -> Callable[[Any], Any] | None:
        """What makes a value ready for the struct; ``None``: it is."""
        if direct:
            return None if field.policy == "strict" else lambda value: int(field.fitted(self._frame, np.asarray(value)))
        if field.kind == "bytes":
            return lambda value: self._exactly(field, bytes(value))
        if order is not None:
            return lambda value: self._array(field, value, order).tobytes()
        if field.policy == "strict" and np.prod(field.shape, dtype=int) <= _FEW:
            packer = struct.Struct((field.byte_order or "<") + field.code * int(np.prod(field.shape, dtype=int)))
            return lambda value: self._few(field, packer, value)
        return lambda value: self._array(field, value).tobytes()

    def _few(self, field: Field, packer: struct.Struct, value: ArrayLike) -> bytes:
        values = np.asarray(value)
        if values.shape != field.shape:
            self._array(field, values)
        try:
            return packer.pack(*values.ravel().tolist())
        except struct.error:
            return self._array(field, values).tobytes()

    def _array(self, field: Field, value: ArrayLike, order: np.ndarray | None = None) -> np.ndarray:
        values = np.asarray(value)
        if values.shape != field.shape:
            raise ValueError(f"{self._frame}: {field.name}: expected shape {field.shape}, got {values.shape}")
        return field.fitted(self._frame, values if order is None else values[order])

    def _exactly(self, field: Field, value: bytes) -> bytes:
        if len(value) != field.size:
            raise ValueError(f"{self._frame}: {field.name}: expected {field.size} bytes, got {len(value)}")
        return value

    @staticmethod
    def _decoder(field: Field, order: np.ndarray | None) -> Callable[[bytes], Any] | None:
        if field.kind in ("const", "bytes"):
            return None
        if field.is_single:
            return lambda raw: np.frombuffer(raw, field.dtype)[0].item()
        inverse = slice(None) if order is None else np.argsort(order)
        return lambda raw: np.frombuffer(raw, field.dtype).reshape(field.shape)[inverse]

    def pack(self, values: Mapping[str, Any], before: bytes) -> bytes:
        try:
            return self._struct.pack(
                *[
                    encode if name is None else values[name] if encode is None else encode(values[name])
                    for name, encode in self._items
                ]
            )
        except struct.error:
            for field in self._fields:
                if field.is_single:
                    field.fitted(self._frame, np.asarray(values[field.name]))
            raise

    def unpack(self, data: bytes, at: int, end: int, values: dict[str, Any]) -> bool:
        for (name, encode), decode, raw in zip(self._items, self._decoders, self._struct.unpack_from(data, at)):
            if name is not None:
                values[name] = raw if decode is None else decode(raw)
            elif raw != encode:
                return False
        return True

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        for field, order in zip(self._fields, self._orders):
            block = frames[:, at : at + field.size]
            at += field.size
            if field.kind == "const":
                block[:] = np.frombuffer(field.const, np.uint8)
            elif field.kind == "bytes":
                block[:] = np.frombuffer(self._exactly(field, values[field.name]), np.uint8)
            else:
                column = np.asarray(values[field.name])
                if column.shape not in ((), field.shape, (len(frames), *field.shape)):
                    raise ValueError(
                        f"{self._frame}: {field.name}: expected shape {(len(frames), *field.shape)}, got {column.shape}"
                    )
                column = np.broadcast_to(field.fitted(self._frame, column), (len(frames), *field.shape))
                column = column if order is None else column[:, order]
                block[:] = np.ascontiguousarray(column).view(np.uint8).reshape(len(frames), -1)


class _Open:
    """The field of open length."""

    size = None

    def __init__(self, field: Field):
        self._name = field.name if field.kind == "bytes" else None

    def pack(self, values: Mapping[str, Any], before: bytes) -> bytes:
        return values[self._name] if self._name is not None else b""

    def unpack(self, data: bytes, at: int, end: int, values: dict[str, Any]) -> bool:
        if self._name is not None:
            values[self._name] = bytes(data[at:end])
        return True

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        raise AssertionError("rows() is for frames of fixed size")


class _Sum:
    """A checksum over what stands before it."""

    def __init__(self, field: Field):
        self._start = field.start
        self._order: Literal["little", "big"] = field.byte_order_name
        assert field.sum is not None
        self._function, self.size = field.sum

    def pack(self, values: Mapping[str, Any], before: bytes) -> bytes:
        return self._function(before[self._start :]).to_bytes(self.size, self._order)

    def unpack(self, data: bytes, at: int, end: int, values: dict[str, Any]) -> bool:
        return self.pack(values, data[:at]) == data[at:end]

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        for frame in frames:
            frame[at:end] = np.frombuffer(self.pack(values, frame[:at].tobytes()), np.uint8)
