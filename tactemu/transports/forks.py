"""Closing of ports in forked children, so that a port stays that of the process that made it.

Otherwise a child that outlives its parent keeps a port's descriptors open (the driver never sees it closed, and it
cannot be made again), and a child that ends removes it. Programs that are started with ``exec`` inherit nothing.
"""

from __future__ import annotations

import contextlib
import os
from typing import Protocol
from weakref import WeakSet


class Port(Protocol):
    """An object whose ``close`` in a child leaves the parent's port intact."""

    def close(self) -> None:
        """Close the descriptors of this process."""


_OURS: WeakSet[Port] = WeakSet()


def close_in_children(port: Port) -> None:
    """Register ``port`` to be closed in every child that this process forks from now on."""
    _OURS.add(port)


def _close_all() -> None:
    for port in list(_OURS):
        with contextlib.suppress(Exception):  # another thread of the parent may have been in the middle of anything
            port.close()
    _OURS.clear()


os.register_at_fork(after_in_child=_close_all)
