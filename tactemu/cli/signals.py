"""Signal handling: SIGINT and SIGTERM end a running loop in order; during the start they end the program at once."""

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
"""The signals that end a program, or its loop."""

_NOTICED_S = 0.5
"""Time in which the main thread notices a signal, unless it is in native code, which compiles kernels for minutes."""
_UNWOUND_S = 2.5
"""Time in which a start cleans up, unless a library has lost the exception of the signal."""


class Starting:
    """The start of a program, from its first import until its loop runs; SIGINT and SIGTERM end it at any moment.

    Python calls a signal's handler between two of its own instructions, and an exception raised there can be lost in a
    library's callback. Therefore a thread receives the signal, too, and ends the process if the handler had no effect.
    """

    def __init__(self):
        self.number = 0
        """The signal received, or 0."""
        self.origin = ""
        """The sender of the signal, if known."""
        self._noticed, self._over = threading.Event(), threading.Event()
        self._told = -1
        """The end of a pipe into which the interpreter writes each signal immediately."""
        self.before: dict[int, Any] = {}
        """The former handlers."""

    def begin(self) -> None:
        """Install the handlers. Call it in the main thread."""
        told, self._told = os.pipe()
        os.set_blocking(self._told, False)
        signal.set_wakeup_fd(self._told, warn_on_full_buffer=False)
        self.before = {number: signal.signal(number, self._notice) for number in ENDING}
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # the thread must receive none
        threading.Thread(target=self._watch, args=(told, os.getpid()), name="start", daemon=True).start()
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def receive(self, number: int, origin: str) -> None:
        """End the start because of a signal that another thread has received."""
        self.number, self.origin = self.number or number, self.origin or origin
        _thread.interrupt_main()

    def finish(self) -> bool:
        """Stop handling signals because a loop begins, and return True if one came, which ends that loop at once."""
        if not self._over.is_set():
            self._over.set()
            signal.set_wakeup_fd(-1)
            os.close(self._told)
        return bool(self.number)

    @property
    def is_over(self) -> bool:
        """True if a loop has begun."""
        return self._over.is_set()

    def end(self) -> None:
        """Restore the former handlers when the program has ended, or failed to start."""
        self.finish()
        for number, handler in self.before.items():
            signal.signal(number, handler)

    def message(self) -> str:
        """Return the line that names the signal that ended the start."""
        return f"tactemu: ended by {signal.Signals(self.number).name}{self.origin} before it had started\n"

    def _notice(self, number: int, _frame: object) -> None:
        if self.is_over:  # the loop has ended and the program is ending: the next signal ends it at once
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
                sys.stderr.write(self.message())
                sys.stderr.flush()
                os._exit(128 + self.number)


STARTING: list[Starting] = []
"""The present start, if any."""


def handler_before(number: int) -> Any:
    """Return the handler that a signal had when this program was started."""
    return STARTING[0].before.get(number) if STARTING and number in ENDING else signal.getsignal(number)


@contextmanager
def starting() -> Iterator[Starting]:
    """Let SIGINT and SIGTERM end the context until a loop handles them (:func:`ended_by_signals`).

    A program that they end prints a line, and exits with 128 + n after signal n.
    """
    start = Starting()
    STARTING.append(start)
    start.begin()
    try:
        yield start
    except (KeyboardInterrupt, SystemExit):
        if not start.number or start.is_over:
            raise
        sys.stderr.write(start.message())
        exec("")  # Python would end by SIGINT, since an interrupt has left an `exec` of some library; it forgets that
        sys.exit(128 + start.number)
    finally:
        start.end()
        STARTING.remove(start)


@contextmanager
def ended_by_signals(stop: Callable[[], None] | None = None) -> Iterator[Callable[[], bool]]:
    """Call ``stop`` at the first signal and end the process at the second; yield a callable that tells if one came.

    SIGHUP, which a closing terminal sends, is one of them, unless it was ignored at the start, as by ``nohup``.
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
        if STARTING and STARTING[-1].finish():
            note(STARTING[-1].number, None)
        yield lambda: bool(seen)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupt() -> None:
    """Interrupt the main thread, as Ctrl-C does."""
    raise KeyboardInterrupt
