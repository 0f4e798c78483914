"""Messages of errors in tables: the place, the expected and the given value."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError

from firmware_protocols.messages import error_message
from tactemu.base.errors import shown


def list_errors(error: ValidationError, data: Any, where: str, at: tuple[str, ...] = ()) -> str:
    """Return a line for each error that pydantic found in ``data``.

    Args:
        error: pydantic's error.
        data: the tables that were checked.
        where: the file, or the table within it, with which each line begins.
        at: the keys that lead from there to ``data``.
    """
    start = "".join(f".{part}" for part in at)
    return "\n".join(f"{where}{_path(start, loc, data)}: {message}" for loc, message in _each(error))


def _each(error: ValidationError) -> Iterator[tuple[tuple, str]]:
    """Yield the location and the message of each error; a list that is too short is one error."""
    short: dict[tuple, tuple[int, Any]] = {}
    for entry in error.errors():
        if entry["type"] == "missing" and isinstance(entry["loc"][-1], int):
            short[entry["loc"][:-1]] = entry["loc"][-1] + 1, entry["input"]
        else:
            yield entry["loc"], _message(entry)
    for loc, (length, given) in short.items():
        yield loc, f"expected {length} values, got {shown(given)}"


def _path(text: str, loc: tuple, data: Any) -> str:
    """Return the path to a key, such as ``: body[1] 'ball'.radius``, with the table's name where it has one."""
    for part in loc:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part.startswith("<") or (isinstance(data, dict) and part in (data.get("shape"), data.get("kind"))):
            continue  # this part is pydantic's name of a union's branch
        else:
            text += f".{part}"
        data = _inside(data, part)
        name = data.get("name", data.get("device")) if isinstance(part, int) and isinstance(data, dict) else None
        if isinstance(name, str):
            text += f" {name!r}"
    return f": {text.lstrip('.')}" if text else ""


def _inside(data: Any, part: int | str) -> Any:
    if isinstance(part, int):
        return data[part] if isinstance(data, list | tuple) and part < len(data) else None
    return data.get(part) if isinstance(data, dict) else None


def _message(entry: Any) -> str:
    if entry["type"] == "missing":
        return "missing key"
    return error_message(entry)
