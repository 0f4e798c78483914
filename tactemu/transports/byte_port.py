"""Writing of frames to a byte port of this machine, complete and in order."""

from __future__ import annotations

import errno
import os

from tactemu.base.errors import TransportError, reason_of
from tactemu.transports.transport import Transport

_NOT_NOW = (errno.EAGAIN, errno.EIO, errno.ENXIO, errno.ENODEV)
"""Errors of a port that is full, closed or pulled out; the next read reports the last two."""


class BytePort(Transport):
    """A port of bytes behind a file descriptor."""

    _unsent = b""
    """The end of a frame that the kernel took only in part; it is written first, so that frames stay complete."""

    def _finish(self, fd: int) -> bool:
        """Write the end of the last frame, and return True if nothing of it is left."""
        if self._unsent:
            self._put(fd, self._unsent, self._unsent)
        return not self._unsent

    def _put(self, fd: int, data: bytes, unsent: bytes = b"") -> bool:
        """Write data, and return True if the kernel has taken it, at least in part; else ``unsent`` stays unsent.

        Raises:
            TransportError: the port is lost.
        """
        try:
            written = os.write(fd, data)
        except OSError as error:
            if error.errno not in _NOT_NOW:
                raise TransportError(f"lost the port {self.address}: {reason_of(error)}") from None
            written = 0
        self._unsent = data[written:] if written else unsent
        return written > 0
