"""DSACON32m: messages, run lengths, one frame or many, what is refused."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

STOP, ONE = "aaaaaa030300000000 8d00", "aaaaaa030300800000 8d02"
PUSH, PUSH_CODED = "aaaaaa030300801e00 8e1c", "aaaaaa030300811e00 2c76"
DONE = bytes.fromhex("aaaaaa0302000000 4bb9")


def texels(message: bytes) -> list[int]:
    """Of a frame, by the rule of the library."""
    kind, size = struct.unpack_from("<BH", message, 3)
    assert kind == 0 and len(message) == size + 8
    units = struct.unpack(f"<{(size - 5) // 2}H", message[11:-2])
    return [unit & 0xFFF for unit in units for _ in range(unit >> 12)] if message[10] & 1 else list(units)


@pytest.mark.parametrize("seed", range(5))
def test_run_lengths_give_the_texels_back(seed):
    device = fp.create("weiss_dsacon32m")
    rng = np.random.default_rng(seed)
    counts = np.repeat(rng.integers(0, 4096, 486), rng.integers(1, 40, 486))[:486]
    assert send(device, PUSH_CODED) == [DONE]
    (frame,) = sample(device, counts / 1000)
    assert texels(frame) == counts.tolist()
    assert send(device, PUSH) == [DONE]
    assert texels(sample(device, counts / 1000)[0]) == counts.tolist()


def test_a_skin_that_nobody_touches_is_79_bytes():
    device = fp.create("weiss_dsacon32m")
    send(device, PUSH_CODED)
    assert len(sample(device)[0]) == 6 + 5 + 2 * 33 + 2


def test_one_frame_is_one_and_stop_is_none():
    device = fp.create("weiss_dsacon32m")
    assert sample(device) == []
    assert send(device, ONE) == [DONE]
    assert len(sample(device)) == 1 and sample(device) == []
    send(device, PUSH)
    assert len(sample(device)) == 1 == len(sample(device))
    assert send(device, STOP) == [DONE] and sample(device) == []


def request(device, name: str) -> list[bytes]:
    return send(device, next(command.request for command in device.commands if command.name == name))


@pytest.mark.parametrize(
    ("name", "error", "counter"),
    [
        ("matrix 6: no such", 24, "refused"),
        ("sensitivity 2: out of range", 27, "refused"),
        ("unknown id", 13, "unknown_command"),
        ("threshold, too short", 12, "bad_length"),
    ],
)
def test_what_is_wrong_is_answered_with_an_error(name, error, counter):
    device = fp.create("weiss_dsacon32m")
    (answer,) = request(device, name)
    assert answer[6:8] == bytes([error, 0]) and device.counters[counter] == 1


def test_a_wrong_sum_is_not_answered():
    device = fp.create("weiss_dsacon32m")
    assert send(device, "aaaaaa0b010006ffff") == [] and device.counters["bad_checksum"] == 1


def test_sensitivity_and_threshold_are_of_a_matrix_until_power_off():
    device = fp.create("weiss_dsacon32m")
    send(device, PUSH)
    request(device, "sensitivity 0.75 of matrix 4")
    request(device, "threshold 100 of all")
    (frame,) = sample(device, 0.08)
    of = np.repeat(range(6), [84, 78] * 3)
    assert texels(frame) == [120 if matrix == 4 else 0 for matrix in of]
    device.power_cycle()
    send(device, PUSH)
    assert texels(sample(device, 0.08)[0]) == [80] * 486


def test_what_is_kept_is_the_factory_s_from_then_on():
    device = fp.create("weiss_dsacon32m")
    assert request(device, "threshold 150 of matrix 1, kept") == []
    device.power_cycle()
    send(device, PUSH)
    assert texels(sample(device, 0.1)[0]) == [100] * 84 + [0] * 78 + [100] * 324
    request(device, "threshold 100 of all")
    send(device, "aaaaaa130400030000001a04")  # wrong sum: nothing
    assert texels(sample(device, 0.099)[0]) == [0] * 486


@pytest.mark.parametrize(("software", "frames"), [(290, 1), (288, 3), (269, 1), (268, 3)])
def test_an_old_release_streams_where_one_frame_is_asked_for(software, frames):
    device = fp.create("weiss_dsacon32m", software=software)
    send(device, ONE)
    assert sum(len(sample(device)) for _ in range(3)) == frames


def test_the_clock_rolls_over():
    device = fp.create("weiss_dsacon32m")
    send(device, PUSH)
    (frame,) = sample(device, t_ns=((1 << 32) + 5) * 1_000_000)
    assert struct.unpack_from("<I", frame, 6) == (5,)


def test_the_silence_after_power_up():
    device = fp.create("weiss_dsacon32m", mute_s=8.0)
    assert device.boot_s == 8.0 and device.boot(0) == [b"\x1b[5n"] * 3
