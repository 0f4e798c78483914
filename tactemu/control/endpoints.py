"""Where running emulators are found: a Unix socket each, in a folder that only its user can open.

The folder is ``$XDG_RUNTIME_DIR/tactemu``, else ``tactemu-UID`` in the one for temporary files. ``NAME.sock`` is the
socket, ``NAME.json`` says whose it is: the process, by its number and its start, and what it runs. What a process left
that ended without tidying up is known by these, and removed.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import socket
import struct
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from tactemu.base.errors import TactemuError, TransportError
from tactemu.base.folders import is_private_folder

PROTOCOL = 1
"""Version of what is said on the sockets."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,39}")
_LONGEST_ADDRESS = 107
"""Bytes of a socket's path that the kernel takes."""
_MOST = 1000
"""Names that are tried before none is left."""
_CREDENTIALS = struct.Struct("3i")


@dataclass(frozen=True)
class Owner:
    """Whose a socket is."""

    name: str
    pid: int
    start: int
    """When the process started [ticks since the machine did]: numbers of processes are used again."""
    target: str
    """What it runs."""

    @property
    def alive(self) -> bool:
        """Whether the process is still there."""
        return started(self.pid) == self.start


def started(pid: int) -> int:
    """When a process started [ticks]; 0: there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
        state, *rest = text.rpartition(")")[2].split()
        return 0 if state == "Z" else int(rest[18])
    except (OSError, ValueError, IndexError):
        return 0


def folder(*, make: bool = False) -> Path:
    """Where the sockets are.

    Raises:
        TransportError: it is somebody else's, or open to others, or cannot be made.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    path = Path(runtime) / "tactemu" if runtime else Path(tempfile.gettempdir()) / f"tactemu-{os.getuid()}"
    try:
        if make and not path.is_symlink() and not path.exists():
            path.mkdir(mode=0o700, exist_ok=True)
        ours = is_private_folder(path)
    except FileNotFoundError:
        if not make:
            return path
        raise TransportError(f"{path}: cannot make this folder for control sockets: {path.parent} is missing") from None
    except OSError as error:
        raise TransportError(f"{path}: cannot make this folder for control sockets: {error.strerror}") from None
    if not ours:
        raise TransportError(f"{path}: is not a folder of yours alone (mode 0700), so no control socket is used there")
    return path


@contextlib.contextmanager
def _locked(where: Path) -> Iterator[None]:
    """Nobody else takes or gives up a name meanwhile."""
    handle = os.open(where / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def owner_of(path: Path) -> Owner | None:
    """Who made ``NAME.sock``; ``None``: nobody says."""
    try:
        said = json.loads(path.with_suffix(".json").read_text())
        return Owner(path.stem, int(said["pid"]), int(said["start"]), str(said["target"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def running() -> list[Owner]:
    """Return the emulators of this user that can be driven, by name. What the dead left is removed.

    Raises:
        TransportError: the folder is not one to trust.
    """
    where = folder()
    if not where.is_dir():
        return []
    with _locked(where):
        found = []
        for path in sorted(where.glob("*.sock")):
            owner = owner_of(path)
            if owner is not None and owner.alive:
                found.append(owner)
            else:
                _remove(path)
        return found


def _remove(path: Path) -> None:
    for each in (path, path.with_suffix(".json")):
        each.unlink(missing_ok=True)


class Endpoint:
    """A name and its socket, from :meth:`take` to :meth:`leave`.

    Args:
        name: what to be called; one that is not asked for by the user may get a number behind it.
        target: what is run.
        exactly: this name, or none.
    """

    def __init__(self, name: str, target: str, *, exactly: bool):
        if exactly and not _NAME.fullmatch(name):
            raise TactemuError(f"--name {name}: expected letters, digits, '_', '-' and '.', at most 40")
        self.name = name if exactly else re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:30] or "tactemu"
        self._target, self._exactly = target, exactly
        self.path: Path | None = None
        self._maker = 0

    def take(self) -> socket.socket:
        """Return the socket to listen on.

        Raises:
            TransportError: the name is another run's, or no socket can be made.
        """
        where = folder(make=True)
        with _locked(where):
            for number in range(1, 2 if self._exactly else _MOST):
                name = self.name if number == 1 else f"{self.name}-{number}"
                path = where / f"{name}.sock"
                owner = owner_of(path) if path.exists() else None
                if owner is None or not owner.alive:
                    return self._listen(path, name)
        raise TransportError(f"--name {self.name}: process {owner.pid} has this name ({owner.target})")  # type: ignore[union-attr]

    def _listen(self, path: Path, name: str) -> socket.socket:
        if len(os.fsencode(path)) > _LONGEST_ADDRESS:
            raise TransportError(f"{path}: too long for a socket; set XDG_RUNTIME_DIR to a shorter path")
        _remove(path)
        owner = Owner(name, os.getpid(), started(os.getpid()), self._target)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            path.with_suffix(".json").write_text(json.dumps(asdict(owner)) + "\n")
            listener.bind(str(path))
            listener.listen(16)
        except OSError as error:
            listener.close()
            raise TransportError(f"{path}: cannot listen there: {error.strerror}") from None
        listener.setblocking(False)
        self.name, self.path, self._maker = name, path, os.getpid()
        return listener

    def leave(self) -> None:
        """Give the name up. Safe to call twice; a forked child leaves its parent's alone."""
        if self.path is not None and self._maker == os.getpid():
            with contextlib.suppress(OSError), _locked(self.path.parent):
                _remove(self.path)
        self.path = None


def uid_of_peer(connection: socket.socket) -> int:
    """Who is at the other end."""
    _, uid, _ = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return uid


def chosen(name: str | None = None) -> Path:
    """Return the socket of the emulator called ``name``, or of the only one that runs.

    Raises:
        TactemuError: there is none, or several; the message lists them.
    """
    there = running()
    names = [owner.name for owner in there]
    if name is None and len(there) == 1:
        name = names[0]
    listed = "".join(f"\n  {owner.name:<12} {owner.target}  (process {owner.pid})" for owner in there)
    if name is None:
        more = f"several emulators run; say which with --name:{listed}" if there else "no emulator runs"
        raise TactemuError(more if there else f"{more}; start one: tactemu run anyskin")
    if name not in names:
        raise TactemuError(f"no emulator {name!r} runs" + (f"; these do:{listed}" if there else ""))
    return folder() / f"{name}.sock"
