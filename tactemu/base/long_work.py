"""Progress of long work within the library, and notices before it: a program that has a terminal says how they are
shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Item = TypeVar("Item")
Display = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Iterates over items, of which the title and the number are given, and shows how far it is."""

_displays: list[Display] = []
_readers: list[Callable[[str], None]] = []


def show_long_work(display: Display) -> None:
    """Show the progress of long work from now on.

    Args:
        display: shows it; ``tactemu.cli.progress.show_progress`` on a terminal.
    """
    _displays[:] = [display]


def long_work(items: Iterable[Item], title: str, total: int) -> Iterator[Item]:
    """Iterate over the parts of long work; nothing is shown unless the program has asked for it.

    Args:
        items: the parts, each of which is done when it is yielded.
        title: what is done, in a few words.
        total: the number of parts.
    """
    yield from _displays[0](items, title, total) if _displays else items


@contextmanager
def notices_to(reader: Callable[[str], None]) -> Iterator[None]:
    """Within this context, pass notices about long work to ``reader``, before the work begins."""
    _readers.append(reader)
    try:
        yield
    finally:
        _readers.remove(reader)


def notice(text: str) -> bool:
    """Say what work is about to begin, or is not needed.

    Returns:
        False if nothing receives notices.
    """
    for reader in _readers:
        reader(text)
    return bool(_readers)
