"""ability-hand 0.2.2, unmodified: its SDK reads touch and moves the fingers on a bare pty."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("ability_hand", driver="ability-hand", carrier="serial, PPP"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]


def documented_force(count: int) -> float:
    """The driver's arithmetic, in its order of operations."""
    return 121591.0 / (33000.0 / (int(count) * (3.3 / 4096.0)) + 10000) + 0.878894 if count else 0


@pytest.mark.parametrize("variant", [0, 1, 2])
def test_200_readings(variant, tmp_path):
    with Rig(fp.create("ability_hand"), peak=7.5) as rig:
        got = run_driver("ah_wrapper", "ability_hand_read.py", rig.port, variant, cwd=tmp_path)
    assert abs(got["pos"][-1][0] - 60) < 0.1 and abs(got["pos"][-1][5] + 60) < 0.1
    assert [len(got["cur"]) > 200, len(got["vel"]) > 200] == [variant in (0, 2), variant in (1, 2)]
    if variant < 2:
        force = [documented_force(count) for count in range(4096)]
        assert_consecutive(got["fsr"], rig.truth, decode=lambda counts: [force[c] for c in counts])
    else:
        assert not got["fsr"]
