"""Garbage collection without full collections, which make a loop late; for processes that only run a loop.

A full collection visits every live object. With the truth log's hundred thousand samples in memory that takes 50 ms,
every few seconds at 1 kHz. Young objects are still collected, in well under a millisecond.
"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager

NO_FULL_COLLECTION = 2**30
"""Threshold of the oldest generation: collections of the middle one between two full ones, so many that none comes."""


@contextmanager
def no_full_collections() -> Iterator[None]:
    """Collect all garbage now, and only young objects inside the ``with`` block."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(before[0], before[1], NO_FULL_COLLECTION)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


def leave_quickly() -> None:
    """Skip the collection at the end of the process, which takes 0.4 s, and several seconds on a busy machine."""
    atexit.register(gc.freeze)
