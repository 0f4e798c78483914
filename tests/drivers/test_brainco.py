"""The vendor's compiled SDKs, unmodified, read BrainCo hands."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.can_link import INTERFACE
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


@pytest.mark.judge("device", driver="bc-stark-sdk", environment="brainco", carrier="carrier")
@pytest.mark.parametrize(("kind", "side"), [("capacitive", "left"), ("pressure", "right")])
@pytest.mark.parametrize(
    ("device", "carrier"), [("brainco_revo2", "RS-485, Modbus"), ("brainco_revo2_canfd", "CAN-FD, Modbus")]
)
def test_revo2(device, carrier, kind, side):
    hand = fp.create(device, touch=kind, side=side)
    hand.period_ns = 2_000_000
    on_can = device.endswith("canfd")
    with Rig(hand, kind="can" if on_can else "serial", peak=2.0) as rig:
        interface = INTERFACE if on_can else "serial"
        arguments = (rig.port, interface, kind, hand.unit)
        got = run_driver("bc_stark_sdk", "brainco_revo2_read.py", *arguments, environment="brainco")
    assert got["serial"] == ("BCXTL2313J2500008" if side == "left" else "BCXTR2313J2500008")
    assert got["firmware"] == "1.0.5" and got["enabled"] == (0x1F if kind == "capacitive" else 0x3F)
    if kind == "capacitive":
        assert got["type"] == "StarkHardwareType.Revo2Touch" and got["states"] == ["Normal"] * 5
        # Over CAN the SDK asks twice, for 29 registers and for the last one, which is a state.
        assert_consecutive(got["many"], rig.truth)
        for k, finger in enumerate(got["single"]):
            assert_consecutive([finger], rig.truth, decode=lambda counts, k=k: counts[k], count=1)
    else:
        assert got["type"] == "StarkHardwareType.Revo2TouchPressure" and got["force"] == "ModulusTouchDataType.Force"
        parts = [slice(0, 91)] if not on_can else [slice(k, min(k + 29, 91)) for k in range(0, 91, 29)]
        for part in parts:
            assert_consecutive([r[part] for r in got["many"]], rig.truth, decode=lambda counts, part=part: counts[part])
        assert min(got["sums"]) > 500
