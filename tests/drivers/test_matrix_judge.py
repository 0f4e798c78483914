"""The judge of the matrix: what it says of readings whose story is known."""

from types import SimpleNamespace

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.clock import VirtualClock
from tactemu.truth import Truth
from tests.drivers.matrix.bout import Judge
from tests.drivers.matrix.drivers import DRIVERS
from tests.drivers.matrix.endure import digest
from tests.drivers.matrix.page import page, verdict

PERIOD = 10_000_000
STREAM = DRIVERS["anyskin"]


@pytest.fixture
def judge(monkeypatch):
    """Forty samples, one each 10 ms; the monotonic clock and the emulation's are the same."""
    truth, clock = Truth(), VirtualClock(1_000 * PERIOD)
    for k in range(1, 41):
        truth.sample(k * PERIOD, "skin", np.zeros(1), np.zeros(1), np.full((5, 4), float(k)))
    dev = SimpleNamespace(
        truth=truth, emulator=SimpleNamespace(clock=clock), device=lambda: fp.create("anyskin")
    )  # fmt: skip
    monkeypatch.setattr("tests.drivers.matrix.bout.time.monotonic_ns", clock.now_ns)
    return Judge(dev, STREAM)


def reading(sample: float, at: float | None = None, **more) -> dict:
    """A line of the driver's: sample number ``sample``, reported a moment after ``at`` (default: its own time)."""
    part = digest(np.full(20, float(sample)))
    return {"t": round((sample if at is None else at) * PERIOD) + 1, "parts": [part], **more}


def outcome(judge, *lines, on=10):
    return judge.outcome("anyskin", "drop", [reading(9), reading(10, 9.5), *lines], on * PERIOD, 20 * PERIOD)


def test_a_stream_without_a_flaw(judge):
    result = outcome(judge, *(reading(k) for k in range(11, 41)))
    assert (result.readings, result.wrong, result.lost, result.older, result.again) == (30, 0, 0, 0, 0)
    assert result.recovered == pytest.approx(0.0, abs=1e-6) and verdict(result, STREAM) == "not hit"
    result.injected = 1
    result.gap = 0.0
    assert verdict(result, STREAM) == "ok"


@pytest.mark.parametrize(
    ("lines", "expected", "word"),
    [
        ([reading(11), reading(13)], {"lost": 1}, "loses"),
        ([reading(12)], {"lost": 1}, "loses"),
        ([reading(11), reading(11, 11.5), reading(12)], {"again": 1}, "mixes"),
        ([reading(12), reading(11, 12.5), reading(13)], {"older": 1}, "mixes"),
        ([reading(11.5), reading(12)], {"wrong": 1, "lost": 1}, "**wrong**"),
        ([reading(11, refused=True), reading(12)], {"refused": 1, "lost": 1}, "error"),
    ],
)
def test_each_flaw_is_told(judge, lines, expected, word):
    result = outcome(judge, *lines)
    names = ("wrong", "refused", "older", "lost", "again")
    assert {name: getattr(result, name) for name in names if getattr(result, name)} == expected
    result.injected, result.recovered, result.gap = 1, 0.1, 0.0
    assert verdict(result, STREAM) == word


def test_exceptions_count_but_not_those_of_opening_a_port_that_is_gone(judge):
    lost = {"t": 11 * PERIOD, "error": "SerialException", "text": "gone", "opening": False}
    result = outcome(judge, lost, lost | {"opening": True}, reading(30))
    assert dict(result.errors) == {"SerialException": 1} and result.lost == 19


def test_readings_of_old_samples_are_no_recovery(judge):
    """Ten right readings of samples from before the end of the fault had only been waiting."""
    waiting = [reading(k, 20 + k / 100) for k in range(11, 20)]
    assert judge.recovered(waiting, 20 * PERIOD) is None
    fresh = [reading(k) for k in range(21, 31)]
    assert judge.recovered([*waiting, *fresh[:9]], 20 * PERIOD) is None
    assert judge.recovered([*waiting, *fresh], 20 * PERIOD) == pytest.approx(0.01, abs=1e-6)
    broken = [*fresh[:5], {"t": fresh[4]["t"] + 1, "error": "E", "text": ""}, *fresh[5:]]
    assert judge.recovered(broken, 20 * PERIOD) is None


def test_the_page_has_a_cell_for_each_pair(judge):
    result = outcome(judge, *(reading(k) for k in range(11, 41)))
    text = page({("anyskin", "drop"): result})
    assert "| `drop 10%` |  | 30 |" in text and "### anyskin 1.0.0 on `anyskin`" in text
