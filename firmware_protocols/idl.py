"""Types of DDS from their IDL, which defines the bytes on the wire and the type that two participants compare.

The supported part of the language: ``module`` and ``struct``; ``float``, ``int8`` to ``uint32``; structs declared
earlier, by their full name or within their module; arrays ``T name[n]`` and sequences ``sequence<T> name``. Types are
``@final``, members numbered in order, and none is larger than four bytes, so that CDR of version 1 and 2 are the same.
"""

from __future__ import annotations

import re

import numpy as np

from firmware_protocols.cdr import Member, dtype_of

__all__ = ["Member", "layout", "structs"]

_NUMBERS = {
    "float": "float32", **{name: name for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32")}
}  # fmt: skip
"""The types of number, by their names in IDL, as :mod:`firmware_protocols.cdr` names them."""
_TOKEN = re.compile(r"[\w:]+|[{}<>;\[\]]")


def structs(text: str) -> dict[str, tuple[Member, ...]]:
    """Return the members of each struct, by its full name, ``module::Name``.

    Raises:
        ValueError: a type is not declared before its use.
    """
    found: dict[str, tuple[Member, ...]] = {}
    words, scope = _TOKEN.findall(text)[::-1], []
    while words:
        word = words.pop()
        if word == "module":
            scope.append(words.pop())
            words.pop()
        elif word == "struct":
            name = "::".join([*scope, words.pop()])
            words.pop()
            found[name] = tuple(_members(words, "::".join(scope), found))
        elif word == "}" and scope:
            scope.pop()
    return found


def _members(words: list[str], module: str, known: dict[str, tuple[Member, ...]]):
    while (word := words.pop()) != "}":
        if word == ";":
            continue
        if sequence := word == "sequence":
            words.pop()
            word = words.pop()
            words.pop()
        kind = next((each for each in (word, f"{module}::{word}") if each in _NUMBERS or each in known), None)
        name, count = words.pop(), 0
        if kind is None:
            raise ValueError(f"IDL: {word} {name}: declare the type {word} before its use")
        if words[-1] == "[":
            words.pop()
            count = int(words.pop())
            words.pop()
        yield Member(name, kind, sequence, count)


def layout(text: str, name: str, **lengths: int) -> np.dtype:
    """Return the memory layout of a sample in CDR, little-endian; a sequence ``s`` is a count ``n_s`` and its elements.

    Args:
        text: IDL.
        name: the struct's name, without its modules.
        lengths: the number of elements of each sequence in it.

    Raises:
        KeyError: there is no such struct, or a sequence has no length.
    """
    known = structs(text)
    full_names = {each.rpartition("::")[2]: each for each in known}
    return _layout(known, full_names[name], lengths)


def _layout(known: dict[str, tuple[Member, ...]], name: str, lengths: dict[str, int]) -> np.dtype:
    fields = []
    for member in known[name]:
        kind = dtype_of(_NUMBERS[member.type]) if member.type in _NUMBERS else _layout(known, member.type, lengths)
        if member.sequence:
            fields += [(f"n_{member.name}", "<u4"), (member.name, kind, (lengths[member.name],))]
        else:
            fields.append((member.name, kind, (member.count,)) if member.count else (member.name, kind))
    return np.dtype(fields, align=True)
