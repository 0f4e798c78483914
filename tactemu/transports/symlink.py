"""Stable names for ports to which the kernel gives new names: symbolic links that are removed with their process."""

from __future__ import annotations

import hashlib
import os
import secrets
import signal
import socket
import threading
from pathlib import Path

from tactemu.base.errors import TransportError, shown
from tactemu.base.files import remove_at_end

_LIVE: set[StableLink] = set()
_ENDING = (signal.SIGTERM, signal.SIGHUP)
_HELD = threading.local()
"""``mask``: the signals that a thread had blocked before the fork that it is performing."""


class StableLink:
    """A symbolic link to a pseudo terminal, made in one step and removed on close, exit or SIGTERM.

    Only the process that made it removes it: a forked child does not.
    """

    def __init__(self, path: str):
        self.path = Path(os.path.abspath(os.path.expanduser(path)))
        self._target = ""
        self._claim: socket.socket | None = None
        self._maker = 0
        """The id of the process that made the link."""

    def point_to(self, target: str) -> None:
        """Create the link, or redirect one that an earlier run has left behind.

        Raises:
            TransportError: the path is taken by something that is not such a link or by a run that is still alive, or
                cannot be written.
        """
        try:
            self._check()
            self._claim = self._claim or _claim_path(self.path)
            _put(self.path, target)
        except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
            self.remove()
            raise TransportError(
                f"cannot create the port {shown(str(self.path))}: {getattr(error, 'strerror', '') or error}; "
                "choose a path in a folder that you may write"
            ) from None
        self._target, self._maker = target, os.getpid()
        _LIVE.add(self)
        _catch_termination()

    def remove(self) -> None:
        """Remove the link if it is still ours. Safe to call twice."""
        _LIVE.discard(self)
        try:
            if self._target and self._maker == os.getpid() and os.readlink(self.path) == self._target:
                self.path.unlink()
        except OSError:
            pass  # another process removed or replaced it
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
                raise TransportError(
                    f"{self.path} is a link to {target}, not to a pseudo terminal; it stays: choose another path"
                )
        elif self.path.exists():
            raise TransportError(f"{self.path} exists and is not a link; it stays: choose another path")


def _put(path: Path, target: str) -> None:
    """Make a link at ``path``, in one step also where there is one already."""
    aside = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    aside.symlink_to(target)
    try:
        aside.replace(path)
    except OSError:
        aside.unlink()
        raise


def _claim_path(path: Path) -> socket.socket:
    """Return a lock on ``path`` that ends with the process however it ends: a socket with an abstract name.

    Raises:
        TransportError: another run holds it.
    """
    full_path = os.fsencode(os.path.join(os.path.realpath(path.parent), path.name))
    mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        mark.bind(b"\0tactemu:" + hashlib.sha256(full_path).hexdigest().encode())
    except OSError:
        mark.close()
        raise TransportError(f"{path} is the port of another run that is still alive; choose another path") from None
    return mark


def _remove_all() -> None:
    for link in list(_LIVE):
        link.remove()


remove_at_end(_remove_all)


def _catch_termination() -> None:
    """Install handlers that remove all links on SIGTERM and SIGHUP, where these have no other handler."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _terminate)


def _before_fork() -> None:
    """Block termination signals during a fork: Python would lose one that reaches the child before it is set up."""
    _HELD.mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)


def _unblock_signals() -> None:
    signal.pthread_sigmask(signal.SIG_SETMASK, _HELD.mask)


def _after_fork_in_child() -> None:
    """Restore the default handling of signals in a child, which has no port to remove."""
    _LIVE.clear()
    for number in _ENDING:
        if signal.getsignal(number) is _terminate:
            signal.signal(number, signal.SIG_DFL)
    _unblock_signals()


os.register_at_fork(before=_before_fork, after_in_parent=_unblock_signals, after_in_child=_after_fork_in_child)


def _terminate(number: int, _frame) -> None:
    _remove_all()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)
