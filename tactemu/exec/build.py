"""The preload library: that of the wheel, else one that a local compiler makes once."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from tactemu.base.errors import reason_of

SOURCES = Path(__file__).parent / "preload"
BUILT = "preload.so"
"""The name of the library, which is beside its sources in a wheel."""
FLAGS = ("-std=gnu11", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra", "-Wl,-z,relro,-z,now", "-s")
_COMPILERS = ("cc", "gcc", "clang")


class NoLibrary(Exception):
    """The preload library is missing and cannot be made; the text names the reason and the remedy."""


def library() -> Path:
    """Return the path of the library, after making it if necessary.

    Raises:
        NoLibrary: it is missing and cannot be made.
    """
    if (SOURCES / BUILT).exists():
        return SOURCES / BUILT
    from tactemu.base.folders import cache_folder  # the build of a wheel runs this file without the package

    made = cache_folder("exec") / f"{_digest()}.so"
    if not os.access(made, os.R_OK):
        compile_to(made, compiler())
    return made


def compiler() -> list[str]:
    """Return a C compiler: ``$CC``, one of the usual names, or the one of the package ``ziglang``.

    Raises:
        NoLibrary: there is none.
    """
    if named := os.environ.get("CC"):
        return named.split()
    for name in _COMPILERS:
        if found := shutil.which(name):
            return [found]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NoLibrary(
        "this installation has no preload library, and there is no C compiler to make it; `pip install ziglang` "
        "installs one, and the wheels for x86_64 and aarch64 contain the library"
    )


def compile_to(target: Path, command: Sequence[str]) -> None:
    """Compile the library; the target appears in one step.

    Raises:
        NoLibrary: the compiler fails, or the folder cannot be written.
    """
    sources = sorted(str(path) for path in SOURCES.glob("*.c"))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent) as folder:
            made = Path(folder) / target.name
            done = subprocess.run(
                [*command, *FLAGS, "-o", str(made), *sources, "-ldl"], capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise NoLibrary(f"{command[0]} cannot make the preload library: {done.stderr.strip()[-500:]}")
            made.replace(target)
    except OSError as error:
        raise NoLibrary(f"the preload library cannot be made in {target.parent}: {reason_of(error)}") from None


def _digest() -> str:
    """Return the digest of the sources, so that each version has a library of its own."""
    texts = [path.read_bytes() for path in sorted(SOURCES.glob("*.[ch]"))]
    return hashlib.sha256(b"".join([platform.machine().encode(), *texts])).hexdigest()[:16]
