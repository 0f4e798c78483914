"""Files that a process removes when it ends, also when it ends at once in the middle of its start."""

from __future__ import annotations

import atexit
import contextlib
from collections.abc import Callable

_REMOVALS: list[Callable[[], object]] = []


def remove_at_end(removal: Callable[[], object]) -> None:
    """Call ``removal`` when the process ends, whether or not there is still something to remove."""
    _REMOVALS.append(removal)


@atexit.register
def remove_leftovers() -> None:
    """Remove everything now."""
    while _REMOVALS:
        with contextlib.suppress(Exception):
            _REMOVALS.pop()()
