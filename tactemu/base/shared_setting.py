"""A setting of the process that several threads need at the same time, each for a while."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class SharedSetting(Generic[Value]):
    """A context that changes a setting of this process; the last of its overlapping blocks restores the setting.

    Args:
        get: returns the setting.
        put: changes it.
        changed: returns the value inside the block, from the one before.
    """

    def __init__(self, get: Callable[[], Value], put: Callable[[Value], object], changed: Callable[[Value], Value]):
        self._get, self._put, self._changed = get, put, changed
        self._lock = threading.Lock()
        self._blocks = 0
        self._before: Value
        self._inside: Value

    def __enter__(self) -> None:
        with self._lock:
            if not self._blocks:
                self._before = self._get()
                self._put(self._changed(self._before))
                self._inside = self._get()
            self._blocks += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._blocks -= 1
            if not self._blocks and self._get() == self._inside:  # else the program has changed it meanwhile
                self._put(self._before)
