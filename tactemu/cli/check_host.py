"""``tactemu check-host``: tests of what this machine can do, with the command that helps if one fails."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence

from tactemu.base.errors import TactemuError, no_such
from tactemu.cli.finding import Finding, tell
from tactemu.cli.host_timing import TIMING_CHECKS

NEEDED = ("ports", "view", "preload", "can", "loop")
"""The checks that decide the exit status if the user names none."""


def check_host(wanted: Sequence[str], *, json: bool = False) -> bool:
    """Run all checks, print their results, and return True if all wanted ones pass.

    Raises:
        TactemuError: there is no check of a name.
    """
    if unknown := [name for name in wanted if name not in CHECKS]:
        raise TactemuError(f"check-host has {no_such('check', unknown[0], CHECKS)}")
    found = tell(_findings(), json=json)
    return all(each.there for each in found if each.name in (wanted or NEEDED))


def _findings() -> Iterator[Finding]:
    for name, check in CHECKS.items():
        try:
            yield check(name)
        except (OSError, TactemuError) as error:
            yield Finding(name, False, str(error))


def _python(name: str) -> Finding:
    libc = " ".join(platform.libc_ver()) or "another libc than glibc"
    says = f"Python {platform.python_version()} for {platform.machine()}, {libc}, Linux {platform.release()}"
    return Finding(name, sys.version_info >= (3, 11) and sys.platform == "linux", says)


def _ports(name: str) -> Finding:
    ours, theirs = os.openpty()
    path = os.ttyname(theirs)
    for each in (ours, theirs):
        os.close(each)
    return Finding(name, True, f"pseudo terminals, such as {path}")


@contextlib.contextmanager
def _keeper() -> Iterator[Callable[..., object]]:
    from tactemu.exec.keeping import Keeper

    keeper = Keeper("")
    try:
        keeper.wait()
        yield keeper.ask
    finally:
        keeper.close()


def _view(name: str) -> Finding:
    with _keeper():
        return Finding(name, True, "`tactemu exec` shows drivers /dev/ttyUSB0, sysfs and udev's data")


def _preload(name: str) -> Finding:
    from tactemu.exec.build import NoLibrary, library

    try:
        return Finding(name, True, f"the preload library: {library()}")
    except NoLibrary as error:
        return Finding(name, False, str(error), "sudo apt-get install --no-install-recommends gcc libc6-dev")


def _vcan(name: str) -> Finding:
    try:
        with _keeper() as ask:
            ask("bus", name="can0", way="native")
    except TactemuError as error:
        return Finding(name, False, str(error), "sudo modprobe vcan   (Ubuntu: linux-modules-extra-$(uname -r))")
    return Finding(name, True, "this kernel has CAN and vcan")


def _can(name: str) -> Finding:
    if _vcan(name).there:
        return Finding(name, True, "`tactemu exec` gives drivers can0, by vcan")
    with _keeper() as ask:
        ask("bus", name="can0", way="preload")
    if not (library := _preload(name)).there:
        return Finding(name, False, library.says, library.helps)
    return Finding(name, True, "`tactemu exec` gives drivers can0, by the preload library over Ethernet")


def _guest(name: str) -> Finding:
    if found := shutil.which("linux.uml"):
        return Finding(name, True, f"a kernel with CAN as a program, for scripts/vcan-run: {found}")
    helps = "sudo apt-get install --no-install-recommends user-mode-linux kmod iproute2 can-utils"
    return Finding(name, False, "no kernel with CAN as a program (User-Mode Linux)", helps)


def _gpu(name: str) -> Finding:
    try:
        cuda = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return Finding(name, False, "no CUDA driver; kernels run on the CPU")
    count, title = ctypes.c_int(), ctypes.create_string_buffer(128)
    if cuda.cuInit(0) or cuda.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return Finding(name, False, "a CUDA driver without a GPU; kernels run on the CPU")
    cuda.cuDeviceGetName(title, len(title), 0)
    return Finding(name, True, f"{title.value.decode()}; give --device cuda:0")


def _kernels(name: str) -> Finding:
    from tactemu.base.cpu_code import prebuilt_versions, why_compiled
    from tactemu.base.kernels import start_warp

    start_warp()
    if why := why_compiled():
        helps = "".join(f"pip install warp-lang=={version}" for version in prebuilt_versions()[-1:])
        return Finding(name, False, f"the first start of each device compiles kernels, for seconds: {why}", helps)
    return Finding(name, True, "no device compiles kernels for its default scene: they were compiled ahead")


CHECKS: dict[str, Callable[[str], Finding]] = {
    "python": _python, "ports": _ports, "view": _view, "preload": _preload, "vcan": _vcan, "can": _can,
    "guest": _guest, "gpu": _gpu, "kernels": _kernels, **TIMING_CHECKS,
}  # fmt: skip
