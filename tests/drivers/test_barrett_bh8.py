"""cantools, with a DBC written from the published table, asks the pucks of a Barrett Hand for their cells."""

from pathlib import Path

import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("barrett_bh8", driver="cantools", carrier="CAN"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "barrett_bh8.dbc"


@pytest.mark.parametrize(("puck", "message", "patch"), [("00B", "finger_1", 0), ("00E", "palm", 3)])
def test_200_readings_of_every_cell(puck, message, patch):
    device = fp.create("barrett_bh8")
    device.receive(fp.CanFrame.parse("400#85000200"), 0, "")  # wakes all pucks
    ask = f"{puck}#EA0002000000"
    with Rig(device, kind="can", peak=1.9) as rig:
        got = run_driver("cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, ask, *[message] * 5, seconds=60)
    assert all([frame["sequence"] for frame in reading] == [0, 1, 2, 3, 4] for reading in got)
    values = [{name: value for frame in reading for name, value in frame.items()} for reading in got]
    cells = device.layout.patches[patch].taxels
    assert_consecutive(
        [[reading[f"cell_{k}"] for k in range(24)] for reading in values],
        rig.truth,
        decode=lambda counts: counts[cells] / 256,
    )
