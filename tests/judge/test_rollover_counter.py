"""Tests of rollover counters: one that a driver has set back comes near its rollover; a reset is no rollover."""

import threading
import time
from types import SimpleNamespace

import pytest

from firmware_protocols.senses import Rollover
from tactemu.judge.rollover_counter import MAX_JUMP_DIVISOR, RolloverCounter

SPEED = 500.0


class Counting:
    """A device whose counter advances at a speed, which may be 0."""

    def __init__(self, bits, speed=SPEED, value=0):
        self.rollovers = (Rollover(name="sequence", bits=bits, state="sequence"),)
        self.speed, self.size = speed, 1 << bits
        self.presets = []
        self.begin(value)

    def begin(self, value):
        self._value, self._since = value, time.monotonic()

    @property
    def sequence(self):
        return (self._value + int(self.speed * (time.monotonic() - self._since))) % self.size

    def preset(self, name, value):
        self.presets.append((self.sequence, value))
        self.begin(value)


def counter_of(device):
    emulator = SimpleNamespace(channels=[SimpleNamespace(device=device)], now_ns=0)
    return RolloverCounter(
        SimpleNamespace(emulator=emulator, do=lambda action: action(), period_s=1 / SPEED), "sequence"
    )


@pytest.mark.parametrize("bits", [8, 16, 32, 63])
def test_a_counter_that_was_set_back_is_brought_near_its_end_by_jumps_forward(bits):
    device = Counting(bits)
    counter = counter_of(device)
    assert counter.bring_near(0.2, 0.4) == ""
    for before, after in device.presets:
        assert 0 < (after - before) % device.size <= device.size // MAX_JUMP_DIVISOR
    before, after = counter.wait_until_full(lambda: True, 30.0)
    assert after < device.size // MAX_JUMP_DIVISOR < before


def test_a_counter_that_is_near_its_end_is_left_alone():
    device = Counting(32, value=(1 << 32) - 400)
    assert counter_of(device).bring_near(0.1, 3.0) == "" and not device.presets


def test_a_counter_that_stands_still_is_said():
    assert "does not advance" in counter_of(Counting(32, speed=0.0)).bring_near(0.2, 0.4)


def test_a_counter_that_is_set_back_has_not_been_full():
    device = Counting(32, value=5_000_000)
    timer = threading.Timer(0.1, lambda: device.begin(0))
    timer.start()
    assert counter_of(device).wait_until_full(lambda: True, 0.3) is None
    timer.join()


def test_a_clock_is_set_by_what_is_added_to_its_time():
    device = SimpleNamespace(rollovers=(Rollover(name="tick", bits=16, step=1000, clock=True, state="tick"),), tick=0)
    device.preset = lambda name, value: setattr(device, name, value)
    channel = SimpleNamespace(device=device, local_ns=lambda now: now)
    rig = SimpleNamespace(
        emulator=SimpleNamespace(channels=[channel], now_ns=3_000_000_000), do=lambda action: action(), period_s=0.01
    )
    counter = RolloverCounter(rig, "tick")
    assert counter.value == 3000
    counter.set_ahead(2.0)
    assert counter.value == (1 << 16) - 2000
