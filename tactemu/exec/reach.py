"""Detection of programs that cannot load the preload library, from their files.

Such a program still finds the nodes, sysfs and udev's data, and reads and writes; but it has no modem lines, break,
parity, low latency and udev's events, which the library provides.
"""

from __future__ import annotations

import os
import platform
import shutil
import stat
import struct
from pathlib import Path

_ELF = struct.Struct("<16sHHIQQQIHHHHHH")
_SEGMENT = struct.Struct("<IIQQQQQQ")
_SECTION = struct.Struct("<IIQQQQIIQQ")
_INTERPRETER = 3
_MAX_INTERPRETERS = 4
"""Maximum number of scripts that name each other as interpreter, as in the kernel."""
_MACHINES = {"x86_64": 62, "aarch64": 183}


def out_of_reach(command: str) -> str:
    """Return why a command does not load the library, or ``""`` if it does, or if that is unknown."""
    path = shutil.which(command)
    for _ in range(_MAX_INTERPRETERS):
        if path is None:
            return ""
        try:
            with open(path, "rb") as file:
                head = file.read(256)
                if head[:4] == b"\x7fELF":
                    return _of_program(path, file)
        except OSError:
            return ""
        path = _interpreter(head)
    return ""


def _interpreter(head: bytes) -> str | None:
    """Return the interpreter of a script: ``#!/usr/bin/env python3`` is run by ``python3``."""
    if not head.startswith(b"#!"):
        return None
    words = os.fsdecode(head[2:].partition(b"\n")[0]).split()
    if len(words) > 1 and Path(words[0]).name == "env":
        named = next((word for word in words[1:] if not word.startswith("-") and "=" not in word), "")
        return shutil.which(named)
    return words[0] if words else None


def _of_program(path: str, file) -> str:
    name = Path(path).name
    mode = os.stat(path).st_mode
    if mode & (stat.S_ISUID | stat.S_ISGID) or _has_capabilities(path):
        return (
            f"{name} runs with another user's rights (set-uid, or capabilities), so the system loads no library into it"
        )
    file.seek(0)
    header = file.read(_ELF.size)
    if len(header) < _ELF.size or header[4] != 2 or header[5] != 1:
        return f"{name} is no 64-bit program, but the library is"
    _, _, machine, _, _, segments_at, sections_at, _, _, size, count, each, sections, names = _ELF.unpack(header)
    if machine != _MACHINES.get(platform.machine(), machine):
        return f"{name} is made for another processor"
    file.seek(segments_at)
    table = file.read(size * count)
    kinds = [_SEGMENT.unpack_from(table, k * size) for k in range(count)]
    loader = next((entry for entry in kinds if entry[0] == _INTERPRETER), None)
    if loader is None:
        return f"{name} is statically linked"
    file.seek(loader[2])
    if b"ld-musl" in file.read(loader[5]):
        return f"{name} is linked with musl, but the library with glibc"
    if ".go.buildinfo" in _section_names(file, sections_at, each, sections, names):
        return f"{name} is written in Go, which calls the kernel itself"
    return ""


def _section_names(file, at: int, size: int, count: int, names: int) -> list[str]:
    if not names or names >= count:
        return []
    file.seek(at)
    table = file.read(size * count)
    entries = [_SECTION.unpack_from(table, k * size) for k in range(count)]
    file.seek(entries[names][4])
    text = file.read(entries[names][5])
    return [text[entry[0] : text.find(b"\0", entry[0])].decode("ascii", "replace") for entry in entries]


def _has_capabilities(path: str) -> bool:
    try:
        return bool(os.getxattr(path, "security.capability"))
    except OSError:
        return False
