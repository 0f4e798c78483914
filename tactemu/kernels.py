"""Starting Warp without its banner: a screen and JSON lines are ours alone."""

from __future__ import annotations

import os
import sys


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
        warp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
