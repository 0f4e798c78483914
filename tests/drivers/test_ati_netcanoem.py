"""cantools, with a DBC written from captured frames, asks a NETCANOEM for its gauges."""

from pathlib import Path

import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("ati_netcanoem", driver="cantools", carrier="CAN"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "ati_netcanoem.dbc"


def test_200_readings_of_the_gauges():
    with Rig(fp.create("ati_netcanoem", base=0x7F), kind="can", peak=100.0) as rig:
        got = run_driver(
            "cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, "7F0#", "first", "second", seconds=60
        )
    assert {first["status"] for first, _ in got} == {0}
    gauges = [[(first | second)[f"gauge_{k}"] for k in range(6)] for first, second in got]
    assert_consecutive(gauges, rig.truth, decode=lambda counts: counts[0])
