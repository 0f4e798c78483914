"""The vendor's compiled SDKs, unmodified, read BrainCo hands."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]


@pytest.mark.judge("brainco_revo3", driver="bc-revo3-sdk", environment="brainco", carrier="RS-485, Modbus")
@pytest.mark.parametrize("touch", ["array", "matrix"])
def test_revo3(touch):
    device = fp.create("brainco_revo3", touch=touch)
    device.period_ns = 2_000_000
    with Rig(device, peak=2.0) as rig:
        got = run_driver("bc_revo3_sdk", "brainco_revo3_read.py", rig.port, touch, environment="brainco")
    assert (got["model"], got["serial"], got["firmware"]) == ("Revo3Model.UltraTouch", "BCUTL40000000000", "0.1.2")
    assert got["counts"] == [len(patch) for patch in device.layout.patches] and got["mask"] == 0x7FF
    scale = 1 if touch == "array" else 10
    for k, patch in enumerate(device.layout.patches):
        seen, forces = ([snapshot[k] for snapshot in got[name]] for name in ("many", "force"))
        assert_consecutive(seen, rig.truth, decode=lambda counts, taxels=patch.taxels: counts[taxels])
        assert_consecutive(
            forces, rig.truth, decode=lambda counts, taxels=patch.taxels: scale * counts[taxels], count=20
        )
    assert got["mode"] == "TouchValueMode.Force" and got["partly"] == 0x7FB
    if touch == "array":
        assert [len(regions) for regions in got["regions"]] == [1, 3, 6, 3, 5, 3, 5, 3, 5, 3, 5]
        assert np.min(got["regions"][1]) > 1000 and got["regions"][2] == [0] * 6
    else:
        assert got["tared"] == [f"TouchTareStatus.{status}" for status in ("Tared", "NotTared", "NotTared")]
