"""Tests of the parsing of printed lines as rows of numbers."""

import math

import pytest

from tactemu.judge.reader_loop import plain
from tactemu.judge.row_parser import RowParser


@pytest.mark.parametrize(
    ("line", "row"),
    [
        ('{"fx": 1, "f": {"y": [2.5, true]}, "name": "left"}', {"fx": 1, "f.y.0": 2.5, "f.y.1": 1}),
        ("[[1, 2], [3, 4]]", {"0.0": 1, "0.1": 2, "1.0": 3, "1.1": 4}),
        ("[ 1.5  2e3 -7]", {"0": 1.5, "1": 2000, "2": -7}),
        ("1,2;3\t4", {"0": 1, "1": 2, "2": 3, "3": 4}),
        ("fx=1.5 fy: -2", {"fx": 1.5, "fy": -2}),
        ("3.25", {"0": 3.25}),
        ("Traceback (most recent call last):", None),
        ("could not open port: code = 5 because nobody has it", None),
        ("2026-11-22 09:00:00 WARNING 3 frames lost", None),
        ("{", None),
        ('{"error": "timeout"}', None),
        ("", None),
        ("[" * 100_000, None),
        ("x" * 250_000, None),
        ("a." * 100_000 + "=", None),
    ],
)
def test_a_line(line, row):
    assert RowParser().parse(line) == row


def test_a_table_has_a_head_and_talk_is_none():
    rows = RowParser()
    assert rows.parse("connected, at last") is None
    assert rows.parse("fx, fy") is None and rows.parse("1, 2") == {"fx": 1, "fy": 2}
    assert rows.parse("checksum, again") is None and rows.parse("3, 4") == {"fx": 3, "fy": 4}
    assert rows.parse("1, 2, 3") == {"0": 1, "1": 2, "2": 3}


def test_nothing_is_told_from_a_number():
    row = RowParser().parse('{"fx": NaN, "fy": null, "fz": 1e999}')
    assert row is not None and math.isnan(row["fx"]) and row["fz"] == math.inf and "fy" not in row


def test_readings_of_all_shapes_are_printed():
    np = pytest.importorskip("numpy")

    class Packet:
        def __init__(self):
            self.force, self._port = np.arange(2), object()

    assert plain(Packet()) == {"force": [0, 1]}
    assert plain({"a": (np.float32(1), {1: [True]})}) == {"a": [1.0, {"1": [True]}]}
    assert plain(np.eye(2)) == [[1, 0], [0, 1]]
