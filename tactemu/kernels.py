"""Starting Warp without its banner: a screen and JSON lines are ours alone; and where its kernels are kept."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile


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
        lost = _start(warp)
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
    if lost:
        sys.stderr.write(
            f"tactemu: {lost} cannot be written, so kernels are compiled anew in each run; "
            "WARP_CACHE_PATH names a folder that keeps them\n"
        )


def _start(warp) -> str:
    """Initialise Warp; where it cannot keep its kernels (a container without a home), a folder of this run does.

    Returns:
        The folder that cannot be written; empty where all is well.
    """
    try:
        warp.init()
        if os.access(warp.config.kernel_cache_dir, os.W_OK):
            return ""
    except OSError:
        pass
    lost = warp.config.kernel_cache_dir
    warp.config.kernel_cache_dir = tempfile.mkdtemp(prefix="tactemu-kernels-")
    atexit.register(shutil.rmtree, warp.config.kernel_cache_dir, ignore_errors=True)
    warp.init()
    return str(lost)
