"""Private folders of one user, and the folder of the examples: code and sockets are never taken from where other users
can write."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from pathlib import Path

from tactemu.base.files import remove_at_end

EXAMPLES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[2] / "examples")
"""The folder of the examples in the installed package, and in a source tree."""


def is_private_folder(folder: Path) -> bool:
    """Return True for a folder, not a link to one, of this user that no other user can open (mode 0700).

    Raises:
        OSError: it does not exist, or its mode cannot be read.
    """
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077


def temporary_folder(kind: str) -> tuple[Path, str]:
    """Return a temporary folder for ``kernels`` or the like that all runs of this user share.

    If another user owns a folder of its name, or can open it, a folder of this run alone takes its place.

    Returns:
        The folder, and a note for the user; empty if an earlier run has made the folder.
    """
    folder = Path(tempfile.gettempdir()) / f"tactemu-{kind}-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700)
        return folder, f"{kind} are kept in {folder}"
    except FileExistsError:
        if is_private_folder(folder):
            return folder, ""
    own = tempfile.mkdtemp(prefix=f"tactemu-{kind}-")
    remove_at_end(lambda: shutil.rmtree(own, ignore_errors=True))
    return Path(own), f"and {folder} is not ours alone, {kind} are compiled anew in each run"


def cache_folder(kind: str) -> Path:
    """Return the folder ``~/.cache/tactemu/KIND`` (``$XDG_CACHE_HOME`` moves it), or a temporary one if it cannot be
    written to."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "tactemu" / kind
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder if os.access(folder, os.W_OK) else temporary_folder(kind)[0]


def example_file(name: str) -> Path:
    """Return a file of the examples.

    Raises:
        FileNotFoundError: the installation lacks it.
    """
    for folder in EXAMPLES:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(f"{name} is in neither of {', '.join(map(str, EXAMPLES))}")
