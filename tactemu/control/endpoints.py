"""The sockets of running emulators: a Unix socket each, in a folder that only its user can open.

The folder is ``$XDG_RUNTIME_DIR/tactemu``, else ``tactemu-UID`` in the folder for temporary files. ``NAME.sock`` is the
socket, ``NAME.json`` names its owner: the id and the start of the process, and what it runs. With these, the files of a
process that ended without removing them are recognised and removed.
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

from tactemu.base.errors import TactemuError, TransportError, nearest, reason_of
from tactemu.base.folders import is_private_folder

PROTOCOL = 1
"""Version of the protocol on the sockets."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,39}")
_MAX_PATH_BYTES = 107
"""Maximum length of a socket's path in Linux."""
_MAX_NAMES = 1000
"""Number of names, with a number behind each, that are tried before a run is refused."""
_CREDENTIALS = struct.Struct("3i")


@dataclass(frozen=True)
class Owner:
    """The process that owns a socket."""

    name: str
    pid: int
    start: int
    """Start of the process [ticks since the machine's start], because process ids are reused."""
    target: str
    """The device or scene that it runs."""

    @property
    def alive(self) -> bool:
        """True if the process still exists."""
        return started(self.pid) == self.start


def started(pid: int) -> int:
    """Return the start of a process [ticks]; 0 if there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
        state, *fields = text.rpartition(")")[2].split()
        return 0 if state == "Z" else int(fields[18])
    except (OSError, ValueError, IndexError):
        return 0


def folder(*, make: bool = False) -> Path:
    """Return the folder of the sockets.

    Raises:
        TransportError: it belongs to another user, is open to others, or cannot be made.
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
        raise TransportError(f"{path}: cannot make this folder for control sockets: {reason_of(error)}") from None
    if not ours:
        raise TransportError(
            f"{path}: no control socket is used there, because it is not your private folder; remove it, or make it "
            "yours with mode 0700"
        )
    return path


@contextlib.contextmanager
def _locked(where: Path) -> Iterator[None]:
    """Hold the lock of the folder, without which no process takes or releases a name."""
    handle = os.open(where / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def owner_of(path: Path) -> Owner | None:
    """Return the process that owns ``NAME.sock``, or None if unknown."""
    try:
        table = json.loads(path.with_suffix(".json").read_text())
        return Owner(path.stem, int(table["pid"]), int(table["start"]), str(table["target"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def running() -> list[Owner]:
    """Return this user's running emulators, sorted by name; remove the files of those that have ended.

    Raises:
        TransportError: the folder is not private.
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
    """The name and the socket of an emulator, from :meth:`take` to :meth:`leave`.

    Args:
        name: the name; without ``exactly`` it may get a number behind it.
        target: the device or scene that is run.
        exactly: use this name, or raise.
    """

    def __init__(self, name: str, target: str, *, exactly: bool):
        if exactly and not _NAME.fullmatch(name):
            raise TactemuError(f"--name {name}: expected letters, digits, '_', '-' and '.', at most 40")
        self.name = name if exactly else re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:30] or "tactemu"
        self._target, self._exactly = target, exactly
        self.path: Path | None = None
        self._owner_pid = 0

    def take(self) -> socket.socket:
        """Return the socket to listen on.

        Raises:
            TransportError: another run has the name, or no socket can be made.
        """
        where = folder(make=True)
        with _locked(where):
            for number in range(1, 2 if self._exactly else _MAX_NAMES):
                name = self.name if number == 1 else f"{self.name}-{number}"
                path = where / f"{name}.sock"
                owner = owner_of(path) if path.exists() else None
                if owner is None or not owner.alive:
                    return self._listen(path, name)
        taken = f"process {owner.pid} has this name ({owner.target})"  # type: ignore[union-attr]
        raise TransportError(f"--name {self.name}: {taken}; choose another")

    def _listen(self, path: Path, name: str) -> socket.socket:
        if len(os.fsencode(path)) > _MAX_PATH_BYTES:
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
            raise TransportError(f"{path}: cannot make this socket: {reason_of(error)}") from None
        listener.setblocking(False)
        self.name, self.path, self._owner_pid = name, path, os.getpid()
        return listener

    def leave(self) -> None:
        """Release the name and remove the socket. Safe to call twice; a forked child does not touch its parent's."""
        if self.path is not None and self._owner_pid == os.getpid():
            with contextlib.suppress(OSError), _locked(self.path.parent):
                _remove(self.path)
        self.path = None


def uid_of_peer(connection: socket.socket) -> int:
    """Return the id of the user at the other end."""
    _, uid, _ = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return uid


def chosen(name: str | None = None) -> Path:
    """Return the path of the socket of the emulator ``name``, or of the only one that runs.

    Raises:
        TactemuError: there is none, or there are several; the message lists them.
    """
    there = running()
    names = [owner.name for owner in there]
    if name is None and len(there) == 1:
        name = names[0]
    listed = "".join(f"\n  {owner.name:<12} {owner.target}  (process {owner.pid})" for owner in there)
    if name is None:
        several = f"several emulators run; choose one with --name:{listed}"
        raise TactemuError(several if there else "no emulator runs; start one: tactemu run anyskin")
    if name not in names:
        raise TactemuError(
            f"no emulator {name!r} runs{nearest(name, names)}" + (f"; choose one of:{listed}" if there else "")
        )
    return folder() / f"{name}.sock"
