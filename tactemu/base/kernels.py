"""Starting Warp without its banner: a screen and JSON lines are ours alone; and where its kernels are kept."""

from __future__ import annotations

import os
import sys

from tactemu.base.folders import temporary_folder


def start_quietly() -> None:
    """Initialise Warp without its native warning of a missing GPU; whoever asks for one hears of it from us.

    A program that has told Warp otherwise how much to say has its way.
    """
    import warp

    if warp.config.log_level != warp.LOG_INFO:
        return
    warp.config.log_level = warp.LOG_ERROR
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        said = _start()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
    sys.stderr.write(said)


def start() -> None:
    """Initialise Warp; where it cannot keep its kernels (a home that is read-only, or none), a temporary folder does.

    That is said once, when the folder is made. Costs nothing where Warp runs already.
    """
    sys.stderr.write(_start())


def _start() -> str:
    import warp

    try:
        warp.init()
        if os.access(warp.config.kernel_cache_dir or "", os.W_OK):
            return ""
    except OSError:
        pass
    lost = warp.config.kernel_cache_dir
    folder, note = temporary_folder("kernels")
    warp.config.kernel_cache_dir = str(folder)
    warp.init()
    return note and f"tactemu: {lost} cannot be written, so {note}; WARP_CACHE_PATH names another folder\n"
