"""System calls that Python does not provide, and their constants."""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET = 0x20000, 0x1000_0000, 0x4000_0000
MS_NOSUID, MS_BIND, MS_REC, MS_SLAVE = 2, 4096, 16384, 1 << 19
MNT_DETACH = 2

_libc = ctypes.CDLL(None, use_errno=True)


def _check(result: int, what: str) -> None:
    if result:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), what)


@contextlib.contextmanager
def buffer(data: bytes) -> Iterator[int]:
    """Yield the address of a copy of the data, valid inside the context."""
    held = ctypes.create_string_buffer(data, len(data))
    yield ctypes.addressof(held)


def unshare(flags: int) -> None:
    """Move this process into new namespaces.

    Raises:
        OSError: the kernel does not allow it.
    """
    _check(_libc.unshare(flags), "unshare")


def mount(source: str, target: str, kind: str = "", flags: int = 0, options: str = "") -> None:
    """Mount a file system, or with ``MS_BIND`` a file or folder.

    Raises:
        OSError: the kernel does not allow it.
    """
    words = [text.encode() or None for text in (source, target, kind)]
    _check(_libc.mount(*words, ctypes.c_ulong(flags), options.encode() or None), target)


def unmount(target: str) -> None:
    """Remove a mount, even one in use.

    Raises:
        OSError: nothing is mounted there.
    """
    _check(_libc.umount2(target.encode(), MNT_DETACH), target)
