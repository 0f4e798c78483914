"""Threads that share the environments of a batch on a CPU.

Warp runs a CPU kernel on the thread that launches it and releases the interpreter's lock meanwhile. The shares of a
step therefore run in parallel: the caller takes the first, one thread each of the others, and the caller waits for all.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Sequence
from queue import SimpleQueue

from tactemu.plan.launches import Launch


def cores() -> int:
    """Return the number of cores that this process may run on."""
    return len(os.sched_getaffinity(0))


class _Job:
    """A share of a step."""

    def __init__(self, launches: Sequence[Launch]):
        self.launches = launches
        self.error: BaseException | None = None
        self._done = threading.Lock()
        self._done.acquire()

    def run(self) -> None:
        """Run the launches on the calling thread, and keep an error for the waiting thread."""
        try:
            for launch in self.launches:
                launch()
        except BaseException as error:  # raised by the thread that waits
            self.error = error
        self._done.release()

    def wait(self) -> None:
        """Block until the job has run."""
        self._done.acquire()


def _work(jobs: SimpleQueue[_Job | None]) -> None:
    while (job := jobs.get()) is not None:
        job.run()
        del job  # a waiting thread must not keep alive what it launched last


def _stop(queues: list[SimpleQueue[_Job | None]], threads: list[threading.Thread], process: int) -> None:
    if os.getpid() == process:  # a fork has no threads but its own
        for queue in queues:
            queue.put(None)
        for thread in threads:
            thread.join()


class ThreadPool:
    """A pool of ``size`` threads, including the caller's. The others start when first needed and end with the pool."""

    def __init__(self, size: int):
        self.size = size
        self._queues: list[SimpleQueue[_Job | None]] = []
        self._process = 0
        self._end: weakref.finalize | None = None

    @property
    def is_running(self) -> bool:
        """Have the other threads been started in this process?"""
        return bool(self._queues) and self._process == os.getpid()

    def run(self, shares: Sequence[Sequence[Launch]]) -> None:
        """Run ``size`` shares in parallel, and wait for all of them."""
        if self._process != os.getpid():
            self._begin()
        jobs = [_Job(share) for share in shares[1:]]
        try:
            for queue, job in zip(self._queues, jobs):
                queue.put(job)
            for launch in shares[0]:
                launch()
            for job in jobs:
                job.wait()
        except BaseException:
            self._finish()
            raise
        for job in jobs:
            if job.error is not None:
                raise job.error

    def _finish(self) -> None:
        """Wait for all jobs that were started, even if Ctrl-C interrupts: they write into arrays that others may
        read."""
        last = [_Job(()) for _ in self._queues]
        for queue, job in zip(self._queues, last):
            queue.put(job)
        for job in last:
            while True:
                try:
                    job.wait()
                    break
                except KeyboardInterrupt:
                    continue

    def _begin(self) -> None:
        if self._end is not None:  # the threads of the parent process
            self._end.detach()
        self._process = os.getpid()
        self._queues = [SimpleQueue() for _ in range(1, self.size)]
        threads = [
            threading.Thread(target=_work, args=(queue,), name=f"tactemu share {k}", daemon=True)
            for k, queue in enumerate(self._queues, 1)
        ]
        self._end = weakref.finalize(self, _stop, self._queues, threads, self._process)
        for thread in threads:
            thread.start()

    def close(self) -> None:
        """End the threads; :meth:`run` starts them again."""
        if self._end is not None:
            self._end()
        self._queues, self._process, self._end = [], 0, None
