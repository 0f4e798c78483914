"""anyskin 1.0.0 and reskin-sensor 2.0.2, unmodified, read the AnySkin stream from a pty."""

import threading

import numpy as np
import pytest

import firmware_protocols as fp
import tactemu
from tests.drivers.rig import EQUAL, Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]
STALE = 50
"""Frames that the port may hold from before the driver was ready to read."""


CARRIER = "USB serial, floats"


@pytest.mark.judge("anyskin", driver="package", carrier=CARRIER)
@pytest.mark.parametrize("package", ["anyskin", "reskin_sensor"])
def test_200_consecutive_frames_float_for_float(package):
    device = fp.create("anyskin")
    device.period_ns = 8_000_000
    with Rig(device) as rig:
        got = run_driver(package, "anyskin_read.py", package, rig.port, STALE + 200, seconds=30)
    places = assert_consecutive(got["readings"][STALE:], rig.truth, decode=lambda counts: counts.reshape(-1))
    assert np.all(np.diff(places) == 1), "frames are missing between the first and the last"


@pytest.mark.judge("anyskin", driver="anyskin", carrier=CARRIER, every_run=True)
def test_a_press_reaches_the_driver_as_it_was_felt():
    """Simulation, device, wire and pty, with a press in the middle of what the driver reads."""
    with tactemu.serve("anyskin", rate_hz=200) as dev:
        done = threading.Event()
        presses = threading.Thread(target=_press_until, args=(dev, done))
        presses.start()
        try:
            got = run_driver("anyskin", "anyskin_read.py", "anyskin", dev.port, STALE + 200, seconds=30)
        finally:
            done.set()
            presses.join()
        truth = [sample.counts for sample in dev.truth.samples]
    readings = np.array(got["readings"][STALE:])
    spelled = {counts.astype(float).tobytes() for counts in truth}
    assert len(readings) == 200 and all(reading.tobytes() in spelled for reading in readings)
    EQUAL.append(len(readings))
    fields = readings.reshape(200, 5, 4)[:, :, 1:]
    assert np.ptp(fields[:, 0, 2]) > 20, "the chip in the middle feels the press"


def _press_until(dev, done: threading.Event) -> None:
    while not done.is_set():
        dev.press(depth=1e-3, dwell=0.1, taxel=0, speed=0.1)
