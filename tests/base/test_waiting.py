"""The wait of every loop: its deadline is programmed exactly, and each thread and process has a timer of its own."""

import os
import resource
import threading
import time

import pytest

from tactemu.base import waiting
from tactemu.base.waiting import wait_until

HOUR_NS = 3_600_000_000_000


@pytest.fixture
def readable():
    read, write = os.pipe()
    os.write(write, b"x")
    yield read
    os.close(read)
    os.close(write)


def timer():
    return waiting._threads.waiter._timer.fileno


def programmed(fileno):
    """Return clock, flags and rest of a timer, as the kernel has them."""
    entries = dict(line.split(":", 1) for line in open(f"/proc/self/fdinfo/{fileno}").read().splitlines())
    s, ns = entries["it_value"].strip(" ()").split(", ")
    return int(entries["clockid"]), int(entries["settime flags"], 8), int(s) * 10**9 + int(ns)


def timers():
    links = [os.path.join("/proc/self/fd", name) for name in os.listdir("/proc/self/fd")]
    return sum(os.path.islink(link) and "timerfd" in os.readlink(link) for link in links)


def test_the_deadline_is_absolute_and_has_no_slack(readable):
    before = time.monotonic_ns()
    assert wait_until(before + HOUR_NS, [readable])
    clock, flags, rest = programmed(timer())
    assert clock == time.CLOCK_MONOTONIC and flags == 1
    assert rest + time.monotonic_ns() >= before + HOUR_NS >= rest + before


def test_a_wait_ends_at_its_deadline_and_not_before():
    for late_ns in (-1, 0, 1, 1000, 3_000_000):
        until = time.monotonic_ns() + late_ns
        assert not wait_until(until, [])
        assert time.monotonic_ns() >= until


def test_an_expiry_does_not_end_the_next_wait(readable):
    assert not wait_until(time.monotonic_ns() + 100_000, [])
    assert wait_until(time.monotonic_ns() + HOUR_NS, [readable])
    assert not wait_until(time.monotonic_ns() + 100_000, [])


def test_descriptors_may_have_any_number_and_must_be_open(readable):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    number = min(hard, 4096) - 1
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, number + 1), hard))
    try:
        os.dup2(readable, number)
        assert wait_until(time.monotonic_ns() + HOUR_NS, [number])
        os.close(number)
        with pytest.raises(OSError, match="Bad file descriptor"):
            wait_until(time.monotonic_ns() + HOUR_NS, [number])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_each_thread_has_a_timer_until_it_ends():
    wait_until(time.monotonic_ns() + 1_000_000, [])
    before, own = timers(), []

    def work():
        wait_until(time.monotonic_ns() + 1_000_000, [])
        own.append((timers(), timer()))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert own[0][0] == before + 1 and own[0][1] != timer() and timers() == before


def test_a_forked_process_does_not_set_its_parents_timer(readable):
    wait_until(time.monotonic_ns() + HOUR_NS, [readable])
    child = os.fork()
    if child == 0:
        wait_until(time.monotonic_ns() + 1000, [])
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert programmed(timer())[2] > HOUR_NS // 2
