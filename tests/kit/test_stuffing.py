"""Packets whose content is stuffed, by parameters."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import Stuffed, Stuffing
from tests.kit.saving import restored, saved

STUFFING = Stuffing(head=b"[", tail=b"]", escape=b"\\", codes={b"[": b"(", b"]": b")", b"\\": b"/"})


@given(st.lists(st.binary(max_size=8)), st.integers(1, 5))
def test_contents_come_back_in_chunks_of_any_size(contents, size):
    stream = b"".join(map(STUFFING.wrap, contents))
    cutter = Stuffed(STUFFING, counters=(counters := Counter()))
    found = [each for at in range(0, len(stream), size) for each in cutter.cut(stream[at : at + size])]
    assert found == contents and counters["requests"] == len(contents)


def test_what_is_no_packet_is_skipped_and_counted():
    cutter = Stuffed(STUFFING, counters=(counters := Counter()))
    assert cutter.cut(b"xy[a\\(]z[b\\x][c[d]") == [b"a[", b"d"]
    assert counters == {"requests": 2, "skipped_bytes": 2 + 1 + 2, "broken_frames": 1}


def test_bytes_without_a_code_are_named():
    with pytest.raises(ValueError, match="give each of head, tail and escape a code"):
        Stuffing(tail=b"]", escape=b"\\", codes={b"]": b")"})


def test_a_cutter_is_plain_data():
    cutter = Stuffed(STUFFING, counters=Counter())
    cutter.cut(b"[ab")
    assert restored(saved(cutter)).cut(b"c]") == cutter.cut(b"c]") == [b"abc"]
