"""The kernel's receive queue of a socket: its size, and its count of frames dropped because it was full."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections.abc import Sequence

from tactemu.transports.transport import Counted

RECEIVE_QUEUE_BYTES = 4 << 20
"""Requested size of the queue [byte], for stalls of the loop; the kernel grants at most ``net.core.rmem_max``."""
MIN_POLL_S = 0.001
"""Minimum time for which one poll takes frames [s]; bounds the delay that a flood of frames can cause."""
POLL_TIME_SHARE = 0.1
"""Share of the time since the last poll for which a poll takes frames, if that is longer: a late loop catches up."""
_SO_MEMINFO = 55
_DROPS = struct.Struct("=32xI")
"""Layout of ``linux/sock_diag.h``: ``SK_MEMINFO_DROPS`` is the ninth number."""


class ReceiveQueue:
    """The queue of one socket.

    Args:
        fileno: of the socket; of other files nothing is set or counted.
        size: requested size [byte]; 0 leaves the size unchanged.
    """

    def __init__(self, fileno: int, size: int = RECEIVE_QUEUE_BYTES):
        self._socket: socket.socket | None = None
        with contextlib.suppress(OSError, ValueError):
            self._socket = socket.socket(fileno=os.dup(fileno))
            if size:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        self._dropped = self._count()
        self._polled_s = time.monotonic()

    def poll_deadline_s(self) -> float:
        """Return the monotonic time until which a poll that begins now takes frames [s]."""
        now = time.monotonic()
        end = now + max(MIN_POLL_S, POLL_TIME_SHARE * (now - self._polled_s))
        self._polled_s = now
        return end

    def is_empty(self, fileno: int, readable: Sequence[int]) -> bool:
        """Return True if a socket is none of those that are readable; then no poll is late."""
        if fileno in readable:
            return False
        self._polled_s = time.monotonic()
        return True

    def overflows(self) -> list[Counted]:
        """Return the number of frames dropped since the last call, as an event; empty for 0.

        Call it after a poll that took frames: a full queue has some, and an idle port needs no system call.
        """
        count = self._count()
        since, self._dropped = (count - self._dropped) % 2**32, count
        return [Counted("overflow", since)] if since else []

    def _count(self) -> int:
        if self._socket is None:
            return 0
        try:
            return _DROPS.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _DROPS.size))[0]
        except (OSError, struct.error):  # no socket, or a kernel without the count
            return 0

    def close(self) -> None:
        """Close the copy of the socket. Safe to call twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
