"""Writing of a setting into a scene file: only the keys of the setting change; all other lines stay as they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from tactemu.base.errors import SceneError


def set_skin(text: str, index: int, model: str, options: dict[str, Any], dtype: str | None = None) -> str:
    """Return the TOML text with the model and the options of its ``[[skin]]`` number ``index`` replaced.

    Options are written as one inline table; a ``[skin.options]`` table is replaced by it.

    Raises:
        SceneError: the text has no such skin.
    """
    lines = text.splitlines()
    heads = [k for k, line in enumerate(lines) if re.match(r"\s*\[\[\s*skin\s*\]\]", line)]
    if index >= len(heads):
        raise SceneError(f"the scene file has {len(heads)} [[skin]] tables as plain text; cannot write skin {index}")
    start = heads[index]
    lines = _without_table(lines, start, r"\s*\[\s*skin\.options\s*\]")
    end = _next_table(lines, start + 1)
    body = _without_keys(lines[start + 1 : end], ("model", "options"))
    while body and not body[-1].strip():
        body.pop()
    lines[start + 1 : end] = [*body, f"model = {_value(model)}", f"options = {_value(options)}", ""]
    if dtype is not None:
        lines = _set_in_scene(lines, "dtype", dtype)
    return "\n".join(lines).rstrip("\n") + "\n"


def write_skin(file: Path, index: int, model: str, options: dict[str, Any], dtype: str | None = None) -> None:
    """Change a scene file in place; see :func:`set_skin`."""
    file.write_text(set_skin(file.read_text(encoding="utf-8"), index, model, options, dtype), encoding="utf-8")


def _next_table(lines: list[str], start: int) -> int:
    """Return the index of the next line that opens a table, or the end; a line of a multi-line array does not count."""
    depth = 0
    for k in range(start, len(lines)):
        if depth == 0 and re.match(r"\s*\[{1,2}\s*[A-Za-z_\"]", lines[k]):
            return k
        depth += _brackets(lines[k])
    return len(lines)


def _brackets(line: str) -> int:
    """Return the number of brackets that a line leaves open, outside of strings and comments."""
    bare = re.sub(r"\"(?:[^\"\\]|\\.)*\"|'[^']*'", "", line).split("#")[0]
    return sum(bare.count(c) for c in "[{") - sum(bare.count(c) for c in "]}")


def _without_table(lines: list[str], start: int, head: str) -> list[str]:
    k = start + 1
    while k < len(lines) and not re.match(r"\s*\[\[\s*skin\s*\]\]", lines[k]):
        if re.match(head, lines[k]):
            return lines[:k] + lines[_next_table(lines, k + 1) :]
        k += 1
    return lines


def _without_keys(lines: list[str], keys: tuple[str, ...]) -> list[str]:
    kept, depth, skipping = [], 0, False
    for line in lines:
        if depth == 0:
            skipping = bool(re.match(rf"\s*({'|'.join(keys)})\s*[=.]", line))
        depth += _brackets(line)
        if not skipping:
            kept.append(line)
    return kept


def _set_in_scene(lines: list[str], key: str, value: Any) -> list[str]:
    heads = [k for k, line in enumerate(lines) if re.match(r"\s*\[\s*scene\s*\]", line)]
    if not heads:
        return ["[scene]", f"{key} = {_value(value)}", "", *lines]
    start = heads[0]
    end = _next_table(lines, start + 1)
    body = _without_keys(lines[start + 1 : end], (key,))
    return [*lines[: start + 1], f"{key} = {_value(value)}", *body, *lines[end:]]


def _value(value: Any) -> str:
    """Return a TOML value on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }" if value else "{}"
    return "[" + ", ".join(_value(item) for item in value) + "]"
