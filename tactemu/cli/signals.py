"""Ctrl-C and SIGTERM end a loop, not the program. While a program starts they end it, whatever it is busy with."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tactemu.base.files import remove_leftovers

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a program, or its loop."""

_NOTICED_S = 0.5
"""A main thread that has not noticed a signal by then [s] is in native code, where kernels are compiled for minutes."""
_UNWOUND_S = 2.5
"""Time for a start to take back what it has made [s], unless a library has lost the exception of the signal."""


class Starting:
    """A program's start, from its first import until its loop runs, which SIGINT and SIGTERM end at any moment.

    Python calls a signal's handler between two of its own instructions, and an exception that is raised there can be
    lost in a library's callback. So a thread is told of the signal too, and ends the process when nothing came of it.
    """

    def __init__(self):
        self.number = 0
        """The signal that came; 0 before one does."""
        self.origin = ""
        """Who sent it, where that is known."""
        self._noticed, self._over = threading.Event(), threading.Event()
        self._told = -1
        """The end of a pipe into which the interpreter writes each signal at once."""
        self.before: dict[int, Any] = {}
        """The handlers that there were."""

    def begin(self) -> None:
        """Take signals from now on. Call in the main thread."""
        told, self._told = os.pipe()
        os.set_blocking(self._told, False)
        signal.set_wakeup_fd(self._told, warn_on_full_buffer=False)
        self.before = {number: signal.signal(number, self._notice) for number in ENDING}
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # none is for the thread
        threading.Thread(target=self._watch, args=(told, os.getpid()), name="start", daemon=True).start()
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def came(self, number: int, origin: str) -> None:
        """End the start because of a signal that another thread has taken."""
        self.number, self.origin = self.number or number, self.origin or origin
        _thread.interrupt_main()

    def over(self) -> bool:
        """Leave signals to others: a loop is about to run. Returns whether one came, which ends that loop at once."""
        if not self._over.is_set():
            self._over.set()
            signal.set_wakeup_fd(-1)
            os.close(self._told)
        return bool(self.number)

    @property
    def is_over(self) -> bool:
        """Whether a loop has begun."""
        return self._over.is_set()

    def end(self) -> None:
        """The program has ended, or failed to start: put the former handlers back."""
        self.over()
        for number, handler in self.before.items():
            signal.signal(number, handler)

    def said(self) -> str:
        """Return the line that tells a user why nothing runs."""
        return f"tactemu: ended by {signal.Signals(self.number).name}{self.origin} before it had started\n"

    def _notice(self, number: int, _frame: object) -> None:
        if self.is_over:  # a loop has run, and the program is ending: the next signal ends it at once
            signal.signal(number, signal.SIG_DFL)
            return
        self.number = self.number or number
        if not self._noticed.is_set():
            self._noticed.set()
            raise KeyboardInterrupt

    def _watch(self, told: int, process: int) -> None:
        with os.fdopen(told, "rb", buffering=0) as pipe:
            while numbers := pipe.read(1):
                if os.getpid() != process or numbers[0] not in ENDING:
                    continue
                self.number = self.number or numbers[0]
                if self._over.wait(_NOTICED_S) or (self._noticed.is_set() and self._over.wait(_UNWOUND_S)):
                    return
                remove_leftovers()
                sys.stderr.write(self.said())
                sys.stderr.flush()
                os._exit(128 + self.number)


STARTING: list[Starting] = []
"""The start that is going on, if any."""


def handler_before(number: int) -> Any:
    """Return the handler that a signal had when this program was started."""
    return STARTING[0].before.get(number) if STARTING and number in ENDING else signal.getsignal(number)


@contextmanager
def starting() -> Iterator[Starting]:
    """Let SIGINT and SIGTERM end what runs inside, until a loop takes them (:func:`ended_by_signals`).

    A program that was ended so says so, and exits with 128 + n after signal n.
    """
    start = Starting()
    STARTING.append(start)
    start.begin()
    try:
        yield start
    except (KeyboardInterrupt, SystemExit):
        if not start.number or start.is_over:
            raise
        sys.stderr.write(start.said())
        exec("")  # Python would end by SIGINT, since an interrupt has left an `exec` of some library; it forgets that
        sys.exit(128 + start.number)
    finally:
        start.end()
        STARTING.remove(start)


@contextmanager
def ended_by_signals(stop: Callable[[], None] | None = None) -> Iterator[Callable[[], bool]]:
    """The first signal calls ``stop``, a second one ends the process; gives a function that says whether one came.

    SIGHUP, of a terminal that closes, is one of them, unless whoever started the program has it ignored, as ``nohup``.
    """
    seen: list[int] = []

    def note(number: int, _frame: object) -> None:
        seen.append(number)
        if stop is not None:
            stop()
        signal.signal(number, signal.SIG_DFL)

    taken = [*ENDING, *([] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP])]
    before = {number: signal.signal(number, note) for number in taken}
    try:
        if STARTING and STARTING[-1].over():
            note(STARTING[-1].number, None)
        yield lambda: bool(seen)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
