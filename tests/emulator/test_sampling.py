"""The device's clock: exact counts, skew, drift, delay, jitter, and the time that it shows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactemu.emulator.sampling import SampleClock
from tests.fuzz import examples

MS = 1_000_000


def lateness(clock: SampleClock, n: int) -> np.ndarray:
    """How long after it was due each of the first samples leaves [ns]."""
    return np.array([clock.release_ns(k, clock.due_ns(k)) - clock.due_ns(k) for k in range(1, n + 1)])


def test_due_times_do_not_accumulate_error():
    clock = SampleClock(period_ns=MS, skew_ppm=50.0)
    assert clock.due_ns(3_600_000) == 3_600_000 * MS + 50 * 3_600_000
    assert clock.due_ns(2**40) - clock.due_ns(2**40 - 1) in (1_000_050, 1_000_049, 1_000_051)


def test_drift_is_the_integral_of_a_growing_skew():
    """1 ppm/s for 100 s: 100 ppm in the end, half of that on average: 5 ms late."""
    clock = SampleClock(period_ns=MS, drift_ppm_per_s=1.0)
    assert clock.due_ns(100_000) - 100_000 * MS == pytest.approx(5 * MS, abs=1)
    late = clock.due_ns(100_001) - clock.due_ns(100_000) - MS
    assert late == pytest.approx(100, abs=1)


@examples(200)
@given(
    k=st.integers(1, 10**9),
    period=st.integers(1000, 10**9),
    skew=st.floats(-5e4, 5e4),
    drift=st.floats(-1.0, 1.0),
    start=st.integers(0, 10**15),
)
def test_the_devices_clock_shows_its_count(k, period, skew, drift, start):
    """``local_ns`` undoes the stretch of ``due_ns`` to two nanoseconds, and more for what float64 cannot resolve."""
    k = min(k, 10**13 // period)  # three hours: beyond, a drift of 1 ppm/s is no oscillator
    clock = SampleClock(period_ns=period, skew_ppm=skew, drift_ppm_per_s=drift, start_ns=start)
    assert abs(clock.local_ns(clock.due_ns(k)) - clock.stamp_ns(k)) <= 2
    assert clock.stamp_ns(k) == start + k * period


def test_a_true_clock_shows_our_time():
    assert SampleClock(period_ns=MS).local_ns(2**60 + 1) == 2**60 + 1


@pytest.mark.parametrize("jitter", [900_000, 2_500_000])
def test_a_million_frames_in_order_and_never_early(jitter):
    clock = SampleClock(period_ns=MS, delay_ns=3_700_000, jitter_ns=jitter, skew_ppm=-80.0, seed=3)
    due = np.array([clock.due_ns(k) for k in range(1, 1_000_001)])
    # The law of `release_ns` at once: the latest of all frames so far. A sample of frames checks that it is that law.
    own = due + clock.delay_ns + np.array([clock._jitter(k) for k in range(1, 1_000_001)])
    release = np.maximum.accumulate(own)
    picked = np.concatenate([np.arange(1, 200), np.random.default_rng(0).integers(1, 1_000_001, 20_000)])
    assert [clock.release_ns(int(k), int(due[k - 1])) for k in picked] == release[picked - 1].tolist()
    late = release - due
    assert late.min() >= 3_700_000 and late.max() <= 3_700_000 + jitter
    assert (np.diff(release) >= 0).all()


def test_jitter_is_uniform_and_white():
    """Below a period nothing is held back, so delays are the draws: 1e5 of them, Kolmogorov-Smirnov at p = 1e-3."""
    from scipy.stats import kstest

    clock = SampleClock(period_ns=MS, delay_ns=100, jitter_ns=MS - 1, seed=5)
    late = lateness(clock, 100_000) - 100
    assert kstest(late / (MS - 1), "uniform").pvalue > 1e-3
    centred = late - late.mean()
    for lag in (1, 2, 7):
        assert abs(np.mean(centred[lag:] * centred[:-lag])) / late.var() < 4.5 / np.sqrt(late.size)


def test_small_jitter_takes_all_its_values_alike():
    clock = SampleClock(period_ns=MS, jitter_ns=3)
    seen = np.bincount(lateness(clock, 40_000), minlength=4)
    assert len(seen) == 4 and np.abs(seen - 10_000).max() < 4.5 * np.sqrt(10_000 * 0.75)


def test_reordering_only_when_asked():
    options = {"period_ns": MS, "jitter_ns": 10 * MS, "seed": 1}
    for reorder, expected in ((False, False), (True, True)):
        clock = SampleClock(reorder=reorder, **options)
        release = [clock.release_ns(k, clock.due_ns(k)) for k in range(1, 5000)]
        assert bool((np.diff(release) < 0).any()) is expected


def test_same_seed_same_jitter_and_a_stream_for_each_device():
    def jitter(seed, name):
        clock = SampleClock(period_ns=MS, jitter_ns=900_000, seed=seed, name=name)
        return lateness(clock, 2000)

    assert np.array_equal(jitter(1, "left"), jitter(1, "left"))
    for other in (jitter(2, "left"), jitter(1, "right")):
        assert abs(np.corrcoef(jitter(1, "left"), other)[0, 1]) < 4.5 / np.sqrt(2000)


def test_the_oscillator_keeps_its_drift_and_its_time_when_the_rate_changes():
    clock = SampleClock(period_ns=MS, skew_ppm=10.0, drift_ppm_per_s=2.0)
    faster = clock.restarted(5_000 * MS, MS // 2)
    assert faster.skew_ppm == pytest.approx(20.0)
    assert faster.due_ns(1) - 5_000 * MS == MS // 2 + 10
    assert faster.local_ns(5_000 * MS) == clock.local_ns(5_000 * MS)
    assert faster.local_ns(9_000 * MS) == pytest.approx(clock.local_ns(9_000 * MS), abs=100)


def test_the_skew_has_grown_by_the_time_since_the_last_change_of_rate():
    clock = SampleClock(period_ns=MS, skew_ppm=10.0, drift_ppm_per_s=2.0)
    twice = clock.restarted(5_000 * MS, MS // 2).restarted(7_000 * MS, MS)
    assert twice.skew_ppm == pytest.approx(24.0)
    assert twice.restarts == 2 and twice.due_ns(1) == 7_001 * MS + 24


@pytest.mark.parametrize("clock", [{}, {"skew_ppm": 400.0}, {"skew_ppm": -400.0, "drift_ppm_per_s": 3.0}])
def test_an_alarm_rings_when_the_devices_clock_shows_its_time(clock):
    clock = SampleClock(period_ns=MS, start_ns=300 * MS, shown_ns=7 * MS, **clock)
    for k in (1, 1000, 60_000):
        assert clock.world_ns(clock.stamp_ns(k)) == clock.due_ns(k)
    assert clock.world_ns(6 * MS) == 299 * MS, "before it counted"


def test_an_oscillator_that_drifts_for_long_stays_within_a_tenth():
    clock = SampleClock(period_ns=1000 * MS, drift_ppm_per_s=-1000.0)
    assert clock.due_ns(100) == 95_000 * MS, "half of a tenth, on average"
    assert clock.due_ns(400) == 360_000 * MS


@pytest.mark.parametrize(
    "bad",
    [
        {"period_ns": 0},
        {"period_ns": 1, "delay_ns": -1},
        {"period_ns": 1, "jitter_ns": -1},
        {"period_ns": 1, "skew_ppm": -1e6},
        {"period_ns": 1, "skew_ppm": float("nan")},
        {"period_ns": 1, "drift_ppm_per_s": float("inf")},
    ],
)
def test_nonsense_is_refused(bad):
    with pytest.raises(ValueError, match="expected"):
        SampleClock(**bad)


def test_a_loop_that_misses_turns_has_periods_of_twice_the_length():
    clock = SampleClock(period_ns=MS, missed=0.05, seed=2)
    taken, k = [], 0
    while k < 40_000:
        taken.append(k := clock.first_taken(k + 1))
    apart = np.diff(taken)
    assert np.mean(apart == 2) == pytest.approx(0.05 * 0.95, abs=4.5 * np.sqrt(0.05 / 40_000))
    assert set(apart) <= {1, 2, 3, 4, 5} and SampleClock(period_ns=MS).first_taken(7) == 7
    with pytest.raises(ValueError, match="missed"):
        SampleClock(period_ns=MS, missed=1.0)
