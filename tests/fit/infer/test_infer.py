"""What an inference finds in captures of which every byte is known, and what it must not say."""

import struct

import numpy as np
import pytest

from firmware_protocols import Stuffing, cobs, sums
from tactemu.fit.infer.analysis import families_of, infer
from tactemu.fit.infer.captures import Chunk
from tests.fit.infer.captures import dialogue, fields_at, slow, stream

N = 1500
HEAD = b"\xaa\x55"


def _values(letter="H", count=6, order="<", **options):
    columns = [slow(N, seed, **options) for seed in range(count)]
    return [struct.pack(f"{order}{count}{letter}", *row) for row in zip(*columns)]


def _with_crc(body):
    return body + struct.pack("<H", sums.crc16_modbus(body))


@pytest.mark.parametrize(("letter", "order", "size"), [("H", "<", 2), ("H", ">", 2), ("B", "", 1)])
def test_unsigned_values_with_a_crc_are_certain(letter, order, size):
    low, high = (0, 255) if size == 1 else (0x7800, 0x8800)
    body = _values(letter, order=order or "<", low=low, high=high, noise=2.0 if size == 1 else 6.0)
    draft = infer(stream([_with_crc(HEAD + part) for part in body]))
    assert draft.framing.is_certain
    assert draft.framing.sum is not None and draft.framing.sum.kit_name == "crc16_modbus"
    for k in range(6):
        (each,) = fields_at(draft, 2 + k * size)
        assert (each.size, each.order, each.kind) == (size, order, "u")
        assert each.is_certain, each


@pytest.mark.parametrize(("letter", "order"), [("h", "<"), ("h", ">")])
def test_signed_values_are_certain_where_they_cross_zero(letter, order):
    body = _values(letter, order=order, low=-2000, high=2000)
    draft = infer(stream([_with_crc(HEAD + part) for part in body]))
    for k in range(6):
        (each,) = fields_at(draft, 2 + 2 * k)
        assert (each.size, each.order, each.kind, each.is_certain) == (2, order, "i", True)


def test_floats_that_cross_zero_are_certain():
    columns = [slow(N, seed, low=-3000, high=3000) / 97 for seed in range(4)]
    frames = [_with_crc(HEAD + struct.pack("<4f", *row)) for row in zip(*columns)]
    draft = infer(stream(frames))
    for k in range(4):
        (each,) = fields_at(draft, 2 + 4 * k)
        assert (each.size, each.kind, each.is_certain) == (4, "f", True)


def test_a_width_that_the_capture_cannot_show_is_not_certain():
    columns = [slow(N, seed, high=3000) for seed in range(2)]
    frames = [_with_crc(HEAD + struct.pack("<2I", *row)) for row in zip(*columns)]
    draft = infer(stream(frames))
    for at in (2, 6):
        (each,) = fields_at(draft, at)
        assert each.is_width_open and not each.is_certain
        assert "full scale" in each.decide


def test_a_clipped_value_that_leaps_is_not_certainly_signed():
    rng = np.random.default_rng(2)
    columns = [np.where(rng.random(N) < 0.3, 255, rng.integers(0, 3, N)) for _ in range(4)]
    draft = infer(stream([HEAD + bytes(row) + bytes([sum(row) & 0xFF]) for row in zip(*[c.tolist() for c in columns])]))
    for group in draft.groups:
        assert not any(each.is_certain and each.kind == "i" for each in group.fields)


def test_values_of_twelve_bits_are_found():
    columns = [slow(N, seed) for seed in range(8)]
    frames = []
    for row in zip(*[column.tolist() for column in columns]):
        number = sum(value << 12 * k for k, value in enumerate(row))
        frames.append(_with_crc(HEAD + number.to_bytes(12, "little")))
    draft = infer(stream(frames))
    found = [each for group in draft.groups for each in group.fields if each.width == 12]
    assert [(each.at, each.shift, each.order) for each in found] == [
        (at, shift, "<") for k in range(4) for at, shift in ((2 + 3 * k, 0), (3 + 3 * k, 4))
    ]
    assert all(each.is_certain for each in found)


def test_a_clock_with_a_common_factor_is_one_clock():
    """The low byte of microseconds in steps of 10 ms steps evenly: it is no counter of its own."""
    values = _values()
    frames = [_with_crc(HEAD + struct.pack("<I", 123456 + 10000 * k) + part) for k, part in enumerate(values)]
    draft = infer(stream(frames))
    (clock,) = fields_at(draft, 2)
    assert clock.kind == "clock" and clock.order == "<"
    assert not any(each.is_certain and each.kind == "counter" for _, each in draft.fields)


def test_a_length_field_is_found_and_its_sum():
    long, short = _values(count=6), _values(count=2)
    frames = []
    for k in range(N):
        body = long[k] if k % 3 else short[k]
        part = HEAD + struct.pack("<H", len(body)) + body
        frames.append(part + bytes([-sum(part) & 0xFF]))
    draft = infer(stream(frames, times=False))
    assert draft.framing.kind == "length" and draft.framing.is_certain
    assert draft.framing.sum is not None and draft.framing.sum.kit_name == "lrc8"
    assert {group.length for group in draft.groups} == {9, 17}


def test_cobs_is_found():
    draft = infer(stream([cobs(HEAD + part) for part in _values()]))
    assert draft.framing.kind == "COBS" and draft.framing.is_certain


def test_a_stuffing_of_no_standard_is_found():
    stuffing = Stuffing(head=b"[", tail=b"]", escape=b"\\", codes={b"[": b"{", b"]": b"}", b"\\": b"|"})
    bodies = _values("B", 20, "<", high=200, noise=2.0)
    draft = infer(stream([stuffing.wrap(part) for part in bodies], times=False))
    assert draft.framing.coding is not None and draft.framing.coding.stuffing == stuffing
    assert [each.data for each in draft.framing.messages] == bodies[1:]
    assert all(each.is_certain for _, each in draft.fields)


def test_a_line_end_ends_binary_messages():
    draft = infer(stream([part + b"\r\n" for part in _values()], times=False))
    assert all(each.data.endswith(b"\r\n") for each in draft.framing.messages) and not draft.framing.is_certain


def test_answers_between_messages_of_one_length_are_found_without_times():
    frames = []
    for k, part in enumerate(_values()):
        frames.append(_with_crc(b"\xaa\x56" + part))
        if k % 20 == 7:
            frames.append(_with_crc(b"\xaa\x55" + bytes([k // 20 % 3 + 3]) + part[: k // 20 % 3 + 3]))
    draft = infer(stream(frames, times=False))
    assert sorted({len(each.data) for each in draft.framing.messages}) == [8, 9, 10, 16]


def test_lines_of_text_are_found():
    frames = [b"F %d %d\r\n" % (k % 100, -k) for k in range(100)]
    draft = infer(stream(frames))
    assert draft.framing.kind == "text"
    assert draft.framing.shapes[0].literals == (b"F ", b" ", b"")


def test_without_times_or_sum_the_beginning_of_a_message_is_not_certain():
    draft = infer(stream([part + b"\r\n" for part in _values()], times=False))
    assert draft.framing.kind == "fixed" and draft.framing.cut is not None and draft.framing.cut.size == 14
    assert not draft.framing.is_certain
    assert not any(each.is_certain for _, each in draft.fields if each.kind != "sum")


def test_modbus_reads_are_recognised_and_paired():
    pairs = []
    for k, part in enumerate(_values(order=">", count=4)):
        register = (100, 200)[k % 2]
        question = _with_crc(struct.pack(">BBHH", 1, 4, register, 4))
        pairs.append((question, _with_crc(bytes([1, 4, 8]) + part)))
    draft = infer(dialogue(pairs))
    assert [(read.address, read.count) for read in draft.reads] == [(100, 4), (200, 4)]
    assert [(pair.question, pair.answer) for pair in draft.pairs] == pairs
    assert all(each.order == ">" for each in fields_at(draft, 3))


def test_an_answer_of_several_messages_is_cut_by_their_lengths():
    messages = []
    for k, part in enumerate(_values("B", 8, high=250, noise=2.0)):
        body = b"\x03\x26" + bytes([4 + k % 5]) + part[: 4 + k % 5]
        messages.append(body + bytes([sum(body) & 0xFF]))
    answers = [b"".join(messages[at : at + 1 + at // 3 % 4]) for at in range(0, N - 4, 3)]
    draft = infer(dialogue([(b"\x81\x26", answer) for answer in answers]))
    assert {group.length for group in draft.groups} == set(range(8, 13))
    assert draft.framing.sum is not None and draft.framing.sum.kit_name == "sum8"
    assert [pair.answer for pair in draft.pairs] == answers


def test_a_byte_of_a_can_frame_selects_the_others():
    columns = [slow(N, seed, high=255, noise=2.0) for seed in range(14)]
    chunks = []
    for k in range(N):
        for row in range(2):
            data = bytes([0xB1 + row, *(int(columns[7 * row + j][k]) for j in range(7))])
            chunks.append(Chunk(k * 10_000_000 + row * 1000, "tx", data, id=0x28))
    draft = infer(chunks)
    assert [group.selectors[0][0] for group in draft.groups] == [0xB1, 0xB2]
    assert all(each.kind == "u" and each.size == 1 for _, each in draft.fields if each.at)


def test_the_low_byte_of_a_motion_that_repeats_selects_nothing():
    values = np.random.default_rng(1).permutation(256)[:40]  # the low bytes of a finger's position, which moves 7 times
    columns = [slow(7 * 40, seed, high=255, noise=2.0) for seed in range(6)]
    chunks = []
    for k in range(7 * 40):
        data = bytes([0x40, int(values[k % 40]), *(int(column[k]) for column in columns)])
        chunks.append(Chunk(k * 10_000_000, "tx", data, id=0x28))
    assert [group.selectors for group in infer(chunks).groups] == [{}]


def test_the_low_byte_of_a_number_in_steps_of_16_selects_nothing():
    noise = np.random.default_rng(1).normal((100, 200, 16_000), 80.0, (2 * N, 3))  # an accelerometer at rest
    chunks = [
        Chunk(k * 10_000_000, "tx", struct.pack("<3h", *(row // 16 * 16).astype(int)), id=0x28)
        for k, row in enumerate(noise)
    ]
    draft = infer(chunks)
    assert [group.selectors for group in draft.groups] == [{}]
    assert not any(each.is_certain and each.size == 1 for _, each in draft.fields)


def test_families_of_identifiers():
    assert families_of([0x10, 0x11, 0x12, 0x13, 0x40, 0x44, 0x48, 0x300]) == [(0x10, 1, 4), (0x40, 4, 3), (0x300, 0, 1)]


def test_two_short_real_captures_say_nothing_certain(tmp_path):
    """Shorter than anything can be proven from: an OptoForce with losses, and an ATI Net CAN OEM."""
    packet = bytes.fromhex("aa07081023 1b0000ff050025fe520060fc6300060545".replace(" ", ""))
    draft = infer([Chunk(None, "tx", packet * 5 + packet[3:] + packet[:9])])
    assert not any(each.is_certain for _, each in draft.fields)
    frames = [(0x7F2, "3F40256AC1DAD5F4"), (0x7F3, "3FF85F58C1CCED0E"), (0x7F0, ""), (0x7F1, "04FAFA930143")]
    draft = infer([Chunk(None, "tx", bytes.fromhex(data), id=identifier) for identifier, data in frames])
    assert not draft.fields
