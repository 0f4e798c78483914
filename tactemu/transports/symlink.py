"""A stable name for a port that the kernel names anew each time: a symbolic link that goes when we go."""

from __future__ import annotations

import atexit
import hashlib
import os
import signal
import socket
import threading
from pathlib import Path

from tactemu.errors import TransportError

_LIVE: set[StableLink] = set()


class StableLink:
    """A symbolic link to a pseudo terminal, put in place in one step and removed on close, exit or SIGTERM."""

    def __init__(self, path: str):
        self.path = Path(os.path.abspath(os.path.expanduser(path)))
        self._target = ""
        self._claim: socket.socket | None = None

    def point_to(self, target: str) -> None:
        """Create the link, or move one that was left behind by an earlier run.

        Raises:
            TransportError: the path is taken by something that is not such a link or by a run that is still alive, or
                cannot be written.
        """
        self._check()
        self._claim = self._claim or _claimed(self.path)
        aside = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            aside.symlink_to(target)
            aside.replace(self.path)
        except OSError as error:
            aside.unlink(missing_ok=True)
            self.remove()
            raise TransportError(
                f"cannot create the port {self.path}: {error.strerror}; choose a path in a folder that you may write"
            ) from None
        self._target = target
        _LIVE.add(self)
        _catch_termination()

    def remove(self) -> None:
        """Remove the link if it is still ours. Safe to call twice."""
        _LIVE.discard(self)
        try:
            if self._target and os.readlink(self.path) == self._target:
                self.path.unlink()
        except OSError:
            pass  # somebody else removed or replaced it
        self._target = ""
        if self._claim is not None:
            self._claim.close()
            self._claim = None

    def _check(self) -> None:
        if not self.path.parent.is_dir():
            raise TransportError(f"cannot create the port {self.path}: there is no folder {self.path.parent}; make it")
        if self.path.is_symlink():
            target = os.readlink(self.path)
            if not target.startswith("/dev/pts/"):
                raise TransportError(f"{self.path} is a link to {target}, not to a pseudo terminal; it is left alone")
        elif self.path.exists():
            raise TransportError(f"{self.path} exists and is not a link; it is left alone: choose another path")


def _claimed(path: Path) -> socket.socket:
    """A mark that ``path`` is in use, which ends with the process however it ends: a socket's abstract name.

    Raises:
        TransportError: somebody else holds it.
    """
    whole = os.fsencode(os.path.join(os.path.realpath(path.parent), path.name))
    mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        mark.bind(b"\0tactemu:" + hashlib.sha256(whole).hexdigest().encode())
    except OSError:
        mark.close()
        raise TransportError(f"{path} is the port of another run that is still alive; choose another path") from None
    return mark


@atexit.register
def _remove_all() -> None:
    for link in list(_LIVE):
        link.remove()


def _catch_termination() -> None:
    """SIGTERM and SIGHUP end a process without running its exit handlers; where nobody else handles them, clean up."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _terminate)


def _terminate(number: int, _frame) -> None:
    _remove_all()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)
