"""A stable name for a port that the kernel names anew each time: a symbolic link that goes when its maker goes."""

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
"""``mask``: the signals that a thread held back before the fork that it is in the middle of."""


class StableLink:
    """A symbolic link to a pseudo terminal, put in place in one step and removed on close, exit or SIGTERM.

    Only by the process that made it: a forked child leaves it alone.
    """

    def __init__(self, path: str):
        self.path = Path(os.path.abspath(os.path.expanduser(path)))
        self._target = ""
        self._claim: socket.socket | None = None
        self._maker = 0
        """Process that made the link."""

    def point_to(self, target: str) -> None:
        """Create the link, or move one that was left behind by an earlier run.

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


def _put(path: Path, target: str) -> None:
    """A link at ``path``, in one step also where there is one already."""
    aside = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    aside.symlink_to(target)
    try:
        aside.replace(path)
    except OSError:
        aside.unlink()
        raise


def _claim_path(path: Path) -> socket.socket:
    """Return a mark that ``path`` is in use, which ends with the process however it ends: a socket's abstract name.

    Raises:
        TransportError: somebody else holds it.
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
    """SIGTERM and SIGHUP end a process without running its exit handlers; where nobody else handles them, clean up."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _terminate)


def _before_fork() -> None:
    """A signal that reaches a child before it is a program of its own is held back: Python would forget it."""
    _HELD.mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)


def _let_signals_in() -> None:
    signal.pthread_sigmask(signal.SIG_SETMASK, _HELD.mask)


def _after_fork_in_child() -> None:
    """A child has no port to remove: it dies of a signal as any program does."""
    _LIVE.clear()
    for number in _ENDING:
        if signal.getsignal(number) is _terminate:
            signal.signal(number, signal.SIG_DFL)
    _let_signals_in()


os.register_at_fork(before=_before_fork, after_in_parent=_let_signals_in, after_in_child=_after_fork_in_child)


def _terminate(number: int, _frame) -> None:
    _remove_all()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)
