"""PaXini's high-speed board and ORCA Touch on a bare pty: paxini-sdk 0.1.0 and orca-core 0.12.0, unmodified."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(180)]


@pytest.mark.judge("paxini_high_speed", driver="paxini-sdk", carrier="serial, packets")
def test_paxini_sdk_reads_200_pushes():
    device = fp.create("paxini_high_speed", models=("S2015", "S1813E"), places=(10, 18))
    with Rig(device, peak=2.0) as rig:
        got = run_driver("paxini_sdk", "paxini_high_speed_read.py", rig.port)
    places = assert_consecutive(got["many"], rig.truth)
    assert len(set(places)) == 200, "one push for each conversion"
    for place, resultants in zip(places, got["resultants"]):
        sums = [rig.truth[place][part].sum(0) for part in (slice(52), slice(52, 83))]
        assert np.abs(np.array(resultants) - np.minimum(sums, 255)).max() <= 26, "rounded once, not taxel by taxel"
    assert got["version"] == "PX-HS V1.0" and got["modules"] == [10, 18]
    assert got["names"] == ["Middle-Tip", "Little-Tip"]
    assert device.zero.any() and not device.pushes and device.counters["refused"] == 0


@pytest.mark.judge("orca_touch", driver="orca-core", environment="orca_core", carrier="serial, packets")
def test_orca_core_reads_200_pushes():
    device = fp.create("orca_touch", side="left", serial="OH-7")
    with Rig(device, peak=2.0) as rig:
        got = run_driver("orca_core", "orca_touch_read.py", rig.port, seconds=120, environment="orca_core")
    assert_consecutive(got["many"], rig.truth)
    assert got["info"] == ["sensor", "left", "OH-7"] and "1.0" in got["version"]
    assert got["taxels"] == {"thumb": 51, "index": 87, "middle": 87, "ring": 87, "pinky": 51}
    assert got["zero"] == dict.fromkeys(got["taxels"], 0) and got["bad"] == 0
    assert device.counters["refused"] == device.counters["bad_checksum"] == 0
