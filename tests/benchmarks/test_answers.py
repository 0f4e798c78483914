"""The measurement of answers runs, on every kind of port; its figures are nobody's business here."""

import pytest

from benchmarks import answers


@pytest.mark.parametrize("case", answers.CASES, ids=lambda case: case.name)
def test_every_question_is_answered(case, capfd):
    found = answers.answer_ms(case, 20)
    assert found["lost"] == 0 and 0 < found["p50"] <= found["p99"]
    assert not capfd.readouterr().err, "python-can warns of a bus that is left open"
