"""A driver of the index reads the forces of a ROHand's fingers."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("rohand", driver="unienv-rohand", environment="rohand", carrier="RS-485, Modbus"),
    pytest.mark.timeout(90),
]


def test_unienv_rohand():
    """It reads six forces where there are five: the last is the first one's speed."""
    device = fp.create("rohand", touch="finger")
    device.period_ns = 2_000_000
    with Rig(device, peak=3.0) as rig:
        got = run_driver("unienv_rohand", "unienv_rohand_read.py", rig.port, environment="rohand")
    assert_consecutive([forces[:5] for forces in got["many"]], rig.truth)
    assert all(forces[5] == 65535 for forces in got["many"])
    assert np.allclose(got["opened"], [36.7, 178.37, 176.06, 176.56, 174.86, 0], atol=0.01)
    assert np.allclose(got["closed"], [2.26, 100.22, 97.81, 101.38, 98.84, 89.98], atol=0.01)
    assert np.allclose(np.rad2deg(got["seen"]["joint_angles"]), [20, 150, 140, 130, 120, 45], atol=0.01)
    assert got["moving"] == [1] * 6 and got["seen"]["joint_currents"] == [0] * 6
