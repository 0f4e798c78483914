"""Time as an unmodified driver sees it: a delay that is never shorter, and a schedule of things that go wrong."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.drivers.matrix.bout import Ring, until
from tests.drivers.matrix.drivers import DRIVERS

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(120)]

MS = 1_000_000


def emulation_times(dev) -> int:
    """What to subtract from a monotonic time [ns]; too small by less than a call of the clock takes."""
    return max(time.monotonic_ns() - dev.emulator.clock.now_ns() for _ in range(100)) - 10_000


def test_a_delay_of_3_7_ms_at_1_khz(tmp_path):
    """Never a nanosecond less. anyskin looks at a frame when the next one has begun, so that a period of 1 ms comes on
    top, and the lateness of the loop, which the log of frames tells, and that of the driver's process, which the
    quickest tenth of the readings is spared."""
    driver = replace(DRIVERS["anyskin"], rate_hz=1000, more="clock = { delay_s = 0.0037 }")
    if not driver.installed:
        pytest.skip("anyskin is not installed")
    with Ring("anyskin", driver, tmp_path) as ring:
        assert ring.restart()
        lines = ring.process.lines
        assert until(lambda: len(lines) >= 1500, 30)
        start = emulation_times(ring.dev)
        read = [(line["t"] - start, ring.judge.places(line)) for line in list(lines)[20:1500] if "parts" in line]
    late = np.array([t - places[0] for t, places in read if places])
    assert len(late) >= 1400
    assert late.min() >= 3.7 * MS
    assert np.percentile(late, 10) < (3.7 + 1.0 + 10.0) * MS
    left = {frame: t_ns for t_ns, _, frame in ring.dev.truth.frames}
    frames = {sample.t_ns: sample.counts.astype("<f4").tobytes() + b"\r\n" for sample in ring.dev.truth.samples}
    behind = np.array([left[frames[places[0]]] - places[0] - 3.7 * MS for _, places in read if places])
    assert behind.min() >= 0, "the loop's own lateness"
    assert (late - behind).min() >= 3.7 * MS


def test_a_schedule_that_a_driver_lives_through(tmp_path):
    """At 0.2 s half of the frames are lost, at 0.8 s the device hangs, at 1.2 s it restarts, at 1.4 s taxel 0 dies."""
    driver = DRIVERS["optoforce"]
    if not driver.installed:
        pytest.skip("optoforce is not installed")
    with Ring("optoforce", driver, tmp_path) as ring:
        assert ring.restart()
        dev, lines, start = ring.dev, ring.process.lines, time.monotonic_ns()
        dev.happen(at=0.2, until=0.6, fault="drop 50%")
        dev.happen(at=0.8, until=1.1, hang=True)
        dev.happen(at=1.2, reset=True)
        dev.wait(1.5)
        end = time.monotonic_ns()
        assert until(lambda: ring.judge.recovered(lines, end) is not None, 10)
        outcome, injected = ring.judge.outcome("optoforce", "schedule", lines, start, end), dev.truth.injected
    assert injected["hang"] == injected["reset"] == 1 and injected["drop"] > 5
    unsent = 1  # the sample that the restart took
    assert outcome.lost - unsent == injected["drop"], "a device that hangs takes no samples that could be lost"
    assert (outcome.wrong, outcome.refused, outcome.older, outcome.again) == (0, 0, 0, 0)
    assert outcome.gap >= 0.28 and not outcome.errors
