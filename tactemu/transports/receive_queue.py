"""The kernel's receive queue of a socket: its size, and the frames that it dropped because it was full."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time

from tactemu.transports.transport import Overflowed

RECEIVE_QUEUE_BYTES = 4 << 20
"""Requested size of the queue; the kernel grants no more than ``net.core.rmem_max``. Bridges a stall of the loop."""
MIN_POLL_S = 0.001
"""Time for which one look may take frames [s], so that a flood of them leaves time for the rest."""
POLL_TIME_SHARE = 0.1
"""Share of the time since the last look for which a look may take frames, if that is longer: a late loop catches up."""
_SO_MEMINFO, _DROPS = 55, struct.Struct("=32xI")
"""Of ``linux/sock_diag.h``: ``SK_MEMINFO_DROPS`` is the ninth number."""


class ReceiveQueue:
    """The queue of one socket.

    Args:
        fileno: of the socket; of anything else, nothing is asked for or counted.
        size: bytes to ask for; 0: leave it as it is.
    """

    def __init__(self, fileno: int, size: int = RECEIVE_QUEUE_BYTES):
        self._socket: socket.socket | None = None
        with contextlib.suppress(OSError, ValueError):
            self._socket = socket.socket(fileno=os.dup(fileno))
            if size:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        self._dropped = self._count()
        self._looked_s = time.monotonic()

    def poll_deadline_s(self) -> float:
        """Begin to take frames; return the monotonic time at which to end [s]."""
        now = time.monotonic()
        end = now + max(MIN_POLL_S, POLL_TIME_SHARE * (now - self._looked_s))
        self._looked_s = now
        return end

    def overflows(self) -> list[Overflowed]:
        """Return how many frames were dropped since the last call, if any.

        Call it after a look that took frames: a queue that was full has some, and an idle port pays nothing.
        """
        count = self._count()
        since, self._dropped = (count - self._dropped) % 2**32, count
        return [Overflowed(since)] if since else []

    def _count(self) -> int:
        if self._socket is None:
            return 0
        try:
            return _DROPS.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _DROPS.size))[0]
        except (OSError, struct.error):  # no socket, or a kernel that does not say
            return 0

    def close(self) -> None:
        """Let go of the socket. Safe to call twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
