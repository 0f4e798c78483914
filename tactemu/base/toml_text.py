"""Values as TOML on one line, by tomlkit, which also edits a user's file without touching its other lines.

tomlkit (MIT, pure Python, no dependencies) is imported only where a file is written: it takes 45 ms.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tomlkit.items import Item


def inline(value: Any) -> Item:
    """Return a value as an item of tomlkit, whose ``as_string()`` is its text; tables become inline tables."""
    import tomlkit

    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        for key, each in value.items():
            table.append(key, inline(each))
        return table
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        array.extend(map(inline, value))
        return array
    return tomlkit.item(value)


def lines_of(values: Mapping[str, Any]) -> list[str]:
    """Return a line ``key = value`` for each value."""
    import tomlkit

    return [f"{tomlkit.key(key).as_string()} = {inline(value).as_string()}" for key, value in values.items()]
