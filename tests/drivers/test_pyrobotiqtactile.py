"""pyrobotiqtactile 0.1.2, unmodified, reads the TSF-85 from a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("robotiq_tsf85", driver="pyrobotiqtactile", carrier="USB serial, packets"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]


@pytest.mark.parametrize(
    ("options", "mode"),
    [({}, "sync"), ({"packets": "per_finger"}, "async"), ({"magnetometer": True}, "sync")],
    ids=["one packet", "packet per finger", "magnetometer"],
)
def test_200_readings(options, mode):
    with Rig(fp.create("robotiq_tsf85", **options)) as rig:
        got = run_driver("pyrobotiqtactile", "pyrobotiqtactile_read.py", rig.port, 10, mode)
    # get_version() returns whatever has arrived at its first look, often only the first byte.
    assert got["version"] and "9a00e305312e312e38".startswith(got["version"])
    readings = got["readings"]
    places = assert_consecutive([r["pressure"] for r in readings], rig.truth)
    for place, reading in zip(places, readings):
        assert reading["timestamp"] == [rig.sampled_ns[place] // 1000] * 2
        assert reading["accelerometer"] == [[0, 0, 16384]] * 2 and reading["temperature"] == [2500] * 2
