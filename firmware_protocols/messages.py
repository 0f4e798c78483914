"""Parts of messages to users: a value, the nearest known name, and an error that pydantic found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def shown(value: object) -> str:
    """Return a value as a message shows it: its ``repr``, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ... ({len(text)} characters)"


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the hint of a message about an unknown name: ``"; did you mean 'x'?"``, or an empty text."""
    from difflib import get_close_matches

    near = get_close_matches(str(name), list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def error_message(entry: Mapping[str, Any]) -> str:
    """Return the message of an entry of pydantic's ``errors()``.

    A ``ValueError`` that a validator raised has the whole message, as :class:`~firmware_protocols.bounds.Bounds` writes
    it; pydantic's own messages do not show the value.
    """
    if entry["type"] == "value_error":
        return str(entry["ctx"]["error"])
    return f"{entry['msg'][0].lower()}{entry['msg'][1:]}, got {shown(entry['input'])}"
