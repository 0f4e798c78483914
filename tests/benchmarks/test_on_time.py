"""``python -m benchmarks on_time``: each figure beside its limit, and the exit code of one that does not keep it."""

import pytest

from benchmarks import on_time
from benchmarks.on_time import Figure


@pytest.mark.parametrize(
    ("value", "at_least", "is_met"), [(2.0, False, True), (2.1, False, False), (2.0, True, True), (1.9, True, False)]
)
def test_a_figure_is_compared_with_its_limit(value, at_least, is_met):
    figure = Figure("late", value, 2.0, "ms", at_least)
    assert figure.is_met == is_met and str(figure).startswith("met" if is_met else "NOT MET")
    assert ("≥ 2" if at_least else "≤ 2") in str(figure)


def test_every_part_is_measured_and_what_is_not_met_is_named(monkeypatch):
    for name in ("_samples", "_answers", "_commands", "_closed_loop", "_life"):
        monkeypatch.setattr(on_time, name, lambda seconds, name=name: [Figure(name, len(name), 8, "")])
    said: list[str] = []
    figures, is_met = on_time.run(said.append, seconds=1.0)
    assert list(figures) == ["_samples", "_answers", "_commands", "_closed_loop", "_life"] and not is_met
    assert said[-1] == "3 of 5 limits are met; not: _commands, _closed_loop"


@pytest.mark.nightly
def test_all_of_it_runs():
    figures, _ = on_time.run(print, seconds=1.0)
    assert len(figures) > 10 and figures["full garbage collections meanwhile"] == 0
