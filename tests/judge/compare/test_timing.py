"""Rates on a busy machine: late and missing frames change no verdict, another period does."""

import numpy as np
import pytest

from firmware_protocols import Command
from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_classes import FrameClass
from tactemu.judge.compare.model import Answer
from tactemu.judge.compare.timing import check_latency, check_rate


def busy(rate_hz, seconds, *, missing=0.0, late=0.0, late_s=0.02, seed=1, batch_s=0.0):
    """Return times of frames [ns] of which some are missing, and some late, as those behind them are."""
    rng = np.random.default_rng(seed)
    times = np.arange(1, round(rate_hz * seconds)) / rate_hz
    times = times[rng.random(len(times)) >= missing]
    times = (
        times + rng.exponential(0.0002, len(times)) + (rng.random(len(times)) < late) * rng.random(len(times)) * late_s
    )
    if batch_s:
        times = np.ceil(times / batch_s) * batch_s
    return (np.maximum.accumulate(times) * 1e9).astype(np.int64).tolist()


def verdict_of(times, rate_hz):
    verdicts = Verdicts()
    made = FrameClass("frames", rate_hz=rate_hz, sample_hz=rate_hz)
    ratio = check_rate(made, times, [], verdicts)
    return verdicts, ratio


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("rate", "missing", "late"), [(100, 0.15, 0.3), (30, 0.1, 0.2), (500, 0.1, 0.1), (100, 0, 0)])
def test_a_busy_machine_makes_no_other_rate(rate, missing, late, seed):
    verdicts, ratio = verdict_of(busy(rate, 8, missing=missing, late=late, seed=seed), rate)
    assert verdicts.protocol == []
    assert ratio is not None and abs(ratio - 1) < 2e-3


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("factor", [0.95, 0.97, 1.03, 1.05])
def test_three_per_cent_are_found_on_a_busy_machine(factor, seed):
    verdicts, _ = verdict_of(busy(100 * factor, 5, missing=0.1 if factor < 1 else 0.01, late=0.2, seed=seed), 100)
    assert [each.kind for each in verdicts.protocol] == ["rate"]
    off = float(str(verdicts.protocol[0]).rpartition("(")[2].removesuffix(" %)"))
    assert off == pytest.approx(100 * (factor - 1), abs=0.11)


def test_frames_that_come_in_batches_have_their_rate():
    assert verdict_of(busy(1000, 8, batch_s=0.016), 1000)[0].protocol == []
    assert [each.kind for each in verdict_of(busy(900, 8, batch_s=0.016), 1000)[0].protocol] == ["rate"]


def test_where_most_frames_are_lost_unevenly_nothing_is_said():
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.exponential(0.0015, 4000)) + np.repeat(rng.random(40) * 0.3, 100).cumsum() * 0.1
    verdicts, ratio = verdict_of((times * 1e9).astype(np.int64).tolist(), 1000)
    assert verdicts.protocol == [] and ratio is None and "unevenly" in verdicts.unjudged[0]


@pytest.mark.parametrize(
    ("waits", "kinds"),
    [
        ([0.002, 0.09, 0.3, 0.05], []),
        ([0.0225, 0.09, 0.3], ["latency"]),
        ([0.5, 0.6], []),
    ],
)
def test_only_the_earliest_answer_counts(waits, kinds):
    verdicts = Verdicts()
    answer = Answer(Command(name="read", request="00", reply="01"), FrameClass("answer"), 1, (0.001, 0.002))
    check_latency(answer, waits, 0.0, verdicts)
    assert [each.kind for each in verdicts.protocol] == kinds
    check_latency(answer, waits, 0.016, both := Verdicts())
    assert both.protocol == [], "a USB bridge may keep bytes back"


def test_an_answer_that_comes_too_soon_is_told():
    verdicts = Verdicts()
    answer = Answer(Command(name="read", request="00", reply="01"), FrameClass("answer"), 1, (0.1, 0.1))
    check_latency(answer, [0.02, 0.2, 0.2], 0.0, verdicts)
    assert "after 20.0 ms, in the model after 100.0 ms at least" in str(verdicts.protocol[0])
