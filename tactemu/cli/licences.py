"""``tactemu licences``: what is installed because of tactemu, and under which licence each says that it is."""

from __future__ import annotations

import json as json_module
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from typing import NamedTuple

from tactemu.base.errors import TactemuError

_REQUIREMENT = re.compile(r"\s*(?P<name>[A-Za-z0-9._-]+)\s*(?:\[(?P<extras>[^\]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")
_LONGEST = 60
"""Characters of a licence's name; a field that holds a whole text is cut to its first line."""

_FOR_DEVELOPERS = ("dev", "docs", "drivers")
"""Extras for work on tactemu, of which no user has anything."""


class Row(NamedTuple):
    """One package."""

    package: str
    version: str
    licence: str
    """As its metadata say; ``"?"`` where they say nothing."""
    needed_by: str
    """``tactemu``, ``tactemu[mujoco]``, or the package that brings it."""


def print_licences(*, json: bool = False) -> None:
    """Print tactemu, what it needs, and what of its extras is installed."""
    found = rows()
    if json:
        print(json_module.dumps([row._asdict() for row in found]))
        return
    widths = [max(len(cell) for cell in column) for column in zip(*found, strict=True)]
    for row in found:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def rows(root: str = "tactemu") -> list[Row]:
    """``root``, then what it needs, then what of its extras is installed; each package once, nearest first.

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
    looked_at: set[tuple[str, frozenset[str]]] = set()
    for name, wanted, needed_by in waiting:  # grows
        key = _plain(name)
        if (key, wanted) in looked_at:
            continue
        looked_at.add((key, wanted))
        try:
            found_one = distribution(name)
        except PackageNotFoundError:
            continue  # of an extra that is not installed, or for another platform
        spelled = found_one.metadata["Name"]
        found.setdefault(key, Row(spelled, found_one.version, _licence(found_one), needed_by))
        waiting += [
            (*each, needed_by if key == _plain(root) and wanted else spelled) for each in _needs(found_one, wanted)
        ]
    return list(found.values())


def _needs(package: Distribution, extras: frozenset[str]) -> list[tuple[str, frozenset[str]]]:
    """Return names and extras of what a package requires: without extras always, with them for these alone."""
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
    """Return the expression; else one line; else the classifiers; else how the text that somebody put there begins."""
    expressions, texts, classifiers = (
        package.metadata.get_all(key) or [] for key in ("License-Expression", "License", "Classifier")
    )
    said = [line for text in texts for line in text.strip().splitlines()]
    classified = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License ::")]
    found = [*expressions, *(said if len(said) == 1 else ()), *classified, *said]
    return next((line.strip()[:_LONGEST] for line in found if line.strip() not in ("", "UNKNOWN")), "?")


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
