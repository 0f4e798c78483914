"""The start of Warp without its banner, which would mix with screens and JSON lines, and its kernel cache."""

from __future__ import annotations

import os
import sys

from tactemu.base.folders import temporary_folder


def start_quietly() -> None:
    """Initialise Warp without its native warning of a missing GPU; a scene that needs a GPU raises its own error.

    A program that has set Warp's log level keeps it.
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
    """Initialise Warp; if its kernel cache cannot be written (a read-only home, or none), use a temporary folder.

    A note on stderr names the folder once, when it is made. A Warp that runs already is left as it is.
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
