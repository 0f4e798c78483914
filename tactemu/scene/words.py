"""Scene files with Genesis's words, ``names = "genesis"`` in the table ``[scene]``."""

from __future__ import annotations

from typing import Any

from tactemu.base import words

POSE = ("position", "quaternion")
"""The keys of bodies and skins for which Genesis has words."""
OPTIONS = tuple(ours for ours in words.GENESIS.values() if ours != "link")
"""Options of models for which Genesis has words."""


def in_our_words(data: Any) -> Any:
    """Return the tables of a scene file in our words; tables that the file does not have in its form stay as they are.

    Raises:
        SceneError: a value is given in both words, or cannot be written in ours.
    """
    scene = data.get("scene") if isinstance(data, dict) else None
    if not isinstance(scene, dict) or scene.get("names") != "genesis":
        return data
    found = dict(data)
    for key, change in (("body", _pose), ("skin", _skin), ("scenario", _event)):
        if isinstance(data.get(key), list):
            found[key] = [change(table) if isinstance(table, dict) else table for table in data[key]]
    return found


def _pose(table: dict[str, Any]) -> dict[str, Any]:
    return words.in_our_words(table, POSE)


def _skin(table: dict[str, Any]) -> dict[str, Any]:
    return _inside(_pose(table), "options")


def _event(table: dict[str, Any]) -> dict[str, Any]:
    return _inside(table, "set")


def _inside(table: dict[str, Any], key: str) -> dict[str, Any]:
    """Return a table with the options under a key in our words."""
    inside = table.get(key)
    return table | {key: words.in_our_words(inside, OPTIONS)} if isinstance(inside, dict) else table
