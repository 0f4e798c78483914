"""cantools, with a DBC written from the published tables, reads both generations of the uSkin from a bus."""

from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver
from tests.firmware.feeding import send

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("xela_uskin", "xela_uskin_4x6", driver="cantools", carrier="CAN"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "xela_uskin.dbc"
BOARD = [f"board_{taxel:02d}" for taxel in range(16)]
GRID = [f"grid_{row}_{column}" for column in range(6) for row in range(4)]


@pytest.mark.parametrize(("name", "messages"), [("xela_uskin", BOARD), ("xela_uskin_4x6", GRID)])
def test_200_readings_of_every_taxel(name, messages):
    device = fp.create(name)
    send(device, "201#0700")
    with Rig(device, kind="can") as rig:
        got = run_driver("cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, 0, *messages, seconds=60)
    readings = np.array([[[taxel[axis] for axis in "XYZ"] for taxel in reading] for reading in got])
    assert readings[..., 2].std() > 1000
    assert_consecutive(readings, rig.truth, decode=lambda counts: counts[device.layout.wire_order])
