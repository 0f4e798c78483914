"""cantools, with a DBC written from the published table, reads a CPM-Finger from a bus."""

from pathlib import Path

import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("cyskin_cpm_finger", driver="cantools", carrier="CAN"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "cyskin_cpm_finger.dbc"
FRAMES = [*(f"four_{k}" for k in range(4)), "near"]


def test_200_scans():
    with Rig(fp.create("cyskin_cpm_finger"), kind="can") as rig:
        got = run_driver("cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, 0, *FRAMES, seconds=60)
    scans = [{name: value for message in scan for name, value in message.items()} for scan in got]
    assert_consecutive([[scan[f"taxel_{k}"] for k in range(16)] for scan in scans], rig.truth)
    assert {scan["second"] for scan in scans} == {0xFFFF}
