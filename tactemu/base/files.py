"""Files written completely or not at all, and never over those of other programs; files removed at exit."""

from __future__ import annotations

import atexit
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from tactemu.base.errors import TactemuError, reason_of

MAX_HEAD_BYTES = 4096
"""Number of bytes of an existing file that are searched for a sign of tactemu; bounds the time for a large file."""


def check_overwriting(path: str | Path, *signs: str, reads: Iterable[str | Path] = ()) -> None:
    """Raise if a file must not be overwritten: the run reads it, or tactemu did not write it.

    A missing or empty file passes, and so does a device node or a FIFO.

    Args:
        path: the file that will be written.
        signs: texts; every file that tactemu writes there has one of them in its first bytes.
        reads: the files that the run itself reads.

    Raises:
        TactemuError: names what to do instead.
    """
    path = Path(path)
    if not path.is_file():
        return
    for other in map(Path, reads):
        if other.exists() and path.samefile(other):
            raise TactemuError(f"{path}: the run reads this file and cannot overwrite it; name another")
    try:
        with path.open("rb") as file:
            head = file.read(MAX_HEAD_BYTES)
    except OSError as error:
        raise TactemuError(f"{path}: cannot be read to see whether tactemu wrote it: {reason_of(error)}") from None
    if head and not any(sign.encode() in head for sign in signs):
        about = "was not written by tactemu and is not overwritten; remove it first, or name another file"
        raise TactemuError(f"{path}: {about}")


def check_writable(path: str | Path | None, what: str, *signs: str) -> None:
    """Raise if a path cannot be written or must not be overwritten, before a run whose results go there.

    Args:
        path: the file; ``None``: none is wanted.
        what: its content, for the message.
        signs: as those of :func:`check_overwriting`.

    Raises:
        TactemuError: the folder does not exist, the path is a folder, permission is missing, or the file is of another
            program.
    """
    if path is None:
        return
    target = _behind_links(path)
    problem = ""
    if target.is_dir():
        problem = "is a folder"
    elif not target.parent.is_dir():
        problem = reason_of(FileNotFoundError(errno.ENOENT, ""), target)
    elif not os.access(target if target.exists() else target.parent, os.W_OK):
        problem = "permission denied"
    if problem:
        raise TactemuError(f"{path}: cannot write {what}: {problem}")
    check_overwriting(path, *signs)


def check_folder(path: str | Path | None, what: str, names: Iterable[str] = (), sign: str = "") -> None:
    """Raise if files cannot be written to a folder; make nothing. The folder need not exist, and gets its parents.

    Args:
        path: the folder; ``None``: none is wanted.
        what: its content, for the message.
        names: names of the files that may be written there, or patterns such as ``*.jsonl``.
        sign: as a sign of :func:`check_overwriting`, of all these files.

    Raises:
        TactemuError: a part of the path is no folder, permission is missing, or such a file is of another program.
    """
    if path is None:
        return
    there = _behind_links(path)
    while not os.path.exists(there):
        there = there.parent
    try:
        tempfile.TemporaryFile(dir=there).close()
    except OSError as error:
        raise TactemuError(f"{path}: cannot write {what}: {there}: {reason_of(error)}") from None
    for name in names:
        for file in sorted(Path(path).glob(name)):
            check_overwriting(file, sign)


@contextmanager
def writing(path: str | Path) -> Iterator[IO[bytes]]:
    """Open ``path`` for writing; a regular file stays as it was until all is written.

    A link is followed. A FIFO or a device node is written to and stays what it is.

    Raises:
        OSError: the path cannot be written.
    """
    target = _behind_links(path)
    if not _is_replaceable(target):
        with target.open("wb") as file:
            yield file
        return
    with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name}.", delete=False) as file:
        try:
            yield file  # type: ignore[misc]
            file.close()
            os.chmod(file.name, target.stat().st_mode & 0o7777 if target.exists() else 0o666 & ~_umask())
            os.replace(file.name, target)
        except BaseException:
            os.unlink(file.name)
            raise


def move_into_place(made: Path, path: Path) -> None:
    """Rename a complete file to ``path``, through links; copy it into a FIFO or a device node instead.

    Raises:
        OSError: the path cannot be written.
    """
    target = _behind_links(path)
    if _is_replaceable(target):
        os.replace(made, target)
        return
    with made.open("rb") as source, target.open("wb") as sink:
        shutil.copyfileobj(source, sink)
    made.unlink()


_REMOVALS: list[Callable[[], object]] = []


def remove_at_end(removal: Callable[[], object]) -> None:
    """Call ``removal`` when the process ends, also if its files are gone by then."""
    _REMOVALS.append(removal)


@atexit.register
def remove_leftovers() -> None:
    """Remove all these files now: at exit, and from a handler of a signal that ends the process at once."""
    while _REMOVALS:
        with suppress(Exception):
            _REMOVALS.pop()()


def _behind_links(path: str | Path) -> Path:
    return Path(os.path.realpath(path))


def _is_replaceable(target: Path) -> bool:
    return target.is_file() or target.is_dir() or not target.exists()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
