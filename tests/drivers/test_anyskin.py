"""anyskin 1.0.0 and reskin-sensor 2.0.2, unmodified, read the AnySkin stream from a pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]
STALE = 40
"""Frames that the port may hold from before the driver was ready to read."""


@pytest.mark.parametrize("package", ["anyskin", "reskin_sensor"])
def test_200_consecutive_frames_float_for_float(package):
    device = fp.create("anyskin")
    device.period_ns = 5_000_000
    with Rig(device) as rig:
        got = run_driver(package, "anyskin_read.py", package, rig.port, STALE + 200, seconds=30)
    places = assert_consecutive(got["readings"][STALE:], rig.truth, decode=lambda counts: counts.reshape(-1))
    assert np.all(np.diff(places) == 1), "frames are missing between the first and the last"
