"""Signals for a program that runs in front of us: it gets them, we do not."""

from __future__ import annotations

import _thread
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_TAKEN = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2)
_LOOK_S = 0.05
_FROM_THE_KERNEL = 0x80
"""Origin of a signal that a terminal sends: to all who run on it, the program too."""


class Forwarding:
    """Where signals go: to ``program`` once there is one; before that they end the start, as Ctrl-C does."""

    def __init__(self):
        self.program: subprocess.Popen[bytes] | None = None
        self._end = threading.Event()

    def run(self) -> None:
        """Take signals until :meth:`stop`."""
        while not self._end.is_set():
            got = signal.sigtimedwait(_TAKEN, _LOOK_S)
            if got is None:
                continue
            if self.program is None:
                _thread.interrupt_main()
            elif got.si_code != _FROM_THE_KERNEL:
                self.program.send_signal(got.si_signo)

    def stop(self) -> None:
        """Take no more."""
        self._end.set()


@contextmanager
def forwarded_signals() -> Iterator[Forwarding]:
    """Signals are taken by a thread of their own. Before anything that makes threads is imported: NumPy does."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _TAKEN)
    forwarding = Forwarding()
    thread = threading.Thread(target=forwarding.run, name="signals", daemon=True)
    thread.start()
    try:
        yield forwarding
    finally:
        forwarding.stop()
        thread.join()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
