"""Time as an unmodified driver sees it: a delay that is never shorter, and a schedule of things that go wrong."""

import time

import numpy as np
import pytest

from tests.drivers.live import Live, served, until
from tests.drivers.test_flexitac_optoforce import SCALE

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]

MS = 1_000_000


def emulation_times(dev) -> int:
    """What to subtract from a monotonic time [ns]; too small by less than a call of the clock takes."""
    return max(time.monotonic_ns() - dev.emulator.clock.now_ns() for _ in range(100)) - 10_000


def test_a_delay_of_3_7_ms_at_1_khz(tmp_path):
    """Never a nanosecond less. anyskin looks at a frame when the next one has begun, so that a period of 1 ms comes on
    top, and the lateness of the loop, which the log of frames tells, and that of the driver's process, which the
    quickest tenth of the readings is spared."""
    with (
        served(tmp_path, "anyskin", rate_hz=1000, more="clock = { delay_s = 0.0037 }") as dev,
        Live("anyskin", dev.port, dev) as live,
    ):
        assert live.settles()
        assert until(lambda: len(live.driver.rows) >= 1500, 30)
        start = emulation_times(dev)
        read = [(said.t_ns - start, live.place(said)) for said in live.rows[20:1500]]
    late = np.array([t - place for t, place in read if place is not None])
    assert len(late) >= 1400
    assert late.min() >= 3.7 * MS
    assert np.percentile(late, 10) < (3.7 + 1.0 + 10.0) * MS
    left = {frame: t_ns for t_ns, _, frame in dev.truth.frames}
    frames = {sample.t_ns: sample.counts.astype("<f4").tobytes() + b"\r\n" for sample in dev.truth.samples}
    behind = np.array([left[frames[place]] - place - 3.7 * MS for _, place in read if place is not None])
    assert behind.min() >= 0, "the loop's own lateness"
    assert (late - behind).min() >= 3.7 * MS


def test_a_schedule_that_a_driver_lives_through(tmp_path):
    """At 0.2 s half of the frames are lost, at 0.8 s the device hangs, at 1.2 s it restarts."""
    with (
        served(tmp_path, "optoforce", noise=20.0) as dev,
        Live("optoforce", dev.port, dev, lambda counts: (counts * SCALE).ravel()) as live,
    ):
        assert live.settles()
        since = len(live.rows)
        dev.inject_event(at=0.2, until=0.6, fault="drop 50%")
        dev.inject_event(at=0.8, until=1.1, hang=True)
        dev.inject_event(at=1.2, reset=True)
        dev.wait(1.5)
        assert live.settles(10)
        story, injected, times = live.story(since), dev.truth.injected, [said.t_ns for said in live.rows[since:]]
        notes = live.notes
    assert injected["hang"] == injected["reset"] == 1 and injected["drop"] > 5
    unsent = 1  # the sample that the restart took
    assert story == {"lost": injected["drop"] + unsent}, "a device that hangs takes no samples that could be lost"
    assert max(np.diff(times)) >= 0.28e9 and not notes
