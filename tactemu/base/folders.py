"""Folders of one user alone: nothing is loaded from where others can write."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from pathlib import Path

from tactemu.base.leftovers import remove_at_end


def ours_alone(folder: Path) -> bool:
    """Whether this is a folder, no link to one, that nobody else can open (mode 0700).

    Raises:
        OSError: there is nothing, or it cannot be looked at.
    """
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077


def temporary_folder(kind: str) -> tuple[Path, str]:
    """A folder for ``kernels`` or the like of all runs of this user, where none that lasts can be written.

    Where its name is taken by somebody else, or open to others, it is one of this run alone.

    Returns:
        The folder, and what to say of it; empty where that was said when it was made.
    """
    folder = Path(tempfile.gettempdir()) / f"tactemu-{kind}-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700)
        return folder, f"{kind} are kept in {folder}"
    except FileExistsError:
        if ours_alone(folder):
            return folder, ""
    own = tempfile.mkdtemp(prefix=f"tactemu-{kind}-")
    remove_at_end(lambda: shutil.rmtree(own, ignore_errors=True))
    return Path(own), f"and {folder} is not ours alone, {kind} are compiled anew in each run"
