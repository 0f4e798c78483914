"""digity 0.2.5, unmodified, on a bare pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("digity_exohand", driver="digity", carrier="USB serial, packets"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]

ANGLES = (1.5, -20.25, 90.0, 0.01, -179.99)


@pytest.mark.parametrize("side", ["right", "left"])
def test_200_readings_of_five_boards(side):
    with Rig(fp.create("digity_exohand", side=side, angles=ANGLES), peak=12.0) as rig:
        got = run_driver("digity", "digity_read.py", rig.port, 200)
    assert got["sides"] == [[side, "hand"]]
    assert np.all(np.diff(got["sequence"]) == 1) and len(got["sequence"]) == 200
    touch = [np.ravel([board[0] for board in boards]) for boards in got["boards"]]
    assert_consecutive(touch, rig.truth, decode=lambda counts: counts.item()["force"])
    assert np.ptp(touch, axis=0).min() > 0
    for boards in got["boards"]:
        assert all(board[1:] == [[0, 0, 16384, 0, 0, 0], list(ANGLES)] for board in boards)
