import copy
from collections import Counter

import pytest

from firmware_protocols import Answer, RegisterMap, Registers
from firmware_protocols.protocols.eb90 import READ, SAVE_DELAY_NS, WRITE, Eb90, request
from tests.kit.saving import restored, saved

MAP = RegisterMap(
    """
    1000  u1             id     1..254  = 1
    1005  u1             save   0..1
    1546  <i2 x 6        angle             r
    4110  <i2 x 9        tip               r
    """,
    size=6000,
)
TIP = bytes.fromhex("EB 90 01 04 11 0E 10 12 46")


@pytest.fixture
def hand():
    registers = Registers(MAP)
    registers["tip"] = [0, 0, 0, 0, 1234, 40, 0, 0, 0]
    counters = Counter()
    return Eb90(counters=counters), registers, counters


def frames(line, registers, data, unit=1):
    return [reply.frame for reply in line.answers(data, 0, unit, registers)]


def test_nine_cells_of_a_fingertip(hand):
    line, registers, _ = hand
    expected = "90 EB 01 15 11 0E 10 00 00 00 00 00 00 00 00 D2 04 28 00 00 00 00 00 00 00 43"
    assert frames(line, registers, TIP) == [bytes.fromhex(expected)]
    assert request(1, READ, 4110, b"\x12") == TIP


def test_a_new_id_is_written(hand):
    line, registers, _ = hand
    written = bytes.fromhex("EB 90 01 04 12 E8 03 02 04")
    assert frames(line, registers, written) == [bytes.fromhex("90 EB 01 04 12 E8 03 01 03")]
    assert registers["id"] == 2


def test_a_save_is_answered_at_once_and_with_its_result_a_second_later(hand):
    line, registers, _ = hand
    assert line.answers(request(1, WRITE, 1005, b"\x01"), 0, 1, registers) == [
        Answer(bytes.fromhex("90 EB 01 04 12 ED 03 01 08")),
        Answer(bytes.fromhex("90 EB 01 04 12 ED 03 00 07"), delay_ns=SAVE_DELAY_NS),
    ]


def test_the_manual_s_request_for_six_angles_is_whole(hand):
    line, registers, _ = hand
    assert len(frames(line, registers, bytes.fromhex("EB 90 01 04 11 0A 06 0C 32"))[0]) == 20


@pytest.mark.parametrize(
    "data, counter",
    [
        (TIP[:-1] + b"\0", "bad_checksum"),
        (request(2, READ, 4110, b"\x12"), "other_unit"),
        (request(1, 0x13, 4110, b"\x12"), "unknown_command"),
        (request(1, READ, 4110, b"\x12\x00"), "unknown_command"),
        (request(1, READ, 4110, b"\xff"), "unknown_command"),
        (request(1, READ, 5999, b"\x02"), "refused"),
        (request(1, WRITE, 4110, b"\x02"), "refused"),
        (b"\xeb\x90\x01\x03", "bad_length"),
        (b"\x00\x01", "skipped_bytes"),
    ],
)
def test_everything_else_is_met_with_silence_and_counted(hand, data, counter):
    line, registers, counters = hand
    assert frames(line, registers, data) == []
    assert counters[counter] >= 1
    assert len(frames(line, registers, bytes(10) + TIP)) == 1


def test_byte_by_byte_and_across_a_file(hand):
    line, registers, _ = hand
    expected = frames(line, registers, TIP)
    assert [frame for byte in TIP for frame in frames(line, registers, bytes([byte]))] == expected
    frames(line, registers, TIP[:5])
    for other in (copy.deepcopy(line), restored(saved(line))):
        assert frames(other, registers, TIP[5:]) == expected
