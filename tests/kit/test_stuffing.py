"""Packets whose content is stuffed, by parameters."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import Dle, Stuffed, Stuffing, dle
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


@given(st.lists(st.binary(max_size=30), max_size=5), st.integers(1, 40))
def test_dle_frames_come_back_in_chunks_of_any_size(contents, size):
    wire = b"".join(map(dle, contents))
    cutter = Dle(counters=(counters := Counter()))
    found = [each for at in range(0, len(wire), size) for each in cutter.cut(wire[at : at + size])]
    assert found == contents and counters == Counter(requests=len(contents))


def test_a_dle_is_doubled_and_summed_once():
    assert dle(b"\x12\x10\x17") == bytes.fromhex("10 02 12 10 10 17 10 03 16")  # JIS X 5002's example of content


def test_dle_frames_behind_broken_ones_are_found():
    cutter = Dle(counters=(counters := Counter()), broken=True)
    wrong = dle(b"ab")[:-1] + b"\xff"
    assert cutter.cut(b"xx" + wrong + b"\x10\x02a\x10\x02" + dle(b"cd")[2:])[-1] == b"cd"
    assert counters["bad_checksum"] == counters["broken_frames"] == counters["requests"] == 1
