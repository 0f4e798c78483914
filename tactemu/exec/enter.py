"""The entry into the view: a process that joins the keeper's namespaces and becomes the driver.

It runs as a script with the keeper's process id and the command. It imports nothing of tactemu and little else, because
the driver's start waits for it. Exit status 125: the view is missing; 126: the command cannot be executed; 127: there
is no command of that name.
"""

import ctypes
import os
import signal
import sys

PRELOAD = "/run/udev/.tactemu/preload.so"
"""The path of the preload library in the view: without spaces, and readable by every user."""
CAN = "/run/udev/.tactemu/can"
"""The file that exists if CAN buses need the preload library."""
FAILED, NOT_EXECUTABLE, NOT_FOUND = 125, 126, 127


def main(keeper: int, command: list[str]) -> None:
    """Become ``command`` in the namespaces of the process ``keeper``."""
    folder = os.getcwd()
    try:
        root = os.open(f"/proc/{keeper}/root", os.O_PATH)
        for kind in ("user", "mnt", "net"):
            _join(f"/proc/{keeper}/ns/{kind}", f"/proc/self/ns/{kind}")
        if not os.path.samestat(os.stat(root), os.stat("/")):  # the keeper runs in a chroot
            os.fchdir(root)
            os.chroot(".")
        os.close(root)
        os.chdir(folder)
    except OSError as error:
        _end(FAILED, f"tactemu: cannot enter the view: {error}")
    if os.path.exists(CAN) and os.getuid():
        _keep_packet_sockets()
    if os.path.exists(PRELOAD):
        others = os.environ.get("LD_PRELOAD")
        os.environ["LD_PRELOAD"] = f"{PRELOAD}:{others}" if others else PRELOAD
    os.environ["SYSTEMD_DEVICE_VERIFY_SYSFS"] = "0"  # else libudev refuses folders that are not in the kernel's sysfs
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # Python ignores them, and the program would inherit that
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    try:
        os.execvp(command[0], command)
    except (FileNotFoundError, NotADirectoryError):
        _end(NOT_FOUND, f"tactemu: {command[0]}: not found")
    except OSError as error:
        _end(NOT_EXECUTABLE, f"tactemu: {command[0]}: {error.strerror}")


def _keep_packet_sockets() -> None:
    """Keep the capability for packet sockets, which CAN by the preload library needs, for users other than root."""
    libc, raw = ctypes.CDLL(None, use_errno=True), 13  # CAP_NET_RAW
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    libc.capget(header, sets)
    sets[2] |= 1 << raw  # inheritable, as ambient capabilities must be
    if libc.capset(header, sets) or libc.prctl(47, 2, raw, 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), "CAP_NET_RAW")


def _join(theirs: str, ours: str) -> None:
    if os.stat(theirs).st_ino == os.stat(ours).st_ino:
        return
    namespace = os.open(theirs, os.O_RDONLY)
    if ctypes.CDLL(None, use_errno=True).setns(namespace, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), theirs)
    os.close(namespace)


def _end(status: int, text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
