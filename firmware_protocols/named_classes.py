"""Classes that have names: those of a table, of installed packages, and of Python files of a user's own.

The registries of devices, sensor models, shapes, transducers and engines are of this one kind.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_protocols.messages import nearest

_FILES: dict[tuple[Path, int], object] = {}
"""The modules of files, by path and time of change, so that each file runs once."""


class UnknownNameError(LookupError):
    """There is no class of this name."""


class WrongClassError(TypeError):
    """An object of a user's own is no class of the required kind."""


def is_file_name(name: str) -> bool:
    """Return True for ``path/to/file.py:Class``."""
    return ".py:" in name


def beside(name: str, folder: Path) -> str:
    """Return a name with its path, if it is ``path/to/file.py:Class``, taken relative to a folder."""
    return str(folder / name) if is_file_name(name) else name


@dataclass(frozen=True)
class NamedClasses:
    """The classes of one kind, each imported when it is asked for."""

    what: str
    """The kind, as messages call it."""
    group: str
    """The group of entry points under which an installed package registers its classes: ``name = "module:Class"``."""
    classes: Mapping[str, str]
    """``"module:Class"`` of these packages' own classes, by name."""
    base: str
    """``"module:Class"`` of the base class of all of them."""
    listing: str = ""
    """The command that lists the names, if they are too many for a message."""
    synonyms: Mapping[str, str] = field(default_factory=dict)
    """Other words for some names, which messages translate."""

    def names(self) -> list[str]:
        """Return all names, those of installed packages included, sorted."""
        return sorted(self._all())

    def is_own(self, name: str) -> bool:
        """Return True if a name stands for a user's own code: a file, or a class of an installed package."""
        return name not in self.classes and (is_file_name(name) or bool(self._points(name=name)))

    def knows(self, name: str) -> bool:
        """Return True if a name may be loaded, without loading it."""
        return name in self.classes or self.is_own(name)

    def load(self, name: str) -> Any:
        """Return a class by its name in the table, that of an entry point, or ``path/to/file.py:Class``.

        Raises:
            UnknownNameError: there is none; the message names the nearest, and the ways to a class of your own.
            WrongClassError: the object does not derive from the base class.
        """
        if name in self.classes:
            return imported(self.classes[name])
        found = self._from_file(name) if is_file_name(name) else self._installed(name)
        base = imported(self.base)
        if not (isinstance(found, type) and issubclass(found, base)):
            raise WrongClassError(f"{name} is no {self.what}: derive the class from {base.__name__}")
        return found

    def unknown(self, name: object, among: Iterable[str] | None = None) -> str:
        """Return the message of an unknown name: the nearest name, all names, and the ways to one of your own.

        ``among`` are the names that are valid in this place; default: all.
        """
        text = str(name)
        if Path(text).suffix == ".py" and Path(text).is_file():
            classes = re.findall(r"^class (\w+)", Path(text).read_text(errors="replace"), re.MULTILINE)
            return f"{text}: name the class in it, as {text}:{classes[-1] if classes else 'Class'}"
        if self.listing and Path(text).is_dir():
            return f"{name!r} is a folder; name a {self.what}, a scene file or path/to/{self.what}.py:Class"
        known = self._all() if among is None else [*among]
        meant = self.synonyms.get(text)
        near = f"; did you mean {meant!r}?" if meant in known else nearest(name, known)
        ways = f"your own: path/to/file.py:Class, or an entry point of {self.group}"
        if self.listing:
            return f"unknown {self.what} {name!r}{near or f'; {self.listing} lists them'} ({ways})"
        return f"unknown {self.what} {name!r}{near} ({self.what}s: {', '.join(known)}; {ways})"

    def _all(self) -> list[str]:
        """Return all names, those of the table first."""
        return [*dict.fromkeys([*self.classes, *(point.name for point in self._points())])]

    def _points(self, **names: Any) -> Iterable[Any]:
        """Return the entry points of the group."""
        from importlib.metadata import entry_points  # 20 ms, which most programs never need

        return entry_points(group=self.group, **names)

    def _installed(self, name: str) -> object:
        for point in self._points(name=name):
            return point.load()
        raise UnknownNameError(self.unknown(name))

    def _from_file(self, name: str) -> object:
        path, _, attribute = name.rpartition(":")
        file = Path(path).resolve()
        if not file.is_file():
            raise UnknownNameError(f"no such {self.what} file: {path}")
        key = (file, file.stat().st_mtime_ns)
        if key not in _FILES:
            _FILES[key] = _run(file)
        if not hasattr(_FILES[key], attribute):
            raise UnknownNameError(f"{path} has no class {attribute!r}")
        return getattr(_FILES[key], attribute)


def imported(target: str) -> Any:
    """Return the object that ``"module:name"`` denotes."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def _run(file: Path) -> object:
    """Return the module of a file, under a name that no file of another folder has."""
    spec = importlib.util.spec_from_file_location(f"own_{file.stem}_{zlib.crc32(bytes(file)):08x}", file)
    assert spec is not None and spec.loader is not None, "the name ends in .py"
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[spec.name]
        raise
    return module
