"""The declaration of our kernels; the start of Warp without its banner, which would mix with screens and JSON lines;
its kernel cache, which gets the kernels that were compiled ahead of time."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import Any

from tactemu.base.cpu_code import compiler_flags, fill_cache
from tactemu.base.folders import temporary_folder


def warp_kernel(function: Callable | None = None, *, module_options: dict[str, Any] | None = None, **options) -> Any:
    """Declare a kernel in a module of its own, without a backward pass, compiled for the CPU with our flags.

    Args:
        function: the kernel; a decorator without arguments passes it.
        module_options: more options of the kernel's module, by Warp's names.
        options: more options of ``wp.kernel``.
    """
    import warp as wp

    how = {"cpu_compiler_flags": compiler_flags(), **(module_options or {})}
    return wp.kernel(function, module="unique", enable_backward=False, module_options=how, **options)


@cache
def start_warp() -> None:
    """Initialise Warp without its messages; if its kernel cache cannot be written, use a temporary folder.

    Hidden are its banner, its line for each module that it loads, and its native warning of a missing GPU; a scene that
    needs a GPU raises its own error. A program that has set Warp's log level keeps it, and the messages. A note on
    stderr names the temporary folder once, when it is made.
    """
    import warp

    is_quiet = warp.config.log_level == warp.LOG_INFO
    if is_quiet:
        warp.config.log_level = warp.LOG_ERROR
    with _without_stderr() if is_quiet else nullcontext():
        note = _init()
    fill_cache(str(warp.config.kernel_cache_dir))
    sys.stderr.write(note)


@contextmanager
def _without_stderr() -> Iterator[None]:
    """Discard what native code writes to stderr."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _init() -> str:
    """Initialise Warp, and return the note for the user."""
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
