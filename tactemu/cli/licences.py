"""``tactemu licences``: the installed packages that tactemu needs, each with the licence of its metadata."""

from __future__ import annotations

import json as json_module
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from typing import NamedTuple

from tactemu.base.errors import TactemuError

_REQUIREMENT = re.compile(r"\s*(?P<name>[A-Za-z0-9._-]+)\s*(?:\[(?P<extras>[^\]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")
_MAX_LICENCE_CHARACTERS = 60
"""Maximum length of a licence's name; of a field with the full text, the first line is used."""

_FOR_DEVELOPERS = ("dev", "docs", "drivers")
"""The extras for work on tactemu, which users do not need."""


class Row(NamedTuple):
    """A package."""

    package: str
    version: str
    licence: str
    """The licence by its metadata, or ``"?"``."""
    needed_by: str
    """``tactemu``, ``tactemu[mujoco]``, or the package that requires it."""


def print_licences(*, json: bool = False) -> None:
    """Print tactemu, its requirements, and the installed requirements of its extras."""
    found = rows()
    if json:
        print(json_module.dumps([row._asdict() for row in found]))
        return
    widths = [max(len(cell) for cell in column) for column in zip(*found, strict=True)]
    for row in found:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def rows(root: str = "tactemu") -> list[Row]:
    """Return ``root``, its requirements, and the installed requirements of its extras; each once, nearest first.

    Raises:
        TactemuError: ``root`` is not installed.
    """
    try:
        own = distribution(root)
    except PackageNotFoundError:
        raise TactemuError(f"{root} is not installed, only on the path: pip install it, then ask again") from None
    extras = [name for name in own.metadata.get_all("Provides-Extra") or () if name not in _FOR_DEVELOPERS]
    waiting = [(root, frozenset[str](), ""), *((root, frozenset({name}), f"{root}[{name}]") for name in extras)]
    found: dict[str, Row] = {}
    visited: set[tuple[str, frozenset[str]]] = set()
    for name, wanted, needed_by in waiting:  # grows
        key = _plain(name)
        if (key, wanted) in visited:
            continue
        visited.add((key, wanted))
        try:
            found_one = distribution(name)
        except PackageNotFoundError:
            continue  # part of an extra that is not installed, or for another platform
        spelled = found_one.metadata["Name"]
        found.setdefault(key, Row(spelled, found_one.version, _licence(found_one), needed_by))
        waiting += [
            (*each, needed_by if key == _plain(root) and wanted else spelled) for each in _needs(found_one, wanted)
        ]
    return list(found.values())


def _needs(package: Distribution, extras: frozenset[str]) -> list[tuple[str, frozenset[str]]]:
    """Return names and extras of the requirements of a package: those of ``extras``, or, without any, the others."""
    found = []
    for line in package.requires or ():
        requirement, _, marker = line.partition(";")
        asked = _EXTRA.search(marker)
        match = _REQUIREMENT.match(requirement)
        if match and (asked[1] in extras if asked else not extras):
            inner = frozenset(each.strip() for each in (match["extras"] or "").split(",") if each.strip())
            found.append((match["name"], frozenset[str]()))
            found += [(match["name"], frozenset({each})) for each in sorted(inner)]
    return found


def _licence(package: Distribution) -> str:
    """Return the licence expression, else the licence field if it is one line, else the classifiers, else the first
    line of the licence field."""
    expressions, texts, classifiers = (
        package.metadata.get_all(key) or [] for key in ("License-Expression", "License", "Classifier")
    )
    said = [line for text in texts for line in text.strip().splitlines()]
    classified = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License ::")]
    found = [*expressions, *(said if len(said) == 1 else ()), *classified, *said]
    return next((line.strip()[:_MAX_LICENCE_CHARACTERS] for line in found if line.strip() not in ("", "UNKNOWN")), "?")


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
