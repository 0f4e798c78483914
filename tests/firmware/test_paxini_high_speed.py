"""PaXini's high-speed board and ORCA's connector board: registers, pushes, errors, restarts, who it is."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Restart
from tests.firmware.feeding import sample, send


def request(function, register, count, data=b"") -> bytes:
    frame = b"\x55\xaa\x00" + bytes([function]) + register.to_bytes(2, "little") + count.to_bytes(2, "little") + data
    return frame + bytes([-sum(frame) & 0xFF])


def read(board, register, count) -> bytes:
    (reply,) = send(board, request(3, register, count))
    assert reply[3] == 3 and sum(reply) & 0xFF == 0
    return reply[8:-1]


def write(board, register, *data) -> list[bytes]:
    return send(board, request(0x10, register, len(data), bytes(data)))


@pytest.fixture
def board():
    return fp.create("paxini_high_speed", models=("M2020", "S1610"), places=(3, 27))


def test_registers_of_a_finger_and_of_the_palm(board):
    sample(board, np.arange(34) * 0.1)
    assert read(board, 0x10, 4) == bytes([0x08, 0, 0, 0x08])
    counts = read(board, 0x30, 56)
    assert (counts[6], counts[54], sum(counts)) == (9, 25, 34)
    assert list(read(board, 0x1000 + 3 * 0x200, 27)[2::3]) == list(range(9))
    assert list(read(board, 0x3800 + 7 * 0x100, 75)[2::3]) == list(range(9, 34))
    resultants = read(board, 0x500, 168)
    assert resultants[18:24] == bytes([0, 0, 0, 0, 36, 0]) and resultants[162:] == bytes([0, 0, 0, 0, 255, 255])
    assert read(board, 0x1000 + 3 * 0x200 - 2, 6) == bytes([0, 0, 0, 0, 0, 0]), "into a block from below"


def test_pushes_as_ordered(board):
    assert sample(board, 1.0) == []
    write(board, 0x16, 2, 1)
    (push,) = sample(board, 1.0)
    assert len(push) == 7 + 3 * 34 and push[:6] == bytes([0xAA, 0x56, 0, 103, 0, 0])
    write(board, 0x16, 0)
    assert sample(board)[0][3:5] == b"\x01\x00", "nothing but the error byte"
    write(board, 0x17, 0)
    assert sample(board) == []


def test_what_is_felt_is_zero_from_now_on(board):
    sample(board, 2.0)
    assert send(board, request(0x17, 2, 1, b"\x01"))[0][8] == 0
    sample(board, 3.0)
    assert set(board.counts[:, 2]) == {10} and read(board, 0x500 + 18, 6)[4] == 90


@pytest.mark.parametrize(
    ("frame", "code"),
    [(request(3, 0, 0), 0x81), (request(3, 0, 513), 0x81), (request(0x10, 0, 0), 0x81), (request(5, 0, 0), 0x83)],
)
def test_errors(board, frame, code):
    (reply,) = send(board, frame)
    assert reply[3] == code and reply[6:8] == b"\0\0"
    assert send(board, frame[:-1] + b"\x99") == [], "a bad sum"


def test_a_restart_comes_after_its_answer():
    board = fp.create("orca_touch")
    write(board, 0x17, 1)
    assert int.from_bytes(read(board, 0x6400, 4), "little") == 2
    frame, restart = board.receive(request(0x10, 0x22, 1, b"\x01"), 0, "")
    assert frame[8] == 0 and restart == Restart(delay_ns=50_000_000)
    board.power_cycle()
    assert not board.pushes and read(board, 0x6400, 4) == b"\x01\0\0\0"


@pytest.mark.parametrize("places", [(3,), (27, 3), (3, 28), (3, 3)])
def test_places_that_cannot_be(places):
    with pytest.raises(ValueError, match="paxini_high_speed"):
        fp.create("paxini_high_speed", models=("M2020", "S1610"), places=places)


def test_orca_says_who_it_is_whatever_else_is_said():
    board = fp.create("orca_touch", side="left")
    assert send(board, b"\x00ORCA_") == []
    assert send(board, b"ID?\nORCA_ID?\nORCA_") == [b"ORCA:SENSOR\n"] * 2
    (info,) = send(board, b"INFO?\n")
    assert info.startswith(b"ORCA:SENSOR;SIDE=L;") and info.endswith(b"\n")
    assert board.counters["skipped_bytes"] == 1, "what is no text and no packet"
    assert send(board, b"ORCA_XX?\n") == []


def test_orca_is_found_by_its_usb_ids():
    (port,) = fp.create("orca_touch", serial="OH-7").ports
    assert (port.usb.vid, port.usb.pid, port.usb.serial, port.is_cdc) == (0x2F5D, 0x2202, "OH-7", True)


def test_orca_zeroes_single_fingertips():
    board = fp.create("orca_touch")
    sample(board, 1.0)
    assert read(board, 0x6120, 16) == bytes(16)
    write(board, 0x6110, *b"\x04ZR", 0b00101)
    assert read(board, 0x6120, 16) == bytes([2, 3, 1]) + bytes(13)
    by_finger = [board.counts[patch.taxels, 2].any() for patch in board.layout.patches]
    assert by_finger == [False, True, False, True, True]
    write(board, 0x6110, *b"\x04ZX", 0b11111)
    assert read(board, 0x6120, 3) == bytes([2, 3, 1]), "the key is wrong"


def test_orca_s_taxels_are_where_its_tables_say():
    layout = fp.create("orca_touch").layout
    thumb = layout.positions[:51] * 1e3
    assert np.allclose(thumb[0], [-9.99, -1.0, 0.84]) and np.allclose(
        layout.normals[0], [-0.831, -0.052, 0.554], atol=1e-3
    )
    assert thumb[:, 1].max() == pytest.approx(17.62) and layout.positions[51:138, 2].max() == pytest.approx(0.01276)
