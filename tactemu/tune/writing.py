"""Writing of a setting into a scene file: only the keys of the setting change; all other lines stay as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactemu.base.errors import SceneError
from tactemu.base.toml_text import inline


def set_skin(text: str, index: int, model: str, options: dict[str, Any], dtype: str | None = None) -> str:
    """Return the TOML text with the model and the options of its ``[[skin]]`` number ``index`` replaced.

    Options are written as one inline table; a ``[skin.options]`` table is replaced by it.

    Raises:
        SceneError: the text has no such skin.
    """
    import tomlkit

    document: Any = tomlkit.parse(text)
    skins = document.get("skin", [])
    if index >= len(skins):
        raise SceneError(f"the scene file has {len(skins)} [[skin]] tables; cannot write skin {index}")
    for key, value in {"model": model, "options": options}.items():
        skins[index].pop(key, None)
        skins[index].append(key, inline(value))
    if dtype is not None:
        document.setdefault("scene", tomlkit.table())["dtype"] = dtype
    return document.as_string()


def write_skin(file: Path, index: int, model: str, options: dict[str, Any], dtype: str | None = None) -> None:
    """Change a scene file in place; see :func:`set_skin`."""
    file.write_text(set_skin(file.read_text(encoding="utf-8"), index, model, options, dtype), encoding="utf-8")
