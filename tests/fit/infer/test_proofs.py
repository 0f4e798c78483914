"""What proves a field, and what only looks like a proof."""

import struct

import numpy as np

from firmware_protocols import sums
from tactemu.fit.infer.analysis import infer
from tactemu.fit.infer.floats import is_on_grid
from tests.fit.infer.captures import fields_at, slow, stream

N = 1500
HEAD = b"\xaa\x55"


def _drafted(bodies):
    framed = [HEAD + body for body in bodies]
    return infer(stream([body + struct.pack("<H", sums.crc16_modbus(body)) for body in framed]))


def test_floats_made_of_counts_are_certain_without_a_zero():
    columns = [slow(N, seed, low=100, high=3900) * 0.3 for seed in range(5)]
    draft = _drafted(struct.pack("<5f", *row) for row in zip(*columns))
    for k in range(5):
        (each,) = fields_at(draft, 2 + 4 * k)
        assert (each.size, each.kind, each.is_certain) == (4, "f", True), each


def test_a_grid_of_codes_is_no_grid_of_floats():
    counts = slow(N, 1, low=100, high=3900)
    assert is_on_grid(np.float32(counts * 0.3).astype(float), 4)
    codes = (0x42000000 + counts * 4096).astype("<u4")
    assert not is_on_grid(codes.view("<f4").astype(float), 4)


def test_noise_over_zero_proves_no_float_in_the_other_byte_order():
    rng = np.random.default_rng(3)
    columns = [0.02 * rng.standard_normal(N) for _ in range(6)]
    draft = _drafted(struct.pack("<6f", *row) for row in zip(*columns))
    for _, each in draft.fields:
        assert not (each.is_certain and each.kind == "f" and (each.order == ">" or (each.at - 2) % 4)), each


def test_an_array_foretells_bytes_that_took_few_values():
    columns = [slow(N, seed, high=255, noise=2.0) for seed in range(24)]
    for k in (7, 13):
        columns[k] = (np.arange(N) // 100 % 7 == 3).astype(int)
    draft = _drafted(bytes(map(int, row)) for row in zip(*columns))
    for k in range(24):
        (each,) = fields_at(draft, 2 + k)
        assert (each.size, each.is_certain) == (1, True), each
    assert "on either side of it" in fields_at(draft, 9)[0].why


def test_an_array_foretells_nothing_of_a_word_with_an_extended_sign_in_it():
    columns = [slow(N, seed, high=255, noise=2.0) for seed in range(24)]
    word = np.where(np.arange(N) // 100 % 7 == 3, -2, 1)
    columns[10], columns[11] = word & 0xFF, word >> 8 & 0xFF
    draft = _drafted(bytes(map(int, row)) for row in zip(*columns))
    assert not any(each.is_certain for at in (12, 13) for each in fields_at(draft, at))


def test_an_unsigned_column_beside_signed_ones_keeps_its_sign():
    """x, y, z with z above the middle in one place alone: the signs of x and y say nothing of it."""
    columns = []
    for k in range(48):
        high = 60 if k % 3 < 2 else 200 if k == 23 else 100
        columns.append(slow(N, k, low=-60 if k % 3 < 2 else 0, high=high, noise=2.0) & 0xFF)
    draft = _drafted(bytes(map(int, row)) for row in zip(*columns))
    (each,) = fields_at(draft, 2 + 23)
    assert each.kind == "u" and fields_at(draft, 2 + 21)[0].kind == "i"


def test_a_number_whose_lowest_four_bits_never_moved_is_not_certain():
    """It may be one of 12 bits beside those of another, which stayed small."""
    columns = [slow(N, seed, high=4000) << 4 for seed in range(4)]
    draft = _drafted(struct.pack(">4H", *row) for row in zip(*columns))
    for k in range(4):
        (each,) = fields_at(draft, 2 + 2 * k)
        assert each.size == 2 and not each.is_certain, each


def test_constants_that_differ_along_an_array_are_labels_and_leave_the_width_open():
    columns = [slow(N, seed, high=900) for seed in range(64)]
    draft = _drafted(
        b"".join(bytes([k % 8 + 1, k // 8 + 1]) + struct.pack(">H", value) for k, value in enumerate(row))
        for row in zip(*columns)
    )
    for k in range(64):
        (each,) = fields_at(draft, 2 + 4 * k + 2)
        assert (each.at, each.size, each.order) == (2 + 4 * k + 2, 2, ">"), each
        assert each.is_width_open and not each.is_certain


def test_the_head_is_no_upper_byte_of_the_command_behind_it():
    values = [slow(N, seed, low=-2000, high=2000) for seed in range(6)]
    commands = np.arange(N) // 40 % 19
    bodies = (struct.pack(">B6h", int(command), *row) for command, *row in zip(commands, *values))
    draft = infer(stream([body + struct.pack("<H", sums.crc16_modbus(body)) for body in (b"\x55" + b for b in bodies)]))
    (each,) = fields_at(draft, 1)
    assert (each.at, each.size, each.is_certain) == (1, 1, False), each


def test_a_clock_of_two_usual_steps_is_one_clock():
    rng = np.random.default_rng(1)
    ticks = np.cumsum(rng.choice([500, 600, 600], N))
    other = slow(N, 2)
    draft = _drafted(struct.pack(">HH", tick & 0xFFFF, value) for tick, value in zip(ticks.tolist(), other))
    (each,) = fields_at(draft, 2)
    assert (each.at, each.size, each.order, each.kind) == (2, 2, ">", "clock"), each


def test_a_counter_before_a_clock_that_seldom_wraps_is_no_part_of_it():
    clock = 8 * np.arange(N)
    draft = _drafted(struct.pack("<BI", k & 0xFF, int(t)) for k, t in enumerate(clock))
    assert not any(each.at < 3 < each.end for _, each in draft.fields)


def test_messages_that_are_sent_together_are_not_certainly_one():
    frames = [
        b"".join(bytes([k, *rng.integers(1, 255, 20), 0]) for k in (1, 2))
        for rng in map(np.random.default_rng, range(400))
    ]
    draft = infer(stream(frames))
    assert not draft.framing.is_certain and "several" in draft.framing.decide
