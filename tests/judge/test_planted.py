"""The table of planted mistakes, and one of its rows."""

import pytest

from tests.judge import planted


def test_rows_are_chosen_by_line_driver_mistake_and_kind():
    assert len(planted.rows()) >= 60 and {planted.DRIVERS[row.driver].line for row in planted.rows()} == {
        "stream", "polled", "modbus", "can", "udp", "tcp",
    }  # fmt: skip
    chosen = planted.rows(["udp", "scale"])
    assert chosen and all(row.driver == "udp" and "scale" in row.kinds for row in chosen)
    assert not planted.rows(["udp", "polled"])


@pytest.mark.realtime
@pytest.mark.timeout(120)
def test_a_mistake_is_judged_and_named():
    (row,) = planted.rows(["stream", "mask"])
    result = planted.judge_record(row)
    assert result.is_named and result.got == "wrong", result.about
