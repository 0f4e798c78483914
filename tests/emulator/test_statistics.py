"""The statistics of a run, from values that are known: percentiles, the latest values, copies, rates, names."""

import pickle

import numpy as np
import pytest

from tactemu.base.statistics import ChannelStatistics, Lateness

PERCENTILES = (0, 1, 50, 95, 99, 100)


def lateness(values, **options) -> Lateness:
    made = Lateness(**options)
    for value in values:
        made.add(value)
    return made


def percentiles(of: Lateness) -> list[float]:
    return [of.percentile_ns(q) for q in PERCENTILES]


def test_percentiles_are_those_of_the_deadlines_so_far():
    assert percentiles(Lateness()) == [0.0] * len(PERCENTILES)
    assert percentiles(lateness([7])) == [7.0] * len(PERCENTILES)
    assert percentiles(lateness(range(1, 102))) == [1, 2, 51, 96, 100, 101]


@pytest.mark.parametrize("count", [3, 4, 5, 11])
def test_percentiles_are_over_the_latest_values_and_the_maximum_over_all(count):
    values = [900, *range(count - 1)]
    made = lateness(values, keep=4)
    assert percentiles(made) == pytest.approx(np.percentile(values[-4:], PERCENTILES))
    assert (made.count, made.max_ns) == (count, 900)


@pytest.mark.parametrize("count", [0, 3, 4, 6])
def test_a_copy_keeps_the_values_of_its_time(count):
    made = lateness(range(count), keep=4)
    copy, before = made.copy(), percentiles(made)
    for value in (1000, 2000, 3000, 4000):
        made.add(value)
    assert percentiles(copy) == before
    assert (copy.count, copy.max_ns) == (count, max(0, count - 1)) and made.max_ns == 4000


def test_a_saved_state_has_the_values_so_far():
    made = lateness(range(1, 102))
    again = pickle.loads(pickle.dumps(made))
    assert percentiles(again) == percentiles(made) and (again.count, again.max_ns) == (101, 101)
    again.add(500)
    assert again.percentile_ns(100) == again.max_ns == 500


def test_every_figure_is_under_its_name():
    """Let two streams run at 100 and 20 Hz, the first late by 0, 1, 2 ... µs; a sample that is early is not late."""
    statistics = ChannelStatistics(missed=3, stretched=4, silent=5)
    for k in range(101):
        statistics.add_sample("", k * 10_000_000, k * 1000)
    assert statistics.as_dict() == {
        "samples": 101, "missed": 3, "stretched": 4, "silent": 5, "rate_hz": 100.0,
        "lateness_p50_us": 50.0, "lateness_p99_us": 99.0, "lateness_max_us": 100.0,
    }  # fmt: skip
    for k in range(11):
        statistics.add_sample("slow", k * 50_000_000, -1)
    found = statistics.as_dict()
    assert (found["samples"], found["rate_hz"], found["rate_hz_slow"]) == (112, 100.0, 20.0)
    assert statistics.lateness.percentile_ns(0) == 0.0 and statistics.last_ns == 1_000_000_000
    copy = statistics.copy()
    statistics.add_sample("slow", 10**10, 10**6)
    assert copy.as_dict() == found != statistics.as_dict()
