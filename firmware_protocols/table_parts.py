"""The parts of a frame table, each of which packs and unpacks its bytes: runs of fixed fields, the open field, sums."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from firmware_protocols.table_lines import Field

_MAX_STRUCT_NUMBERS = 16
"""The largest number of elements that one struct packs faster than NumPy."""


class FixedFields:
    """A run of fields of known size, packed by one struct; arrays are packed as bytes."""

    def __init__(self, frame: str, fields: list[Field], order: np.ndarray | None):
        self._frame, self._fields = frame, fields
        self._orders = [order if field.is_per_taxel else None for field in fields]
        byte_order = next((f.byte_order for f in fields if f.is_single and f.byte_order), "<")
        direct = [f.is_single and f.byte_order in ("", byte_order) for f in fields]
        self._struct = struct.Struct(
            byte_order + "".join(f.code if d else f"{f.size}s" for f, d in zip(fields, direct))
        )
        self.size: int | None = self._struct.size
        self._items: list[tuple[str | None, Any]] = [
            (None, field.const) if field.kind == "const" else (field.name, self._encoder(field, order, is_direct))
            for field, order, is_direct in zip(fields, self._orders, direct)
        ]
        self._decoders = [None if d else self._decoder(f, o) for f, o, d in zip(fields, self._orders, direct)]

    def _encoder(self, field: Field, order: np.ndarray | None, is_direct: bool) -> Callable[[Any], Any] | None:
        """Return the function that converts a value for the struct; ``None`` if it needs none."""
        if is_direct:
            return None if field.policy == "strict" else lambda value: int(field.fitted(self._frame, np.asarray(value)))
        if field.is_single and field.policy == "strict":
            return struct.Struct(field.byte_order + field.code).pack
        if field.kind == "bytes":
            return lambda value: self._exactly(field, bytes(value))
        if order is not None:
            return lambda value: self._array(field, value, order).tobytes()
        if field.policy == "strict" and np.prod(field.shape, dtype=int) <= _MAX_STRUCT_NUMBERS:
            packer = struct.Struct((field.byte_order or "<") + field.code * int(np.prod(field.shape, dtype=int)))
            return lambda value: self._pack_few(field, packer, value)
        return lambda value: self._array(field, value).tobytes()

    def _pack_few(self, field: Field, packer: struct.Struct, value: ArrayLike) -> bytes:
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
        """Return the bytes of these fields; ``before`` are those of the parts before."""
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
        """Read these fields from ``data[at:end]`` into ``values``; return False if the bytes contradict the table."""
        for (name, encode), decode, raw in zip(self._items, self._decoders, self._struct.unpack_from(data, at)):
            if name is not None:
                values[name] = raw if decode is None else decode(raw)
            elif raw != encode:
                return False
        return True

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        """Write these fields into the columns ``at:end`` of ``frames``, uint8, shape ``(n, size)``."""
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


class OpenField:
    """The field of open length."""

    size = None

    def __init__(self, field: Field):
        self._name = field.name if field.kind in ("bytes", "records") else None
        self._record = field.record

    def pack(self, values: Mapping[str, Any], before: bytes) -> bytes:
        """Return the bytes of the field; none if the firmware ignores them."""
        if self._record is not None and self._name is not None:
            return b"".join(self._record.pack(**each) for each in values[self._name])
        return values[self._name] if self._name is not None else b""

    def unpack(self, data: bytes, at: int, end: int, values: dict[str, Any]) -> bool:
        """Read the field, if it is named, from ``data[at:end]`` into ``values``; return False if a record is wrong."""
        if self._record is not None and self._name is not None:
            starts = range(at, end, self._record.size)
            found = [self._record.unpack(data[start : min(start + self._record.size, end)]) for start in starts]
            values[self._name] = found
            return None not in found
        if self._name is not None:
            values[self._name] = bytes(data[at:end])
        return True

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        """Raise AssertionError: a table with an open field has no frames of one size."""
        raise AssertionError("pack_many() needs a frame of fixed size")


class SumField:
    """A checksum over the bytes before it."""

    def __init__(self, field: Field):
        self._start = field.start
        self._order: Literal["little", "big"] = field.byte_order_name
        assert field.sum is not None
        self._function, self.size = field.sum

    def pack(self, values: Mapping[str, Any], before: bytes) -> bytes:
        """Return the bytes of the sum; ``before`` are those of the parts before."""
        return self._function(before[self._start :]).to_bytes(self.size, self._order)

    def unpack(self, data: bytes, at: int, end: int, values: dict[str, Any]) -> bool:
        """Return True if ``data[at:end]`` is the sum of the bytes before it."""
        return self.pack(values, data[:at]) == data[at:end]

    def fill(self, frames: np.ndarray, at: int, end: int, values: Mapping[str, Any]) -> None:
        """Write the sum into the columns ``at:end`` of ``frames``, uint8, shape ``(n, size)``."""
        for frame in frames:
            frame[at:end] = np.frombuffer(self.pack(values, frame[:at].tobytes()), np.uint8)
