"""The paced clock: virtual time at the pace of the machine's."""

import os
import time

from tactemu.base.clock import PacedClock


def test_it_is_at_its_deadline_however_late_the_machine_is():
    clock = PacedClock()
    clock.start()
    time.sleep(0.05)
    for deadline in (1_000_000, 2_000_000, 40_000_000):
        clock.wait(deadline, [])
        assert clock.now_ns() == deadline


def test_each_turn_has_a_time_of_its_own():
    clock = PacedClock()
    clock.start()
    read, write = os.pipe()
    os.write(write, b"x")
    times = []
    for deadline in (0, 0, 10_000_000_000):
        clock.wait(deadline, [read])
        times.append(clock.now_ns())
    os.close(read), os.close(write)
    assert times[:2] == [1, 2] and times[1] < times[2] < 10_000_000_000


def test_a_machine_that_is_late_makes_time_slower():
    clock = PacedClock()
    clock.start()
    time.sleep(0.2)
    clock.wait(1_000_000, [])
    since = time.monotonic()
    clock.wait(101_000_000, [])
    assert time.monotonic() - since > 0.05, "it hurried to catch up"
