"""The socket, the token and the process of a page; without imports of viser, which a run would have to wait for."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import secrets
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass

from tactemu.base.errors import TactemuError

LOOPBACK = "127.0.0.1"
_USUAL_PORT = 8080
_END_S = 2.0
"""The time for which a run that has ended waits for the page's process; then it is killed."""


@dataclass(frozen=True)
class PageListener:
    """The socket and the token of a page.

    Raises:
        TactemuError: viser is missing, the port is taken, or the host is none of this machine's.
    """

    listener: socket.socket
    token: str

    @property
    def url(self) -> str:
        """The link that a browser opens."""
        host, port = self.listener.getsockname()[:2]
        host = socket.gethostname() if host in ("0.0.0.0", "::") else host
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/{self.token}/"

    @property
    def hosts(self) -> list[str]:
        """The host names that a request may name, beside the address itself."""
        host = self.listener.getsockname()[0]
        return ["localhost"] if host in (LOOPBACK, "::1") else ["localhost", socket.gethostname().lower()]


def open_listener(host: str | None = None, port: int | None = None) -> PageListener:
    """Open the socket of a page, and return it with a fresh token; warn the user if other machines can reach it.

    Args:
        host: the address; default: loopback, which only this machine reaches.
        port: default: 8080, or any free port if 8080 is taken.

    Raises:
        TactemuError: viser is missing, the port is taken, or the host is none of this machine's.
    """
    if importlib.util.find_spec("viser") is None:
        raise TactemuError('the page needs the package viser: pip install "tactemu[web]"')
    opened = PageListener(_has_listener(host or LOOPBACK, port), secrets.token_urlsafe(16))
    if text := warning(host):
        sys.stderr.write(f"tactemu: {text}\n")
    return opened


def warning(host: str | None) -> str | None:
    """Return the warning for a page that other machines can reach, or None."""
    if host in (None, LOOPBACK, "::1", "localhost"):
        return None
    return (
        f"anyone who reaches {host} and has the link can watch, press and break; the connection is not encrypted. "
        f"Safer: ssh -L {_USUAL_PORT}:{LOOPBACK}:{_USUAL_PORT} to this machine"
    )


def _has_listener(host: str, port: int | None) -> socket.socket:
    if port is None:
        with contextlib.suppress(TactemuError):
            return _bound(host, _USUAL_PORT)
    return _bound(host, port or 0)


def _bound(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(64)
    except (OSError, OverflowError) as error:
        listener.close()
        why = getattr(error, "strerror", None) or "there is no such port"
        raise TactemuError(
            f"the page cannot listen on {host}, port {port}: {why}; name another port, or none"
        ) from None
    return listener


@contextlib.contextmanager
def page_process(opened: PageListener, name: str) -> Iterator[threading.Event]:
    """Run a process that shows the run ``name``; a pipe carries the token, because other users can read command lines.

    Set the yielded event before the run ends: a page that ends without it is reported to the user.
    """
    number = opened.listener.fileno()
    command = [sys.executable, "-m", "tactemu.cli.page", str(number), name]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, pass_fds=[number], start_new_session=True
    )
    assert process.stdin is not None
    over = threading.Event()

    def watch() -> None:
        process.wait()
        if not over.is_set():
            sys.stderr.write(f"tactemu: the page has ended; `tactemu see {name}` opens it again\n")
            sys.stderr.flush()

    try:
        with contextlib.suppress(OSError):
            process.stdin.write(opened.token.encode())
            process.stdin.close()
        opened.listener.close()
        threading.Thread(target=watch, name="page", daemon=True).start()
        yield over
    finally:
        over.set()
        try:
            process.wait(_END_S)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            process.kill()
            process.wait()


def inherited_listener(number: int, token: str) -> PageListener:
    """Return the listener that the parent process has opened, by its file descriptor."""
    os.set_inheritable(number, False)
    return PageListener(socket.socket(fileno=number), token)
