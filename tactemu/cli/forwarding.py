"""Signals for a program that runs in front of us: it gets them, we do not."""

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
_LOOK_S = 0.05
_FROM_THE_KERNEL = 0x80
"""Origin of a signal that a terminal sends: to all who run on it, the program too."""


FORWARDING: list[Forwarding] = []
"""The forwarding of this program's signals, if it does that."""


class Forwarding:
    """Where signals go: to ``program`` once there is one; before that they end the start."""

    def __init__(self):
        self.program: subprocess.Popen[bytes] | None = None
        self._sent: dict[int, str] = {}
        """Who sent the signals that the program was given."""
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._ignored = {number for number in _TAKEN if handler_before(number) is signal.SIG_IGN}
        """Those that whoever started us wants ignored, as ``nohup`` does; the program ignores them too."""

    def start(self, program: Callable[[], subprocess.Popen[bytes]]) -> subprocess.Popen[bytes]:
        """Start the program. A signal comes before it, and there will be none, or goes to it."""
        with self._lock:
            if not any(start.number for start in STARTING):
                for start in STARTING:
                    start.over()
                self.program = program()
                return self.program
        while True:  # until the exception comes that the signal has raised in this thread
            time.sleep(_LOOK_S)

    def run(self) -> None:
        """Take signals until :meth:`stop`.

        Not by ``sigtimedwait``: interrupted when its time is over, Python's gives a signal that never came, with what
        was in memory for its number and its sender.
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
                        start.came(got.si_signo, origin)

    def stop(self, thread: threading.Thread) -> None:
        """Take no more in the thread that runs this."""
        self._end.set()
        assert thread.ident is not None
        signal.pthread_kill(thread.ident, signal.SIGUSR2)  # wakes it
        thread.join()

    def say_what_ended(self, status: int) -> None:
        """Tell a user of the signal that was passed on to a program and that it died of."""
        if origin := self._sent.get(-status):
            sys.stderr.write(f"tactemu: {signal.Signals(-status).name}{origin} has ended the program\n")

    def _is_ignored(self, number: int, from_kernel: bool) -> bool:
        """Whether a signal is nothing to us. Shells have what runs behind ignore Ctrl-C; `kill -INT` is meant."""
        return number in self._ignored and (from_kernel or number not in ENDING)


@contextmanager
def forwarded_signals() -> Iterator[Forwarding]:
    """Take signals in a thread of their own, which sees who sent them.

    Enter it before anything that makes threads is imported: NumPy does.
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
