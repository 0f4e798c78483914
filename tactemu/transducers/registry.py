"""The transducers by name, one line each."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from firmware_protocols.named_classes import NamedClasses
from tactemu.base.errors import SceneError, nearest
from tactemu.base.own_code import load_class

if TYPE_CHECKING:
    from tactemu.transducers.transducer import Transducer

TRANSDUCERS: dict[str, str] = {
    # kind in scene files: "module:Class", imported only when needed
    "material": "tactemu.transducers.material:Material",
    "magnetic": "tactemu.transducers.magnetic:Magnetic",
    "piezoresistive": "tactemu.transducers.piezoresistive:Piezoresistive",
    "capacitive": "tactemu.transducers.capacitive:Capacitive",
    "fluid": "tactemu.transducers.fluid:Fluid",
}


REGISTRY = NamedClasses("transducer", "tactemu.transducers", TRANSDUCERS, "tactemu.transducers.transducer:Transducer")
"""The transducers of :data:`TRANSDUCERS`, of installed packages and of files."""


def transducer_class(name: str) -> type[Transducer]:
    """Return the class of a transducer by its name, or of your own transducer by ``path/to/file.py:Class``.

    Raises:
        SceneError: there is no such transducer, or the file raises an error.
    """
    return load_class(REGISTRY, name)


def make_transducer(where: str, table: Mapping[str, Any]) -> Transducer:
    """Return the transducer that a table of a scene file describes: its ``kind``, and options.

    Raises:
        SceneError: there is no such kind, or the transducer does not have or accept an option.
    """
    options = dict(table)
    kind = options.pop("kind", None)
    if not isinstance(kind, str):
        raise SceneError(f"{where}: expected a `kind` (kinds: {', '.join(TRANSDUCERS)})")
    try:
        made = transducer_class(kind)
    except SceneError as error:
        raise SceneError(f"{where}: {error}") from None
    known = [field.name for field in dataclasses.fields(made)]
    for name in options:
        if name not in known:
            hint = nearest(name, known) or f" (options: {', '.join(known)})"
            raise SceneError(f"{where}: {kind} has no {name!r}{hint}")
    try:
        return made(**{name: _fixed(value) for name, value in options.items()})
    except SceneError as error:
        raise SceneError(f"{where}: {error}") from None
    except (TypeError, ValueError) as error:
        raise SceneError(f"{where}: {kind}: {error}") from None


def _fixed(value: Any) -> Any:
    return tuple(_fixed(each) for each in value) if isinstance(value, list) else value
