"""cantools, with a DBC written from the vendor's table, reads the channels of an Allegro V5 Sense from a bus."""

from pathlib import Path

import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("allegro_v5_sense", driver="cantools", carrier="CAN"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "allegro_v5_sense.dbc"


def test_200_readings_of_every_channel():
    with Rig(fp.create("allegro_v5_sense"), kind="can", peak=10.0) as rig:
        got = run_driver(
            "cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, 0, "touch_0", "touch_1", seconds=60
        )
    channels = [[(low | high)[f"channel_{k}"] for k in range(16)] for low, high in got]
    assert_consecutive(channels, rig.truth, decode=lambda counts: 4 * counts)
