"""Tests of the table of planted mistakes, of its summary, and of one of its rows."""

import pytest

from tests.judge import planted


def test_rows_are_chosen_by_line_driver_mistake_and_kind():
    assert len(planted.rows()) >= 60 and {planted.DRIVERS[row.driver].line for row in planted.rows()} == {
        "stream", "polled", "modbus", "can", "udp", "tcp",
    }  # fmt: skip
    chosen = planted.rows(["udp", "scale"])
    assert chosen and all(row.driver == "udp" and "scale" in row.kinds for row in chosen)
    assert not planted.rows(["udp", "polled"])


def test_the_command_fails_for_a_mistake_that_is_not_named(capsys):
    (row,) = planted.rows(["stream", "mask"])
    right, missed = (planted.Result(row, found, "its verdicts", 1.0) for found in ((("wrong", "clean"),), ()))
    assert planted.summary([right], total=1) and not planted.summary([right], total=2)
    capsys.readouterr()
    assert not planted.summary([right, missed], total=2)
    shown = capsys.readouterr().out
    assert row.name in shown and "its verdicts" in shown and "1 of 2" in shown


@pytest.mark.timeout(120)
def test_a_mistake_is_judged_and_named():
    (row,) = planted.rows(["stream", "mask"])
    result = planted.judge_record(row)
    assert result.is_named and result.got == "wrong", result.about
