"""Progress bars of long commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Item = TypeVar("Item")


def show_progress(items: Iterable[Item], title: str, total: int) -> Iterator[Item]:
    """Iterate with a bar on a terminal that shows progress and the estimated remaining time."""
    with _bar(Console(stderr=True)) as progress:
        yield from progress.track(items, description=title, total=total)


@contextmanager
def show_parts() -> Iterator[Callable[[str], None]]:
    """Give a function that shows the name of the part that begins, on a terminal, with the time since the start."""
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("")
        yield lambda part: progress.update(task, description=part)


def show_sum(counts: Iterable[int], title: str, total: int) -> None:
    """Add up counts, with a bar on a terminal that shows their sum and the estimated remaining time."""
    with _bar(Console(stderr=True)) as progress:
        task = progress.add_task(title, total=total)
        for count in counts:
            progress.advance(task, count)


def _bar(console: Console) -> Progress:
    columns = (TextColumn("{task.description:>8}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    left = (TextColumn("left"), TimeRemainingColumn())
    return Progress(*columns, *left, console=console, transient=True, disable=not console.is_terminal)


def show_count(items: Iterable[Item]) -> Iterator[Item]:
    """Iterate with a count on a terminal, for items of unknown number."""
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.completed:,} entries"), TimeElapsedColumn())
    hidden = not console.is_terminal
    with Progress(*columns, console=console, transient=True, refresh_per_second=4, disable=hidden) as progress:
        task = progress.add_task("")
        for k, item in enumerate(items):
            if not k % 1000:
                progress.update(task, completed=k)
            yield item
