"""The device's clock: exact counts, skew, delay and jitter that never reorder."""

import numpy as np
import pytest

from tactemu.sampling import SampleClock


def test_due_times_do_not_accumulate_error():
    clock = SampleClock(period_ns=1_000_000, skew_ppm=50.0)
    assert clock.due_ns(3_600_000) == 3_600_000 * 1_000_000 + 50 * 3_600_000
    assert clock.due_ns(2**40) - clock.due_ns(2**40 - 1) in (1_000_050, 1_000_049, 1_000_051)


def test_jitter_is_bounded_repeats_and_never_reorders():
    clock = SampleClock(period_ns=1_000_000, delay_ns=3_700_000, jitter_ns=2_500_000, seed=3)
    release = np.array([clock.release_ns(k, clock.due_ns(k)) for k in range(1, 5000)])
    due = np.array([clock.due_ns(k) for k in range(1, 5000)])
    assert (np.diff(release) >= 0).all()
    assert (release - due).min() >= 3_700_000 and (release - due).max() <= 3_700_000 + 2_500_000
    assert np.array_equal(release, [clock.release_ns(k, clock.due_ns(k)) for k in range(1, 5000)])


@pytest.mark.parametrize("bad", [{"period_ns": 0}, {"period_ns": 1, "delay_ns": -1}])
def test_nonsense_is_refused(bad):
    with pytest.raises(ValueError, match="expected"):
        SampleClock(**bad)
