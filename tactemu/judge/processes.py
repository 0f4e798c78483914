"""Processes of a driver: how they are found, their resource usage, and their end, also outside its session.

psutil lacks the wait for a processor, and takes 8 ms to find a process's descendants (0.4 ms here), beside the driver
that is measured.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Collection

MARK = "TACTEMU_JUDGE"
"""Environment variable whose value identifies a driver's processes, also those that left their session."""
_PAGE, _TICK = os.sysconf("SC_PAGE_SIZE"), os.sysconf("SC_CLK_TCK")


def marked(mark: str, old: Collection[int] = ()) -> list[int]:
    """Return the processes that carry the mark, without a look at the ``old`` ones."""
    found, text = [], f"{MARK}={mark}".encode()
    for name in os.listdir("/proc"):
        if not name.isdigit() or int(name) in old:
            continue
        try:
            with open(f"/proc/{name}/environ", "rb") as file:
                if text in file.read(1 << 17).split(b"\0"):
                    found.append(int(name))
        except OSError:  # it has ended, or belongs to another user
            continue
    return found


def family(pid: int) -> list[int]:
    """Return a process and its descendants, as far as they are still its children."""
    found = [pid]
    for each in found:
        with contextlib.suppress(OSError, ValueError):
            for task in os.listdir(f"/proc/{each}/task"):
                with open(f"/proc/{each}/task/{task}/children") as file:
                    found += [int(child) for child in file.read().split()]
    return found


def resource_usage(pid: int) -> tuple[int, float]:
    """Return resident memory [byte] and processor time [s] of a process and its descendants."""
    size, cpu = 0, 0.0
    for each in family(pid):
        with contextlib.suppress(OSError, IndexError, ValueError):
            with open(f"/proc/{each}/statm") as file:
                size += int(file.read().split()[1]) * _PAGE
            with open(f"/proc/{each}/stat") as file:
                fields = file.read().rsplit(")", 1)[1].split()
            cpu += (int(fields[11]) + int(fields[12])) / _TICK
    return size, cpu


def queued_ns(pid: int) -> int:
    """Return the time for which threads of a process and its descendants waited for a processor [ns].

    It is 0 on kernels without schedstats.
    """
    waited = 0
    for each in family(pid):
        with contextlib.suppress(OSError):
            for task in os.listdir(f"/proc/{each}/task"):
                with (
                    contextlib.suppress(OSError, IndexError, ValueError),
                    open(f"/proc/{each}/task/{task}/schedstat") as file,
                ):
                    waited += int(file.read().split()[1])
    return waited


def age_s() -> float:
    """Return the time since this process began, including its imports [s]."""
    with open("/proc/self/stat") as file:
        began = int(file.read().rsplit(")", 1)[1].split()[19]) / _TICK
    return time.clock_gettime(time.CLOCK_BOOTTIME) - began


def end(mark: str, seconds: float = 2.0) -> int:
    """Kill every process that carries the mark, and return how many there were."""
    deadline, ended = time.monotonic() + seconds, set()
    while (left := marked(mark)) and time.monotonic() < deadline:
        for pid in left:
            ended.add(pid)
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.005)
    return len(ended)
