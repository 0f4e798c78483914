"""The settings of a loop's thread and process: as they should be while it runs, and as before afterwards."""

import gc
import sys
import threading

import pytest

import tactemu
from tactemu.base.clock import LockstepClock, VirtualClock
from tactemu.base.gc_tuning import no_full_collections
from tactemu.base.loop import Loop
from tactemu.base.low_latency import SLICE_NS, low_latency, set_timer_slack, time_slice_ns, timer_slack_ns


def full_collections():
    return gc.get_stats()[2]["collections"]


def settings():
    return gc.get_threshold(), sys.getswitchinterval(), timer_slack_ns(), time_slice_ns()


@pytest.fixture(autouse=True)
def ordinary_settings():
    before = settings()
    set_timer_slack(50_000)
    yield
    assert settings() == (before[0], before[1], 50_000, before[3])
    set_timer_slack(before[2])


def test_a_thread_has_them_inside_the_block():
    with low_latency():
        threshold, interval, slack, slice_ns = settings()
    assert threshold[2] >= 1000 and interval == pytest.approx(1e-4) and slack == 1
    assert slice_ns in (0, SLICE_NS)  # 0: the kernel has none


def test_only_the_young_are_collected():
    kept = []
    with no_full_collections:
        start = full_collections()
        for _ in range(200_000):
            kept.append([object()])
        assert full_collections() == start


def test_blocks_of_threads_may_overlap():
    inside, leave = threading.Event(), threading.Event()

    def work():
        with low_latency():
            inside.set()
            leave.wait(60)

    thread = threading.Thread(target=work)
    with low_latency():
        thread.start()
        inside.wait(60)
    assert (
        gc.get_threshold()[1] == 1 and gc.get_threshold()[2] >= 5000 and sys.getswitchinterval() == pytest.approx(1e-4)
    )
    leave.set()
    thread.join()


def test_a_setting_of_the_program_stays():
    before = gc.get_threshold()
    with low_latency():
        gc.set_threshold(900, 9, 9)
    assert gc.get_threshold() == (900, 9, 9)
    gc.set_threshold(*before)


def test_a_served_device_has_them_in_its_thread_and_no_full_collection():
    kept, inside = [], []
    with tactemu.serve("anyskin", port="memory:", rate_hz=1000.0) as dev:
        dev.in_loop(lambda: inside.append((threading.get_ident(), settings())))
        start = full_collections()
        for _ in range(200_000):
            kept.append([object()])
        assert full_collections() == start
    (thread, (threshold, interval, slack, _)) = inside[0]
    assert thread != threading.get_ident() and slack == 1
    assert threshold[2] >= 1000 and interval == pytest.approx(1e-4)


@pytest.mark.parametrize("clock", [VirtualClock(), LockstepClock()])
def test_where_time_waits_for_the_loop_nothing_is_changed(clock):
    class Once(Loop):
        def step(self, end_ns=None):
            self.seen = settings()
            self.is_finished = True

    loop = Once(clock, [])
    loop.run()
    assert loop.seen == settings()
