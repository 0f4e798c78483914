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


def test_what_is_not_answered():
    device = fp.create("weiss_dsacon32m")
    assert send(device, "aaaaaa0b0100060d9b") == [] and device.counters["refused"] == 1
    assert send(device, "aaaaaa0b010006ffff") == [] and device.counters["bad_checksum"] == 1
    assert send(device, "aaaaaa7f0000") == [] and device.counters["unknown_command"] == 1


def test_the_clock_rolls_over():
    device = fp.create("weiss_dsacon32m")
    send(device, PUSH)
    (frame,) = sample(device, t_ns=((1 << 32) + 5) * 1_000_000)
    assert struct.unpack_from("<I", frame, 6) == (5,)


def test_the_silence_after_power_up():
    device = fp.create("weiss_dsacon32m", mute_s=8.0)
    assert device.boot_s == 8.0 and device.boot(0) == [b"\x1b[5n"]
