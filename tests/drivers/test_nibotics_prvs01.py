"""nibotics-hand 0.1.0, unmodified, reads the hand from a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.timeout(90),
    pytest.mark.judge("nibotics_prvs01", driver="nibotics-hand", carrier="serial, packets"),
]


@pytest.mark.parametrize("channels", [24, 19])
def test_200_readings(channels):
    device = fp.create("nibotics_prvs01", channels=channels)
    with Rig(device) as rig:
        got = run_driver("nibotics", "nibotics_read.py", rig.port)
    places = assert_consecutive(got["many"], rig.truth, decode=lambda counts: counts[:15])
    assert len(set(places)) > 150, "the hand converted in between"
    assert got["positions"]["index"] == 1234 and sum(got["positions"].values()) == 1234
    assert got["accel"] == {"x": 0, "y": 0, "z": 4096} and got["gyro"] == {"x": 0, "y": 0, "z": 0}
    assert got["mics"]["thumb_radial_extension"] == [2048, 2048] and got["warm"] == [25.0] * 3
    assert device.counters["requests"] == 1
