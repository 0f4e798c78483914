"""Forwarding of signals to the program that this process runs."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tactemu.cli.signals import ENDING, STARTING, handler_before

if TYPE_CHECKING:
    import subprocess

_TAKEN = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2)
_POLL_S = 0.05
_FROM_THE_KERNEL = 0x80
"""The code of a signal from a terminal, which sends it to all its processes, the program included."""


FORWARDING: list[Forwarding] = []
"""The active forwarding of this process, if any."""


class Forwarding:
    """The forwarding of signals to ``program`` once it runs; before that, signals end the start."""

    def __init__(self):
        self.program: subprocess.Popen[bytes] | None = None
        self._sent: dict[int, str] = {}
        """The origin of each signal that was forwarded."""
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._ignored = {number for number in _TAKEN if handler_before(number) is signal.SIG_IGN}
        """The signals that were ignored when this process started, as by ``nohup``; the program ignores them, too."""

    def start(self, program: Callable[[], subprocess.Popen[bytes]]) -> subprocess.Popen[bytes]:
        """Start the program, unless a signal has come before; later signals go to it."""
        with self._lock:
            if not any(start.number for start in STARTING):
                for start in STARTING:
                    start.finish()
                self.program = program()
                return self.program
        while True:  # wait for the exception that the signal raises in this thread
            time.sleep(_POLL_S)

    def run(self) -> None:
        """Forward signals until :meth:`stop`.

        It does not use ``sigtimedwait``: interrupted at its timeout, Python's version returns a signal that never came,
        with random memory as its number and its sender.
        """
        while True:
            got = signal.sigwaitinfo(_TAKEN)
            if self._end.is_set():
                return
            from_kernel = got.si_code == _FROM_THE_KERNEL
            origin = " from the terminal" if from_kernel else f" from process {got.si_pid}"
            with self._lock:
                if self.program is not None and not from_kernel:
                    self._sent[got.si_signo] = origin
                    self.program.send_signal(got.si_signo)
                elif self.program is None and not self._is_ignored(got.si_signo, from_kernel):
                    for start in STARTING:
                        start.receive(got.si_signo, origin)

    def stop(self, thread: threading.Thread) -> None:
        """End :meth:`run` in its thread."""
        self._end.set()
        assert thread.ident is not None
        signal.pthread_kill(thread.ident, signal.SIGUSR2)  # wakes it
        thread.join()

    def say_what_ended(self, status: int) -> None:
        """Print which forwarded signal has ended the program, if one has."""
        if origin := self._sent.get(-status):
            sys.stderr.write(f"tactemu: {signal.Signals(-status).name}{origin} has ended the program\n")

    def _is_ignored(self, number: int, from_kernel: bool) -> bool:
        """Return True for a signal that was ignored at the start.

        Shells make background processes ignore Ctrl-C; but a ``kill -INT`` is intended, and counts.
        """
        return number in self._ignored and (from_kernel or number not in ENDING)


@contextmanager
def forwarded_signals() -> Iterator[Forwarding]:
    """Forward signals in a thread of their own, which sees the sender of each.

    Enter it before you import a module that starts threads, such as NumPy.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _TAKEN)
    forwarding = Forwarding()
    FORWARDING.append(forwarding)
    thread = threading.Thread(target=forwarding.run, name="signals", daemon=True)
    thread.start()
    try:
        yield forwarding
    finally:
        forwarding.stop(thread)
        FORWARDING.remove(forwarding)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
