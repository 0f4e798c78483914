"""A watch for openings and closings of a file, by Linux inotify.

A library for it would save ten lines, and every installation would need it.
"""

from __future__ import annotations

import ctypes
import os
import struct

_IN_CLOSE_WRITE, _IN_CLOSE_NOWRITE, _IN_OPEN = 0x08, 0x10, 0x20
_EVENT = struct.Struct("iIII")


class OpenWatch:
    """A watch on one file. ``fileno`` is readable when it was opened or closed; -1 where the kernel has no inotify."""

    def __init__(self, path: str):
        libc = ctypes.CDLL(None, use_errno=True)
        self.fileno = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        mask = _IN_OPEN | _IN_CLOSE_WRITE | _IN_CLOSE_NOWRITE
        if self.fileno >= 0 and libc.inotify_add_watch(self.fileno, os.fsencode(path), mask) < 0:
            self.close()

    def close(self) -> None:
        """Stop watching."""
        if self.fileno >= 0:
            os.close(self.fileno)
            self.fileno = -1

    def read(self) -> str:
        """Return the events since the last call in order, ``o`` for opened, ``c`` for closed. Never blocks."""
        if self.fileno < 0:
            return ""
        try:
            events = os.read(self.fileno, 64 * _EVENT.size)
        except BlockingIOError:
            return ""
        masks = [_EVENT.unpack_from(events, at)[1] for at in range(0, len(events), _EVENT.size)]
        return "".join("o" if mask & _IN_OPEN else "c" for mask in masks)
