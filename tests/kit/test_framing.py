import copy
from collections import Counter

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_protocols import MORE, NO_PACKET, SOUND, Broken, Cobs, Lines, Packets, Ppp, cobs, ppp
from firmware_protocols.sums import lrc8
from tests.kit.saving import restored, saved

HEAD = b"\x55\xaa"
DATA = b"\x01\x02\x03"
GOOD = HEAD + b"\x03" + DATA + bytes([lrc8(HEAD + b"\x03" + DATA)])


def _size(data):
    if len(data) < 3:
        return MORE
    return 4 + data[2] if data[2] <= 8 else "bad_length"


def _check(packet):
    return SOUND if lrc8(packet) == 0 else "bad_checksum"


def _feetech_size(data):
    if len(data) < 4:
        return MORE
    return 4 + data[3] if 2 <= data[3] <= 250 and data[2] <= 0xFE else NO_PACKET


def packets(**options):
    counters = Counter()
    return Packets(HEAD, _size, _check, counters=counters, **options), counters


def byte_by_byte(cutter, data):
    return [packet for byte in data for packet in cutter.cut(bytes([byte]))]


def test_packets_between_garbage_are_found_and_the_garbage_is_counted():
    cutter, counters = packets()
    assert cutter.cut(b"\x00\x55" + GOOD + b"\xaa" + GOOD + GOOD[:3]) == [GOOD, GOOD]
    assert cutter.cut(GOOD[3:]) == [GOOD]
    assert counters == {"requests": 3, "skipped_bytes": 3}


def test_a_wrong_sum_and_a_wrong_length_are_dropped_as_far_as_the_next_head_can_begin():
    cutter, counters = packets()
    assert cutter.cut(GOOD[:-1] + b"\x00" + HEAD + b"\xff" + GOOD) == [GOOD]
    assert counters == {"requests": 1, "bad_checksum": 1, "bad_length": 1, "skipped_bytes": 5 + 1}


def test_a_packet_inside_a_broken_one_is_found():
    cutter, _ = packets()
    assert cutter.cut(HEAD + b"\x08" + GOOD + b"\x00" * 4) == [GOOD]


def test_a_firmware_that_answers_broken_packets_gets_them_with_the_reason():
    cutter, _ = packets(broken=True)
    wrong, long, right = cutter.cut(GOOD[:-1] + b"\x00" + HEAD + b"\xff" + GOOD)
    assert isinstance(wrong, Broken) and wrong == GOOD[:-1] + b"\x00" and wrong.why == "bad_checksum"
    assert isinstance(long, Broken) and long.startswith(HEAD + b"\xff") and long.why == "bad_length"
    assert right == GOOD and not isinstance(right, Broken)


def test_a_silence_forgets_what_is_not_whole():
    cutter, counters = packets(gap_ns=50)
    assert cutter.cut(GOOD[:4], 0) == []
    assert cutter.cut(GOOD, 51) == [GOOD]
    assert counters["broken_frames"] == 1
    assert cutter.cut(GOOD[:4], 100) == []
    assert cutter.cut(GOOD[4:], 150) == [GOOD]


def test_a_head_that_overlaps_itself_is_found_after_its_own_first_byte():
    cutter = Packets(b"\xff\xff", _feetech_size, counters=Counter())
    ping = bytes.fromhex("FF FF 01 02 01 FB")
    assert cutter.cut(b"\xff" + ping + b"\xff\xff" + ping) == [ping, ping]
    assert byte_by_byte(cutter, b"\xff" + ping + b"\xff\xff" + ping) == [ping, ping]


def test_without_a_head_the_size_says_where_packets_begin():
    cutter = Packets(b"", _starts_with_9a, counters=(counters := Counter()))
    assert cutter.cut(b"\x00\x9a\x01\x00\x9a\x02") == [b"\x9a\x01", b"\x9a\x02"]
    assert counters == {"requests": 2, "skipped_bytes": 2}


def _starts_with_9a(data):
    return 2 if data[0] == 0x9A else NO_PACKET


PIECES = st.lists(st.sampled_from([GOOD, GOOD[:-1], GOOD[:5], HEAD, b"\x55", b"\xff", GOOD[:-1] + b"\x00"]), max_size=8)


@given(PIECES)
@example([HEAD, GOOD[:-1]])
def test_byte_by_byte_is_the_same_as_whole(pieces):
    (whole, whole_counters), (slow, slow_counters) = packets(), packets()
    data = b"".join(pieces)
    assert whole.cut(data) == byte_by_byte(slow, data)
    assert whole_counters == slow_counters
    assert whole.cut(b"\0" * 12 + GOOD)[-1:] == [GOOD]


def _endless(data):
    return MORE


def _huge(data):
    return 1 << 40


@pytest.mark.parametrize("size", [_endless, _huge])
def test_what_waits_is_bounded(size):
    counters = Counter()
    cutter = Packets(HEAD, size, counters=counters, longest=100)
    for _ in range(50):
        cutter.cut(HEAD * 100)
    assert len(saved(cutter)) < 2000
    assert counters["bad_length"] > 50


@pytest.mark.parametrize("function", [lambda data: 3, [].index, GOOD.startswith])
def test_a_function_that_a_saved_device_cannot_name_is_refused(function):
    with pytest.raises(TypeError, match="expected a function of a module"):
        Packets(HEAD, function, counters=Counter())


def test_half_a_packet_survives_a_copy_and_a_file_with_the_counters_of_its_device():
    cutter, counters = packets()
    cutter.cut(b"\x00" + GOOD[:4])
    for state in (copy.deepcopy((cutter, counters)), restored(saved((cutter, counters)))):
        other, others = state
        assert other.cut(GOOD[4:]) == [GOOD]
        assert others == {"requests": 1, "skipped_bytes": 1}
    assert "requests" not in counters


# -- pieces that end with a byte -------------------------------------------------------------------------------------


def test_ppp_escapes_flags():
    assert ppp(b"\x01\x7d\x7e") == bytes.fromhex("7E 01 7D5D 7D5E 7E")


@pytest.mark.parametrize("encode, cutter", [(ppp, Ppp), (cobs, Cobs)])
@given(st.lists(st.binary(min_size=1, max_size=600), max_size=4))
@example([b"\0"])
@example([b"\1" * 254, b"\1" * 254 + b"\0", b"\0" * 3])
def test_escaped_frames_come_back_whole_and_byte_by_byte(encode, cutter, contents):
    counters = Counter()
    data = b"".join(map(encode, contents))
    assert cutter(counters=counters, longest=600).cut(data) == contents
    assert byte_by_byte(cutter(counters=counters, longest=600), data) == contents
    assert not counters


@pytest.mark.parametrize(
    "content, frame",
    [
        # Examples of the Wikipedia page on COBS.
        ("00", "01 01 00"),
        ("00 00", "01 01 01 00"),
        ("00 11 00", "01 02 11 01 00"),
        ("11 22 00 33", "03 11 22 02 33 00"),
        ("11 22 33 44", "05 11 22 33 44 00"),
    ],
)
def test_cobs_as_published(content, frame):
    assert cobs(bytes.fromhex(content)) == bytes.fromhex(frame)


def test_cobs_that_points_beyond_its_end_is_counted():
    counters = Counter()
    assert Cobs(counters=counters).cut(b"\x05\x01\x00" + cobs(b"ok")) == [b"ok"]
    assert counters == {"broken_frames": 1}


def test_an_escape_at_the_end_of_a_ppp_frame_escapes_nothing():
    assert Ppp(counters=Counter()).cut(b"\x7e\x01\x02\x7d\x7e\x03\x7e") == [b"\x01\x02", b"\x03"]


def test_lines_end_with_any_of_their_ends():
    lines = Lines(counters=Counter())
    assert lines.cut(b"one\r\ntwo\n\nth") == [b"one", b"two"]
    assert lines.cut(b"ree\r") == [b"three"]


def test_a_silence_may_end_a_line():
    lines = Lines(counters=Counter())
    assert lines.cut(b"one\ntw") == [b"one"] and lines.has_partial
    assert lines.end() == [b"tw"] and not lines.has_partial and lines.end() == []


def test_a_line_without_end_is_bounded_and_counted_once():
    counters = Counter()
    lines = Lines(counters=counters, longest=10)
    for _ in range(1000):
        assert lines.cut(b"x" * 50) == []
    assert len(saved(lines)) < 600
    assert lines.cut(b"\nok\n" + b"y" * 11 + b"\n") == [b"ok"]
    assert counters == {"bad_length": 2}


@pytest.mark.parametrize("cutter, data", [(Lines, b"half"), (Ppp, b"\x7ehalf\x7d"), (Cobs, b"\x05hal")])
def test_half_a_piece_survives_a_file_and_not_a_reset(cutter, data):
    heard = cutter(counters=Counter())
    heard.cut(data)
    assert saved(restored(saved(heard))) == saved(heard)
    heard.reset()
    assert saved(heard) == saved(cutter(counters=Counter()))
