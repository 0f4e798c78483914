"""paxini-sdk 0.1.0, unmodified, reads a GEN3 board from a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("paxini_px6ax", driver="paxini-sdk", carrier="serial, packets"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]


def test_200_readings():
    with Rig(fp.create("paxini_px6ax")) as rig:
        got = run_driver("paxini_sdk", "paxini_sdk_read.py", rig.port)
    places = assert_consecutive(got["many"], rig.truth)
    assert len(set(places)) > 20, "the board converted in between"
    assert got["resultant"][2] == 255, "31 taxels that feel 1.5 N each are more than a byte holds"
    assert rig.device.counters["refused"] == 0
    assert rig.device.zero.any(), "calibrated"
