"""dynamixel-sdk 4.1.0, unmodified, reads the HX5-D20 hand from a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("robotis_hx5", driver="dynamixel-sdk", carrier="RS-485, Dynamixel", every_run=True),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]


def test_200_readings():
    device = fp.create("robotis_hx5")
    device.period_ns = 2_000_000
    with Rig(device, peak=6.0) as rig:
        got = run_driver("dynamixel_sdk", "dynamixel_read.py", rig.port)
    places = assert_consecutive(got["many"], rig.truth)
    assert len(set(places)) > 20, "the hand converted in between"
    assert got["model"] == 260 and got["found"] == list(range(110, 136))
    assert got["position"] == 3000 and got["refused"] == 7
    assert device.counters["bad_checksum"] == 0
