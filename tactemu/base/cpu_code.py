"""The machine code of kernels on a CPU: the compiler's flags, and kernels that were compiled ahead of time.

On an x86-64 processor of the level v3, which has AVX2 and FMA, kernels are compiled for this level, whatever else the
processor has: one set of objects then serves all of them, with the same bytes. ``scripts/prebuild_kernels.py`` makes
the set for the default scene of every device; the wheel for x86_64 contains it. It is a Warp kernel cache, from which
:func:`fill_cache` copies what the user's own cache lacks. Warp names each object after everything that it is compiled
from, so that one that is out of date is never used.
"""

from __future__ import annotations

import functools
import os
import platform
import shutil
from pathlib import Path

PREBUILT = Path(__file__).parents[1] / "prebuilt"
"""The folder of kernels compiled ahead of time: a folder for each version of Warp and of its compiler."""
LEVEL = "x86-64-v3"
"""The level of x86-64 processors for which kernels are compiled."""
_FEATURES = frozenset(b"abm avx avx2 bmi1 bmi2 cx16 f16c fma lahf_lm movbe popcnt sse4_1 sse4_2 ssse3 xsave".split())
"""The features of this level, as Linux names them."""
_NATIVE = "-march=native"


@functools.cache
def compiler_flags() -> str | None:
    """Return the flags with which Warp compiles our kernels for a CPU; ``None``: Warp's own.

    They are Warp's own on other processors, and in a program that has chosen other flags for all of Warp.
    """
    import warp

    flags = warp.config.cpu_compiler_flags or ""
    if _NATIVE not in flags.split() or not _has_level():
        return None
    return flags.replace(_NATIVE, f"-target-cpu {LEVEL}")


def _has_level() -> bool:
    if platform.machine() != "x86_64":
        return False
    try:
        with open("/proc/cpuinfo", "rb", buffering=0) as file:
            first = file.read(8192)  # no more than the first processors, since each costs time
    except OSError:
        return False
    found = next((line for line in first.splitlines() if line.startswith(b"flags")), b"")
    return frozenset(found.split()) >= _FEATURES


def prebuilt_folder() -> Path:
    """Return the folder of the kernels compiled ahead of time for this version of Warp; it may be missing."""
    import warp

    return PREBUILT / warp.get_cpu_kernel_cache_key(cpu_compiler_flags=compiler_flags())


def prebuilt_versions() -> list[str]:
    """Return the versions of Warp for which there are kernels compiled ahead of time."""
    return sorted(folder.name.partition("-")[0] for folder in PREBUILT.glob("*-*"))


def why_compiled() -> str:
    """Return the reason why even the default scenes compile their kernels on first use; empty if they do not."""
    import warp

    if compiler_flags() is None:
        return f"this processor is not of the level {LEVEL}"
    if prebuilt_folder().is_dir():
        return ""
    if versions := prebuilt_versions():
        return f"they were compiled ahead for Warp {', '.join(versions)}, and Warp {warp.config.version} is installed"
    return "this installation has none that were compiled ahead; the wheel for x86_64 does"


@functools.cache
def fill_cache(cache: str) -> None:
    """Copy the kernels compiled ahead of time that a kernel cache lacks into it.

    Args:
        cache: the folder, as in ``warp.config.kernel_cache_dir``. If it cannot be written, kernels are compiled.
    """
    if compiler_flags() is None:
        return
    try:
        for module in os.scandir(prebuilt_folder()):
            for name in os.listdir(module):
                _copy(os.path.join(module, name), os.path.join(cache, module.name, name))
    except OSError:
        return


def _copy(source: str, target: str) -> None:
    """Copy a file in one step, unless it is there."""
    if os.path.exists(target):
        return
    os.makedirs(os.path.dirname(target), exist_ok=True)
    part = f"{target}.{os.getpid()}"
    shutil.copyfile(source, part)
    os.replace(part, target)
