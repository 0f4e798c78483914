"""A forked child has copies of its parent's ports: it lets go of them, and they stay the parent's.

Without that a child that lives on keeps a port's descriptors open (the driver never sees that it was closed, nobody can
make it anew), and one that ends removes it. Programs that are started with ``exec`` inherit nothing.
"""

from __future__ import annotations

import contextlib
import os
from typing import Protocol
from weakref import WeakSet


class Port(Protocol):
    """Something whose ``close`` in a child does the parent no harm."""

    def close(self) -> None:
        """Close what this process has of it."""


_OURS: WeakSet[Port] = WeakSet()


def close_in_children(port: Port) -> None:
    """Have ``port`` closed in every child that this process forks from now on."""
    _OURS.add(port)


def _let_go() -> None:
    for port in list(_OURS):
        with contextlib.suppress(Exception):  # another thread of the parent may have been in the middle of anything
            port.close()
    _OURS.clear()


os.register_at_fork(after_in_child=_let_go)
