"""Tests of a driver with the pytest plugin: ``python -m pytest examples/test_my_driver.py``.

``SkinDriver`` stands for your driver: it reads AnySkin frames from a serial port and counts the frames it discards.
The tests wait for events instead of a fixed time, so that they also pass on a busy machine.
"""

from __future__ import annotations

import struct
import time

import serial


class SkinDriver:
    """A driver that reads frames of five chips (T Bx By Bz each, float32, then CR LF) and reopens a lost port."""

    SIZE = 82

    def __init__(self, path: str):
        self.path, self.buffer, self.lost_frames, self.reconnects = path, b"", 0, 0
        self.port = serial.Serial(path, 115200, timeout=0.05)

    def read(self, seconds: float) -> list[tuple[float, ...]]:
        """Return the frames that arrive within this time."""
        frames, end = [], time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                self.buffer += self.port.read(self.SIZE)
            except (serial.SerialException, OSError):
                self._reconnect()
            frames += self._parse()
        return frames

    def _parse(self) -> list[tuple[float, ...]]:
        found = []
        while len(self.buffer) >= self.SIZE:
            if self.buffer[self.SIZE - 2 : self.SIZE] == b"\r\n":
                found.append(struct.unpack("<20f", self.buffer[: self.SIZE - 2]))
                self.buffer = self.buffer[self.SIZE :]
            elif (end := self.buffer.find(b"\r\n")) >= 0:  # out of step: continue after the next end of a frame
                self.buffer = self.buffer[end + 2 :]
                self.lost_frames += 1
            else:
                break
        return found

    def _reconnect(self) -> None:
        self.port.close()
        self.buffer = b""
        give_up = time.monotonic() + 5
        while not self.port.is_open:
            try:
                self.port = serial.Serial(self.path, 115200, timeout=0.05)
            except serial.SerialException:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.005)
        self.reconnects += 1


def bz(frame: tuple[float, ...], chip: int) -> float:
    """Return the field along the normal of one chip [µT]."""
    return frame[4 * chip + 3]


def read_until(driver: SkinDriver, happened, at_most: float = 10) -> list[tuple[float, ...]]:
    """Read until ``happened(frames)`` is true; fail after ``at_most`` seconds."""
    frames, end = [], time.monotonic() + at_most
    while not happened(frames):
        assert time.monotonic() < end, f"still waiting after {at_most} s and {len(frames)} frames"
        frames += driver.read(0.05)
    return frames


def latest(driver: SkinDriver) -> tuple[float, ...]:
    """Return a frame that arrived after those that the port had already buffered."""
    driver.read(0.1)
    return read_until(driver, len)[-1]


def test_it_sees_the_press_where_it_is(tactile_device):
    with tactile_device("anyskin", rate_hz=200) as dev:
        driver = SkinDriver(dev.port)
        rest = latest(driver)
        dev.press(depth=1e-3, taxel=3)
        pressed = latest(driver)
        change = [abs(bz(pressed, chip) - bz(rest, chip)) for chip in range(5)]
        assert change.index(max(change)) == 3
        driver.port.close()


def test_it_counts_what_was_truncated(tactile_device):
    with tactile_device("anyskin", rate_hz=200, faults=["truncate every 20"], seed=7) as dev:
        driver = SkinDriver(dev.port)
        read_until(driver, lambda _: dev.truth.injected["truncate"] >= 9)
        truncated = dev.truth.injected["truncate"]
        assert abs(driver.lost_frames - truncated) <= 1  # the last one may not have arrived yet
        driver.port.close()


def test_it_comes_back_after_unplugging(tactile_device):
    with tactile_device("anyskin", rate_hz=200) as dev:
        driver = SkinDriver(dev.port)
        read_until(driver, len)
        dev.inject_event(fault="unplug for 0.3s")
        read_until(driver, lambda _: driver.reconnects)
        read_until(driver, lambda frames: len(frames) > 80)
        assert driver.reconnects == 1
        driver.port.close()
