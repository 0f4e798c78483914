"""tactile-pressure-sdk 2.0.0, unmodified, reads the module from a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.timeout(90),
    pytest.mark.judge("synria_60", driver="tactile-pressure-sdk", carrier="RS-485, Modbus"),
]


def test_200_readings():
    device = fp.create("synria_60")
    device.period_ns = 1_000_000  # 220 answers take some 80 ms
    with Rig(device, peak=45.0) as rig:
        got = run_driver("tactile_sdk", "synria_read.py", rig.port)
    places = assert_consecutive(got["many"], rig.truth)
    assert len(set(places)) > 20, "the module converted in between"
    assert got["info"]["device_model"] == "ST-00-01" and got["info"]["app_version"] == "v1.0.1"
    assert (got["points"], got["area"]) == (60, pytest.approx(25.0))
    assert max(got["newtons"]) > 30_000, "mN"
    assert got["address"] == 7 and device.flash["unit"] == [7]
    assert got["write_only"] is None and got["mode"] == 101
    assert device.zero.any() and device.counters["refused"] == 1
