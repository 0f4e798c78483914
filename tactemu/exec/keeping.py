"""The emulator's side of the keeper: its start, requests to it, and the reasons why a view is impossible."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError, TransportUnavailable
from tactemu.exec import enter

_PYTHON = (sys.executable, "-I", "-S")
"""Python without site-packages, which the view's own processes do not need."""
_START = (
    "import sys; sys.path.insert(0, sys.argv[1]); from tactemu.exec.keeper import main\n"
    "main(int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])"
)
_ANSWER_TIMEOUT_S = 20.0
"""The timeout of an answer: longer than a busy machine needs for a few system calls."""
_MAX_MESSAGE_BYTES = 65_536
_FORBIDDEN = (errno.EPERM, errno.EACCES, errno.ENOSPC, errno.EUSERS)
"""The errors of a kernel that refuses namespaces, to every user or to this one."""


class Keeper:
    """A running keeper. It may be used from any thread.

    Args:
        preload: the path of the preload library; empty: there is none.

    Raises:
        TransportUnavailable: this system is not Linux.
    """

    def __init__(self, preload: str = ""):
        if not sys.platform.startswith("linux"):
            raise TransportUnavailable(
                f"a view of the machine needs Linux, this is {sys.platform}; use a port of `tactemu run` instead"
            )
        self._lock = threading.Lock()
        self._wire, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._wire.settimeout(_ANSWER_TIMEOUT_S)
        words = (str(theirs.fileno()), str(os.getpid()), preload)
        with theirs:
            self._process = subprocess.Popen(
                [*_PYTHON, "-c", _START, str(Path(__file__).parents[2]), *words],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True,
            )  # fmt: skip
        self.pid = self._process.pid
        self._ready = False

    def wait(self) -> None:
        """Wait until the view is complete; it is made in parallel with the emulator.

        Raises:
            TransportUnavailable: the kernel refuses it; the message names the remedy.
            TactemuError: the view cannot be made.
        """
        if self._ready:
            return
        answer, _ = self._receive()
        if "error" in answer:
            self.close()
            if answer["number"] in _FORBIDDEN:
                raise TransportUnavailable(_explained(answer["error"]))
            raise TactemuError(f"cannot make a view of the machine: {answer['error']}")
        self._ready = True

    def ask(self, do: str, **given: Any) -> tuple[dict[str, Any], list[int]]:
        """Send a request to the keeper, and return its answer and the descriptors beside it.

        Raises:
            TactemuError: the keeper fails, or has ended.
        """
        with self._lock:
            self.wait()
            try:
                self._wire.send(json.dumps({"do": do, **given}).encode())
            except OSError:
                raise TactemuError("the keeper of the view has ended; was it killed?") from None
            answer, descriptors = self._receive()
        if "error" in answer:
            raise TactemuError(f"the view: {answer['error']}")
        return answer, descriptors

    def _receive(self) -> tuple[dict[str, Any], list[int]]:
        try:
            data, descriptors, _, _ = socket.recv_fds(self._wire, _MAX_MESSAGE_BYTES, 4)
        except OSError:
            data, descriptors = b"", []
        if not data:
            raise TactemuError("the keeper of the view has ended; was it killed?")
        return json.loads(data), descriptors

    def enter(self, command: list[str]) -> list[str]:
        """Return a command line that runs ``command`` in the view."""
        return [*_PYTHON, enter.__file__, str(self.pid), *command]

    def close(self) -> None:
        """Let the keeper unplug everything and end. Safe to call twice."""
        with contextlib.suppress(OSError):
            self._wire.shutdown(socket.SHUT_RDWR)  # forked children of this process have it open, too
        self._wire.close()
        self._process.wait()


def _explained(what: str) -> str:
    """Return why this machine allows no view, with the command that allows it."""
    for name, forbids, allows, who in _SWITCHES:
        if _read(f"/proc/sys/{name}") == forbids:
            setting = f"{name.replace('/', '.')}={allows}"
            return (
                f"cannot make a view of the machine: {who} forbids user namespaces here ({what}). Allow them with "
                f"`sudo sysctl -w {setting}`, or run as root: `sudo -E env PATH=$PATH tactemu exec ...`"
            )
    if any(map(os.path.exists, ("/.dockerenv", "/run/.containerenv"))):
        return (
            f"cannot make a view of the machine: this container bars it ({what}). Start it with `--cap-add SYS_ADMIN "
            "--security-opt seccomp=unconfined --security-opt apparmor=unconfined`"
        )
    return (
        f"cannot make a view of the machine: the kernel allows neither mounts nor user namespaces ({what}). Run as "
        "root: `sudo -E env PATH=$PATH tactemu exec ...`; in a container it needs the capability SYS_ADMIN"
    )


_SWITCHES = (
    # name in /proc/sys, the value that forbids, the value that allows, and its owner
    ("kernel/apparmor_restrict_unprivileged_userns", "1", "0", "AppArmor"),
    ("kernel/unprivileged_userns_clone", "0", "1", "the kernel's setting"),
    ("user/max_user_namespaces", "0", "15000", "the kernel's setting"),
)


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii").strip()
    except OSError:
        return ""
