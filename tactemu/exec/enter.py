"""Into the view, and on as the driver: joins the keeper's namespaces and becomes the command.

Exit status 125: the view is not there; 126: the command cannot be executed; 127: there is none of that name.
"""

from __future__ import annotations

import os
import signal
import sys

from tactemu.exec import system

PRELOAD = "/run/udev/.tactemu/preload.so"
"""In the view: a path without spaces that everybody may read."""
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


def _end(status: int, text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
    os._exit(status)
