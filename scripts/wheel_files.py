"""A build hook that adds to a wheel the pages without their pictures, the preload library of ``tactemu exec``, and
kernels compiled ahead of time.

With the library a wheel is of one kind of machine, which ``TACTEMU_WHEEL=x86_64`` or ``aarch64`` selects; any machine
can make both, because the compiler is that of the package ``ziglang``, with the C library of manylinux2014. Without the
variable the wheel is for every machine and has no library: it is compiled on the user's machine, if that has a
compiler. The kernels are in the wheel for x86_64 if such a machine makes it, and are for the version of Warp in
``requirements.lock``.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import subprocess
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
        """Return the compiler's package, if the wheel has the library, and what compiles kernels, if it has those."""
        return [*(["ziglang>=0.13"] if _machine() else []), *(self._needed_by_kernels() if _has_kernels() else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the pages, and compile library and kernels, before the wheel is written."""
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
        if _has_kernels():
            self._add_kernels(build_data)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-manylinux_{'_'.join(map(str, GLIBC))}_{machine}"

    def _needed_by_kernels(self) -> list[str]:
        locked = re.search(r"(?m)^warp-lang==[^ ]+", (Path(self.root) / "requirements.lock").read_text())
        assert locked is not None
        return [*self.metadata.core.dependencies, locked[0]]

    def _add_kernels(self, build_data: dict[str, Any]) -> None:
        made = Path(self.root) / "build" / "prebuilt"
        shutil.rmtree(made, ignore_errors=True)
        subprocess.run([sys.executable, Path(self.root) / "scripts" / "prebuild_kernels.py", made], check=True)
        for path in made.rglob("*.*"):
            if path.is_file():
                build_data["force_include"][str(path)] = f"tactemu/prebuilt/{path.relative_to(made)}"


def _has_kernels() -> bool:
    """Return True if the wheel gets kernels: only a machine of its kind can compile them."""
    return _machine() == platform.machine() == "x86_64"


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
