"""A build hook that adds to a wheel the pages without their pictures, and the preload library of ``tactemu exec``.

With the library a wheel is of one kind of machine, which ``TACTEMU_WHEEL=x86_64`` or ``aarch64`` selects; any machine
can make both, because the compiler is that of the package ``ziglang``, with the C library of manylinux2014. Without the
variable the wheel is for every machine and has no library: it is compiled on the user's machine, if that has a
compiler.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PICTURES = "pictures"
"""The folder of docs that no wheel contains."""
VARIABLE = "TACTEMU_WHEEL"
MACHINES = ("x86_64", "aarch64")
GLIBC = (2, 17)
"""The version of glibc in manylinux2014."""


class WheelFiles(BuildHookInterface):
    """A hook that adds the pages, compiles the library into the wheel, and sets the wheel's tag."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return the compiler's package, if the wheel has the library."""
        return ["ziglang>=0.13"] if _machine() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the pages, and compile the library, before the wheel is written."""
        docs = Path(self.root) / "docs"
        for path in docs.rglob("*"):
            inside = path.relative_to(docs)
            if path.is_file() and not {PICTURES, "__pycache__"} & set(inside.parts):
                build_data["force_include"][str(path)] = f"tactemu/docs/{inside}"
        machine = _machine()
        if not machine or version == "editable":
            return
        build = _build(Path(self.root) / "tactemu" / "exec" / "build.py")
        made = Path(self.root) / "build" / "preload" / machine / build.BUILT
        target = f"{machine}-linux-gnu.{'.'.join(map(str, GLIBC))}"
        build.compile_to(made, [sys.executable, "-m", "ziglang", "cc", "-target", target])
        build_data["force_include"][str(made)] = f"tactemu/exec/preload/{build.BUILT}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-manylinux_{'_'.join(map(str, GLIBC))}_{machine}"


def _machine() -> str:
    """Return the machine of the wheel, or ``""`` for every machine."""
    named = os.environ.get(VARIABLE, "")
    if named and named not in MACHINES:
        raise ValueError(f"{VARIABLE}={named}: expected {' or '.join(MACHINES)}, or nothing")
    return named


def _build(path: Path) -> ModuleType:
    """Return the module that compiles the library; it needs nothing of the package, which is not installed."""
    spec = importlib.util.spec_from_file_location("preload_build", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
