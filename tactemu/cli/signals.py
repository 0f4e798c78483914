"""Ctrl-C and SIGTERM end a loop, not the program."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def ended_by_signals(stop: Callable[[], None] | None = None) -> Iterator[Callable[[], bool]]:
    """The first signal calls ``stop``, a second one ends the process; gives a function that says whether one came."""
    seen: list[int] = []

    def note(number: int, _frame: object) -> None:
        seen.append(number)
        if stop is not None:
            stop()
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(seen)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
