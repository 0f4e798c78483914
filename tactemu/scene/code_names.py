"""The names in a scene file that stand for Python code of others, found without running any."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from firmware_protocols.registry import REGISTRY as DEVICES
from tactemu.geometry.shapes.registry import REGISTRY as SHAPES
from tactemu.scene.engine_tables import REGISTRY as ENGINES
from tactemu.sensors.models import REGISTRY as MODELS
from tactemu.transducers.registry import REGISTRY as TRANSDUCERS


def own_names(data: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the place and the name of each class in unchecked tables that is not of this package."""
    places = [("the engine", data.get("engine"), "kind", ENGINES)]
    places += [(_title("body", body), body, "shape", SHAPES) for body in _list(data.get("body"))]
    for skin in _list(data.get("skin")):
        where = _title("skin", skin)
        places += [(where, skin, "device", DEVICES), (where, skin, "model", MODELS)]
        parts = _list(skin.get("transducer")) if isinstance(skin, dict) else []
        places += [(where, part, "kind", TRANSDUCERS) for part in parts]
    for where, table, key, registry in places:
        name = table.get(key) if isinstance(table, dict) else None
        if isinstance(name, str) and registry.is_own(name):
            yield where, name


def _list(tables: Any) -> list:
    return tables if isinstance(tables, list) else []


def _title(kind: str, table: Any) -> str:
    """Return the kind of a table with its name, as other messages have it."""
    table = table if isinstance(table, dict) else {}
    name = table.get("name") or str(table.get("device", "")).rpartition(":")[2]
    return f"{kind} {name!r}"
