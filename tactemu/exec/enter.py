"""Into the view, and on as the driver: joins the keeper's namespaces and becomes the command.

Exit status 125: the view is not there; 126: the command cannot be executed; 127: there is none of that name.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

from tactemu.exec import system

PRELOAD = "/dev/.tactemu/preload.so"
"""In the view: a path without spaces that everybody may read."""
CAN = "/dev/.tactemu/can"
"""There where CAN is by the preload library."""
FAILED, NOT_EXECUTABLE, NOT_FOUND = 125, 126, 127


def main(keeper: int, command: list[str]) -> None:
    """Become ``command`` in the namespaces of the process ``keeper``."""
    folder = os.getcwd()
    try:
        for kind, flag in (("user", system.CLONE_NEWUSER), ("mnt", system.CLONE_NEWNS), ("net", system.CLONE_NEWNET)):
            if os.stat(f"/proc/{keeper}/ns/{kind}").st_ino != os.stat(f"/proc/self/ns/{kind}").st_ino:
                joined = os.open(f"/proc/{keeper}/ns/{kind}", os.O_RDONLY)
                system.setns(joined, flag)
                os.close(joined)
        os.chdir(folder)
    except OSError as error:
        _end(FAILED, f"tactemu: cannot enter the view: {error}")
    if os.path.exists(CAN) and os.getuid():
        _keep_packet_sockets()
    if os.path.exists(PRELOAD):
        others = os.environ.get("LD_PRELOAD")
        os.environ["LD_PRELOAD"] = f"{PRELOAD}:{others}" if others else PRELOAD
    os.environ["SYSTEMD_DEVICE_VERIFY_SYSFS"] = "0"  # else libudev refuses folders that are not the kernel's own
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # which Python ignores, and a program would go on ignoring
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    try:
        os.execvp(command[0], command)
    except (FileNotFoundError, NotADirectoryError):
        _end(NOT_FOUND, f"tactemu: {command[0]}: not found")
    except OSError as error:
        _end(NOT_EXECUTABLE, f"tactemu: {command[0]}: {error.strerror}")


def _keep_packet_sockets() -> None:
    """CAN without the kernel's takes packet sockets, for which who is not root needs a capability in the view."""
    libc, raw = ctypes.CDLL(None, use_errno=True), 13  # CAP_NET_RAW
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    libc.capget(header, sets)
    sets[2] |= 1 << raw  # inheritable, which it must be to be ambient
    if libc.capset(header, sets) or libc.prctl(47, 2, raw, 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), "CAP_NET_RAW")


def _end(status: int, text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
    os._exit(status)
