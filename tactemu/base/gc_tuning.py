"""Garbage collection without full collections while a loop runs: they make it late.

A full collection visits every live object: 70 ms in a process with Warp, at 1 kHz every minute. Young objects are still
collected, and those of the middle generation at every second such collection instead of every eleventh, since the time
of a collection is proportional to the objects that it visits: a fifth of them.
"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager

from tactemu.base.shared_setting import SharedSetting

_MIDDLE_COLLECTION_THRESHOLD = 1
"""Number of collections of young objects that are followed by one of the middle generation."""
_MIN_FULL_COLLECTION_THRESHOLD = 5000
"""Least number of collections of the middle generation between two full ones: 7 million more objects than before. It
bounds the garbage of a program that serves a device for days; a loop at 1 kHz alone makes so many in 80 minutes."""
_NO_FULL_COLLECTION_THRESHOLD = 2**30


def _spaced(threshold: tuple[int, int, int]) -> tuple[int, int, int]:
    return threshold[0], _MIDDLE_COLLECTION_THRESHOLD, max(threshold[2], _MIN_FULL_COLLECTION_THRESHOLD)


no_full_collections = SharedSetting(gc.get_threshold, lambda threshold: gc.set_threshold(*threshold), _spaced)
"""A context in which no thread of this process collects all garbage, unless it has made very much."""


@contextmanager
def command_collections() -> Iterator[None]:
    """Collect no garbage inside the block until :func:`enable_collections`, and then only young objects.

    It is for a process that only runs a loop. Nearly all objects that imports make last, and collections, which visit
    them again and again, take 50 ms of a start. A full collection at the end of the process takes 0.4 s, and several
    seconds on a busy machine. A program that runs a command in its own process has its collections back afterwards:
    else what it makes until its next loop is garbage that this loop collects in one go.
    """
    was_enabled, threshold = gc.isenabled(), gc.get_threshold()
    gc.disable()
    gc.set_threshold(*threshold[:2], _NO_FULL_COLLECTION_THRESHOLD)
    atexit.register(gc.freeze)
    try:
        yield
    finally:
        gc.set_threshold(*threshold)
        if was_enabled:
            gc.enable()


def enable_collections() -> None:
    """Collect garbage from now on, but none of the objects that exist already."""
    gc.freeze()
    gc.enable()
