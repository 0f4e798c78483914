"""cantools, with a DBC written from the published table, reads what the boards of a DexHand021 send over CAN-FD."""

from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.driver,
    pytest.mark.judge("dexrobot_dexhand", driver="cantools", carrier="CAN-FD"),
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "dexrobot_dexhand.dbc"
FINGERS = ("thumb", "index", "middle", "ring", "little")


def test_200_readings_of_every_fingertip():
    with Rig(fp.create("dexrobot_dexhand"), kind="can", peak=30.0) as rig:
        got = run_driver("cantools", "cantools_read.py", DBC, rig.port, INTERFACE, 200, 0, *FINGERS, seconds=60)
    assert np.std([reading[0]["normal"] for reading in got]) > 5
    for finger in range(5):
        names = ("normal", "tangential", "direction", "temperature")
        assert_consecutive(
            [[reading[finger][name] for name in names] for reading in got],
            [counts.item() for counts in rig.truth],
            decode=lambda counts, finger=finger: [*counts["force"][finger], counts["temperature"][finger]],
        )
