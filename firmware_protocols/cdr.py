"""CDR, the bytes of messages in DDS and ROS 2, version 1, little-endian.

Every number is aligned to its size, counted from the first byte after the header. A text, an array and a list of texts
have their length in front. :mod:`firmware_protocols.idl` reads types from IDL; here they are ``ros2msg`` definitions.

Other libraries have this too. For the truth log they were weighed and left: rosbags would bring SQLite, YAML and two
compressors into every installation, and its generated readers are no faster than these hundred lines.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

HEADER = b"\x00\x01\x00\x00"
"""The first bytes of a message: version 1, little-endian."""
NUMBERS = {
    "bool": "?", "int8": "b", "int16": "h", "int32": "i", "int64": "q",
    "uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
"""The types of number, with their codes in :mod:`struct` and NumPy."""
_LENGTH = struct.Struct("<I")


def dtype_of(number: str) -> np.dtype:
    """Return the NumPy type of a type of number, such as ``uint16`` or ``float32``.

    Raises:
        KeyError: there is no such type.
    """
    return np.dtype(f"<{NUMBERS[number]}")


@dataclass(frozen=True, slots=True)
class Member:
    """One member of a type."""

    name: str
    type: str
    """A type of number, ``string``, or the full name of another type."""
    sequence: bool = False
    count: int = 0
    """The number of elements of an array of fixed size; 0 for a single value."""


def members_of(definition: str) -> tuple[Member, ...]:
    """Return the members in a ``ros2msg`` definition: lines of a type and a name, and comments after ``#``.

    Raises:
        ValueError: a line has other words.
    """
    lines = [line.split() for line in definition.splitlines() if not line.startswith("#")]
    return tuple(Member(name, kind.removesuffix("[]"), kind.endswith("[]")) for kind, name in lines)


class Codec:
    """A converter between the values of a type and their bytes.

    Args:
        members: numbers, texts, and sequences of them.

    Raises:
        KeyError: a type is neither.
    """

    def __init__(self, members: Sequence[Member]):
        text, size, n = "<", 0, 0
        for each in members:
            if each.sequence or each.type not in NUMBERS:
                break
            own = dtype_of(each.type).itemsize
            text += f"{-size % own}x{NUMBERS[each.type]}"
            size, n = size + -size % own + own, n + 1
        self._first, self._first_count = struct.Struct(text), n
        """The numbers at fixed places, before the first text or sequence."""
        types = [None if each.type == "string" else dtype_of(each.type) for each in members[n:]]
        self._others = [
            (each.sequence, dtype, 0 if dtype is None else dtype.itemsize) for each, dtype in zip(members[n:], types)
        ]

    def encode(self, values: Sequence[Any]) -> bytes:
        """Return a message; arrays must have the types of the members."""
        n, at = self._first_count, self._first.size
        parts: list[Any] = [HEADER, self._first.pack(*values[:n])]
        for (is_sequence, dtype, size), value in zip(self._others, values[n:]):
            pieces = [(_LENGTH.pack(np.size(value)), 4)] if is_sequence else []
            if dtype is None:
                texts = [each.encode("utf-8", "replace") + b"\0" for each in (value if is_sequence else (value,))]
                pieces += [(_LENGTH.pack(len(text)) + text, 4) for text in texts]
            elif np.size(value):
                pieces.append((np.asarray(value, dtype).tobytes(), size))
            for data, align in pieces:
                gap = -at % align
                parts += (bytes(gap), data)
                at += gap + len(data)
        return b"".join(parts)

    def decode(self, data: bytes) -> list[Any]:
        """Return the values of a message; arrays are flat and share its memory.

        Raises:
            ValueError, struct.error: it is shorter than its members claim.
        """
        body = memoryview(data)[len(HEADER) :]
        values: list[Any] = [*self._first.unpack_from(body)]
        at = self._first.size

        def take_length() -> int:
            nonlocal at
            start = at + -at % _LENGTH.size
            at = start + _LENGTH.size
            return _LENGTH.unpack_from(body, start)[0]

        def take_text() -> str:
            nonlocal at
            length = take_length()
            at += length
            if not length or at > len(body):
                raise ValueError("a text does not fit its message")
            return str(body[at - length : at - 1], "utf-8")

        for is_sequence, dtype, size in self._others:
            count = take_length() if is_sequence else 1
            if dtype is None:
                found: Any = tuple([take_text() for _ in range(count)])
                values.append(found if is_sequence else found[0])
                continue
            start = at + (-at % size if count else 0)
            at = start + count * size
            found = np.frombuffer(body, dtype, count, start) if count else np.zeros(0, dtype)
            values.append(found if is_sequence else found.item())
        return values
