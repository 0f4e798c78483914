"""Registers from a table: the memory of a firmware that its host reads and writes, by any protocol.

    MAP = RegisterMap('''
        1000  u1          unit           1..254  = 1       flash     from the next power-up
        1486  <i2 x 6     angle_set      -1..1000  = -1              -1: stay
        1582  <i2 x 6     force          -4000..4000       r         [g]
        2000  <u2 sign 11  offset                          flash     sign and magnitude, sign in bit 11
        2002  <u2 sign 15 x 3  goals                                 three of them
    ''', size=6000)

    self.registers = Registers(MAP, kept=self.flash)      # in __init__, which is power-up
    self.registers["force"] = forces                      # rounded, limited to the range; bytes as they are
    self.registers["unit"]                                # a number; .all("force") is the list
    self.flash.update(self.registers.kept())              # where the firmware saves

A line is byte address (decimal), type, name, then, each optional: ``low..high``, ``= default`` (several with commas),
access (``r``, ``w``, ``rw``; default ``rw``), ``flash`` for a register that survives power-off, and a remark. Types are
``u1 i1``, ``<u2 <i2 <u4 <i4 <f4`` and the same with ``>``.

**The interface** is :class:`Memory`: ``read(address, n, t_ns)`` and ``write(address, data, t_ns)`` in bytes. Protocols
(:mod:`firmware_protocols.protocols`) use it. A device whose registers follow its state, or act, is a memory itself: it
updates the registers before it reads them, and acts on the register names that ``write`` returns.
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

Why = Literal["address", "access", "value", "function", "busy", "failure"]


class Refused(Exception):
    """A read or write that the firmware refuses; each protocol has its own answer to it."""

    def __init__(self, why: Why):
        super().__init__(why)
        self.why: Why = why


def one_of(choices: Any, index: int) -> Any:
    """Return the choice with this index.

    Raises:
        Refused: there is none.
    """
    if not 0 <= index < len(choices):
        raise Refused("value")
    return choices[index]


class Memory(Protocol):
    """The memory that a protocol reads and writes, by byte address."""

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return ``n`` bytes; may raise :class:`Refused`."""
        ...

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store ``data`` and return the names of the registers in it, or raise :class:`Refused` and store nothing."""
        ...


_CODES = {"u1": "B", "i1": "b", "u2": "H", "i2": "h", "u4": "I", "i4": "i", "f4": "f"}


@dataclass(frozen=True)
class Reg:
    """A line of the table: ``count`` numbers from ``address``."""

    address: int
    name: str
    type: str = "<u2"
    count: int = 1
    low: float | None = None
    """The smallest number that a host may write or read; ``None``: the smallest of the type. ``high`` likewise."""
    high: float | None = None
    default: float | tuple[float, ...] = 0
    access: Literal["rw", "r", "w"] = "rw"
    flash: bool = False
    """True if it survives power-off."""
    sign_bit: int | None = None
    """The bit of the sign, for numbers stored as sign and magnitude."""
    about: str = ""

    @cached_property
    def format(self) -> str:
        """The format of all its numbers for :mod:`struct`."""
        return f"{self.type[0] if self.type[0] in '<>' else '<'}{self.count}{_CODES[self.type.lstrip('<>')]}"

    @cached_property
    def end(self) -> int:
        """The address of the first byte after it."""
        return self.address + struct.calcsize(self.format)

    @cached_property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest number that it holds."""
        bits = 8 * int(self.type[-1])
        if self.sign_bit is not None:
            low, high = -(1 << self.sign_bit) + 1, (1 << self.sign_bit) - 1
        elif self.type[-2] == "f":
            low, high = -np.inf, np.inf
        else:
            low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.type[-2] == "i" else (0, (1 << bits) - 1)
        return (low if self.low is None else self.low, high if self.high is None else self.high)

    def encode(self, values: ArrayLike | bytes) -> bytes:
        """Return the bytes of ``values``, rounded and limited to the range; one value stands for all numbers.

        Bytes, such as a text in ASCII, are cut to its length or padded with zeros.
        """
        if isinstance(values, bytes):
            return values[: self.end - self.address].ljust(self.end - self.address, b"\0")
        low, high = self.range
        if type(values) is int and self.count == 1 and self.sign_bit is None:  # the usual case, fast
            return struct.pack(self.format, min(max(values, low), high))
        numbers = np.broadcast_to(np.minimum(np.maximum(np.asarray(values, float), low), high), self.count)
        if self.type[-2] != "f":
            numbers = np.rint(numbers).astype(np.int64)
        if self.sign_bit is not None:
            numbers = np.abs(numbers) | (numbers < 0).astype(np.int64) << self.sign_bit
        return numbers.astype(self.type).tobytes()

    def decode(self, memory: bytes | bytearray) -> list[Any]:
        """Return its numbers in ``memory``."""
        numbers = struct.unpack_from(self.format, memory, self.address)
        if self.sign_bit is None:
            return list(numbers)
        sign, magnitude = 1 << self.sign_bit, (1 << self.sign_bit) - 1
        return [-(n & magnitude) if n & sign else n & magnitude for n in numbers]


class RegisterMap:
    """The checked lines of a table. Immutable; one for all devices of a class.

    Args:
        rows: a text as above, or :class:`Reg` s in any order.
        size: bytes of memory. By default it ends with the last register.
        writable: address ranges ``(first, end)`` in which a host may also write between registers; this only stores.
        gaps: whether a read may include bytes between registers, which are 0 then.

    Raises:
        ValueError: a line cannot be read, overlaps another one, or its default is out of range; the message names it.
    """

    def __init__(
        self,
        rows: str | Iterable[Reg],
        *,
        size: int | None = None,
        writable: Iterable[tuple[int, int]] = (),
        gaps: bool = True,
    ):
        regs = [_reg(line.strip()) for line in rows.splitlines() if line.strip()] if isinstance(rows, str) else rows
        self.rows = tuple(sorted(regs, key=lambda reg: reg.address))
        self.by_name = {reg.name: reg for reg in self.rows}
        self.size = max((reg.end for reg in self.rows), default=0) if size is None else size
        _check(self.rows, self.size)
        self.starts = [reg.address for reg in self.rows]
        self._access = self._accesses(writable, b"rw" if gaps else b"-")

    def __deepcopy__(self, memo: dict) -> RegisterMap:
        return self

    def _accesses(self, writable: Iterable[tuple[int, int]], gap: bytes) -> dict[str, bytes]:
        """Return, for ``read`` and ``write``, a code for each byte: 0 if allowed, ``a`` address, ``x`` access."""
        readable = bytearray(b"\0" if gap == b"rw" else b"a") * self.size
        writes = bytearray(b"a") * self.size
        for first, end in writable:
            writes[first:end] = bytes(end - first)
        for reg in self.rows:
            size = reg.end - reg.address
            readable[reg.address : reg.end] = (b"\0" if "r" in reg.access else b"x") * size
            writes[reg.address : reg.end] = (b"\0" if "w" in reg.access else b"x") * size
        return {"read": bytes(readable), "write": bytes(writes)}

    @cached_property
    def defaults(self) -> bytes:
        """The memory with every register at its default."""
        memory = bytearray(self.size)
        for reg in self.rows:
            memory[reg.address : reg.end] = reg.encode(reg.default)
        return bytes(memory)

    def require(self, what: Literal["read", "write"], address: int, n: int) -> None:
        """Raise :class:`Refused` unless ``n`` bytes from ``address`` allow it."""
        if address < 0 or n < 0 or address + n > self.size:
            raise Refused("address")
        if why := self._access[what][address : address + n].lstrip(b"\0")[:1]:
            raise Refused("access" if why == b"x" else "address")

    def touched(self, address: int, end: int) -> list[Reg]:
        """Return the registers with a byte in ``address..end``, in order."""
        first = max(bisect_right(self.starts, address) - 1, 0)
        return [reg for reg in self.rows[first : bisect_right(self.starts, end - 1)] if reg.end > address]

    def __str__(self) -> str:
        """Return the table as a datasheet prints it."""
        rows = [_cells(reg) for reg in self.rows]
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows)


class Registers:
    """A memory with the registers of a :class:`RegisterMap`.

    Args:
        table: the map.
        kept: numbers from the flash, by name; all others have their default.
    """

    def __init__(self, table: RegisterMap, *, kept: Mapping[str, ArrayLike | bytes] | None = None):
        self.table = table
        self._memory = bytearray(table.defaults)
        for name, values in (kept or {}).items():
            self[name] = values

    def reset(self, *names: str) -> None:
        """Set these registers, or all, to their defaults."""
        for name in names or self.table.by_name:
            self[name] = self.table.by_name[name].default

    def kept(self) -> dict[str, list]:
        """Return the numbers of the registers that the flash keeps, by name."""
        return {reg.name: self.all(reg.name) for reg in self.table.rows if reg.flash}

    def __getitem__(self, name: str) -> Any:
        return self.table.by_name[name].decode(self._memory)[0]

    def all(self, name: str) -> list[Any]:
        """Return all numbers of a register with a count."""
        return self.table.by_name[name].decode(self._memory)

    def __setitem__(self, name: str, values: ArrayLike | bytes) -> None:
        reg = self.table.by_name[name]
        self._memory[reg.address : reg.end] = reg.encode(values)

    def read(self, address: int, n: int, t_ns: int = 0) -> bytes:
        """Return ``n`` bytes of memory.

        Raises:
            Refused: ``address`` beyond the memory, or in a gap that cannot be read; ``access`` where a register can
                only be written.
        """
        self.table.require("read", address, n)
        return bytes(self._memory[address : address + n])

    def write(self, address: int, data: bytes, t_ns: int = 0) -> list[str]:
        """Store bytes, all or none, and return the names of the registers in them, in order.

        Raises:
            Refused: ``address`` beyond the memory or in a gap, ``access`` where a register can only be read, ``value``
                out of a register's range.
        """
        end = address + len(data)
        self.table.require("write", address, len(data))
        touched = self.table.touched(address, end) if data else []
        before = self._memory[address:end]
        self._memory[address:end] = data
        for reg in touched:
            low, high = reg.range
            if not all(low <= number <= high for number in reg.decode(self._memory)):
                self._memory[address:end] = before
                raise Refused("value")
        return [reg.name for reg in touched]


# -- lines of the table ----------------------------------------------------------------------------------------------

_NUMBER = r"-?\d+(?:\.\d+)?"
_TYPE = re.compile(r"([<>]?)([ui][124]|f4)(?: sign (\d+))?(?: x (\d+))?")
_PARTS = {
    "range": re.compile(rf"({_NUMBER})\.\.({_NUMBER})(?=\s|$)"),
    "default": re.compile(rf"= *({_NUMBER}(?:, *{_NUMBER})*)(?=\s|$)"),
    "access": re.compile(r"(rw|r|w)(?=\s\s|$)"),
    "flash": re.compile(r"flash(?=\s\s|$)"),
}


def _reg(line: str) -> Reg:
    columns = re.split(r"\s{2,}", line, maxsplit=3)
    if len(columns) < 3 or not columns[0].isdigit():
        raise ValueError(f"{line!r}: expected `address  type  name  ...`, in columns two spaces apart")
    address, text, name, tail = [*columns, ""][:4]
    found = _TYPE.fullmatch(text)
    if not found or (found[2][-1] != "1" and not found[1]):
        raise ValueError(f"{line!r}: type {text!r}: expected u1, <i2, >u4, <f4 ..., `sign BIT`, `x N`")
    options, about = _options(tail)
    low, high = map(_number, options.get("range", (None, None)))
    defaults = [_number(text) for text in re.split(", *", options.get("default", ("0",))[0])]
    return Reg(
        address=int(address),
        name=name,
        type=found[1] + found[2],
        count=int(found[4] or 1),
        low=low,
        high=high,
        default=tuple(defaults) if len(defaults) > 1 else defaults[0],
        access=options.get("access", ("rw",))[0],
        flash="flash" in options,
        sign_bit=None if found[3] is None else int(found[3]),
        about=about,
    )


def _options(text: str) -> tuple[dict[str, Any], str]:
    """Return the parts between a register's name and its remark, by their name in ``_PARTS``, and the remark."""
    options: dict[str, Any] = {}
    while found := next(
        ((part, match) for part in _PARTS if part not in options and (match := _PARTS[part].match(text))), None
    ):
        part, match = found
        options[part], text = match.groups(), text[match.end() :].lstrip()
    return options, text


def _number(text: str | None) -> Any:
    return None if text is None else float(text) if "." in text else int(text)


def _check(rows: tuple[Reg, ...], size: int) -> None:
    names = [reg.name for reg in rows]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"register {sorted(twice)[0]!r} occurs twice: give each line its own name")
    for reg, following in pairwise(rows):
        if reg.end > following.address:
            raise ValueError(
                f"register {following.name!r} at {following.address} overlaps {reg.name!r}, which ends at {reg.end - 1}"
            )
    for reg in rows:
        defaults = np.atleast_1d(reg.default)
        if reg.end > size:
            raise ValueError(f"register {reg.name!r} ends at {reg.end - 1}, beyond the memory's end at {size - 1}")
        if len(defaults) not in (1, reg.count):
            raise ValueError(f"register {reg.name!r}: {len(defaults)} defaults for {reg.count} numbers")
        if defaults.min() < reg.range[0] or defaults.max() > reg.range[1]:
            raise ValueError(f"register {reg.name!r}: default {reg.default} is not in {reg.range[0]}..{reg.range[1]}")


def _cells(reg: Reg) -> tuple[str, ...]:
    sign = "" if reg.sign_bit is None else f" sign {reg.sign_bit}"
    values = f"{reg.low}..{reg.high}" if reg.low is not None or reg.high is not None else ""
    default = ", ".join(f"{number:g}" for number in np.atleast_1d(reg.default))
    return (
        str(reg.address),
        reg.type + sign + (f" x {reg.count}" if reg.count > 1 else ""),
        reg.name,
        values,
        f"= {default}",
        reg.access,
        "flash" if reg.flash else "",
        reg.about,
    )
