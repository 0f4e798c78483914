"""Tests of columns that could hold several equal channels."""

import numpy as np
import pytest

from tactemu.judge.checks import misnamed, unread_channels
from tactemu.judge.columns import Channel
from tactemu.judge.trial_record import sample_of
from tests.judge.test_column_learning import enumerate_names, learned, samples, wrench_of


def test_two_channels_that_are_one_are_both_named():
    taken = [sample_of(s.t_ns, s.number, np.array([*s.counts[:8], s.counts[0]])) for s in samples()]
    columns = learned(lambda x, k: {"a": x[0], "b": x[1]}, taken=taken)
    assert columns.values[0].also == [0, 8] and not columns.values[1].also
    assert "pad[2].z" in dict(columns.describe())["a"], "an ambiguous mapping is shown"


def test_of_channels_that_are_one_the_name_of_the_column_decides():
    """Check equal channels: a force on one point of contact changes Fx and My together."""
    taken = [sample_of(s.t_ns, s.number, s.counts[[0, 1, 2, 1, 0, 5]] * [1, 1, 1, -1, 1, 1]) for s in samples(6)]
    columns = wrench_of(taken=taken)
    assert [column.channel for column in columns.values] == list(range(6)) and misnamed(columns) == []
    assert not any(column.also for column in columns.values)


@pytest.mark.parametrize("made", [lambda t: t, lambda t: np.clip(t, -1000, 1000), lambda t: np.sqrt(t + 3001.0)])
def test_no_channel_is_unread_of_which_a_column_holds_an_equal_one(made):
    """Check five equal channels among fifteen, as the temperatures of AnySkin's five chips are."""
    channels = [Channel(f"skin[{k}].{own}") for k in range(5) for own in ("T", "Bx", "By")]
    own = np.where(np.arange(15) % 3 == 0, 0, np.cumsum(np.arange(15) % 3 > 0))
    taken = [sample_of(s.t_ns, s.number, s.counts[own]) for s in samples(11)]
    columns = learned(lambda x, k: dict(enumerate_names([made(x[0]), *x[1:]])), taken=taken, channels=channels)
    several = learned(lambda x, k: dict(enumerate_names([made(v) if i % 3 == 0 else v for i, v in enumerate(x)])),
                      taken=taken, channels=channels)  # fmt: skip
    alike = [line for line in several.describe() if "which are the same" in line[1]]
    assert len(alike) == 1 and "one each of skin[0].T, skin[1].T" in alike[0][1], "one line, not five"
    assert columns.values[0].also == [0, 3, 6, 9, 12] and not columns.unread() and not unread_channels(columns)
    columns = learned(lambda x, k: dict(enumerate_names(x[np.arange(15) % 3 > 0])), taken=taken, channels=channels)
    assert [each.name for each in columns.unread()] == [f"skin[{k}].T" for k in range(5)]
