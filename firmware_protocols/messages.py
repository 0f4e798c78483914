"""Parts of messages to users: a value, the nearest known name, and an error that pydantic found."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

_EXPECTED = {
    "bool_parsing": "true or false", "bool_type": "true or false", "dict_type": "a table", "finite_number": "a number",
    "float_parsing": "a number", "float_type": "a number", "int_from_float": "a whole number",
    "int_parsing": "a whole number", "int_type": "a whole number", "list_type": "a list", "model_attributes_type":
    "a table", "model_type": "a table", "string_type": "a text", "tuple_type": "a list",
}  # fmt: skip
"""The expected types in words, by the type of pydantic's error."""


def shown(value: object) -> str:
    """Return a value as a message shows it: its ``repr``, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ... ({len(text)} characters)"


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the hint of a message about an unknown name: ``"; did you mean 'x'?"``, or an empty text.

    Near are a name with a slip of the keyboard or two, else at most three names that have ``name`` as one of their
    words.
    """
    from difflib import get_close_matches

    text, names = str(name).lower(), {each.lower(): each for each in known}
    cutoff = 0.75 if len(text) > 3 else 0.66  # one letter in three may differ, or one in four
    near = get_close_matches(text, names, n=1, cutoff=cutoff)
    near = near or [each for each in names if text and text in re.split(r"[_.]", each)][:3]
    return f"; did you mean {' or '.join(repr(names[each]) for each in near)}?" if near else ""


def error_message(entry: Mapping[str, Any]) -> str:
    """Return the message of an entry of pydantic's ``errors()``.

    A ``ValueError`` that a validator raised has the whole message, as :class:`~firmware_protocols.bounds.Bounds` writes
    it; pydantic's own messages do not show the value.
    """
    if entry["type"] == "value_error":
        return str(entry["ctx"]["error"])
    if (expected := _EXPECTED.get(entry["type"])) is not None:
        return f"expected {expected}, got {shown(entry['input'])}"
    return f"{entry['msg'][0].lower()}{entry['msg'][1:]}, got {shown(entry['input'])}"
