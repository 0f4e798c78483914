"""The findings of an inference: fields, sums and groups of messages of one kind."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactemu.base.sum_search import FrameSum

VALUE_KINDS = ("u", "i", "f", "?", "counter", "clock")
"""Kinds of fields that change: ``?`` is an integer whose top bit never moved, or whose sign is open."""
SIGN_SHARE = 0.98
"""The least share of the messages in which a byte is the extended sign of another."""


@dataclass
class Field:
    """Some bits of every message of a group."""

    at: int
    """The offset of its first byte."""
    size: int
    """The number of bytes that it touches."""
    kind: str
    """One of :data:`VALUE_KINDS`, ``const``, ``sum``, ``length``, ``selector`` or ``bits`` (a nibble of flags)."""
    order: str = ""
    """The byte order, ``<`` or ``>``; empty for a single byte."""
    bits: int = 0
    """The number of bits; 0: all of its bytes."""
    shift: int = 0
    """The number of bits below it in its bytes."""
    is_certain: bool = False
    """True with a proof; :attr:`why` names it."""
    is_width_open: bool = False
    """True if bytes beside it that never moved may belong to it."""
    why: str = ""
    decide: str = ""
    """The capture that would decide what is open."""

    @property
    def width(self) -> int:
        """The number of bits."""
        return self.bits or 8 * self.size

    @property
    def end(self) -> int:
        """The offset behind its last byte."""
        return self.at + self.size

    def values(self, rows: np.ndarray) -> np.ndarray:
        """Return the values of the field in messages, shape (n,), as int64, or float64 of a float."""
        if self.kind == "f":
            raw = np.ascontiguousarray(rows[:, self.at : self.end])
            return raw.view(f"{self.order}f{self.size}").ravel().astype(float)
        values = integers(rows, self.at, self.size, self.order) >> self.shift
        values &= (1 << min(self.width, 63)) - 1
        return signed(values, self.width) if self.kind == "i" else values


def integers(rows: np.ndarray, at: int, size: int, order: str) -> np.ndarray:
    """Return bytes ``at`` to ``at + size`` as unsigned integers, shape (n,); eight bytes lose the top bit."""
    values = np.zeros(len(rows), np.int64)
    for k in range(size):
        values |= rows[:, at + k].astype(np.int64) << 8 * (k if order == "<" else size - 1 - k)
    return values & 0x7FFF_FFFF_FFFF_FFFF


def signed(values: np.ndarray, bits: int) -> np.ndarray:
    """Return unsigned integers of some bits as two's complement."""
    return values if bits > 62 else values - ((values >> (bits - 1) & 1) << bits)


def is_sign_of(rows: np.ndarray, low: int, high: int) -> bool:
    """Return True if one byte is FF where the other's top bit is set, and else 0: an extended sign."""
    extended = np.where(rows[:, low] & 0x80, 0xFF, 0)
    return bool((rows[:, high] == extended).mean() >= SIGN_SHARE)


@dataclass
class Group:
    """Messages of one kind: of one length, identifier, question and selector."""

    key: str
    """The group in words, such as ``201, byte 0 = 40``."""
    rows: np.ndarray
    """The messages, uint8, shape (n, length)."""
    index: np.ndarray
    """The number of each in the capture."""
    question: bytes | None = None
    id: int | None = None
    selectors: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Value and mask of the bytes that distinguish it from other groups of its length, by offset."""
    is_mixed: bool = False
    """True for answers to questions that are alike, not the same: nothing is certain in them."""
    sum: FrameSum | None = None
    fields: list[Field] = field(default_factory=list)

    @property
    def length(self) -> int:
        """The number of bytes of a message."""
        return self.rows.shape[1]
