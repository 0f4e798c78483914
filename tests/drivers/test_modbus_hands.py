"""Two unmodified Modbus clients read hands whose own drivers are on no index, register by register as those do."""

import json

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]
clients = pytest.mark.parametrize("client", ["pymodbus", "modbus_tk"])


def ask(client: str, rig: Rig, unit: int, *steps, times: int = 1):
    """What the registers read, by round and step."""
    script = f"{client}_steps.py"
    return run_driver(client, script, rig.port, rig.device.ports[0].baud, unit, times, json.dumps(steps))


@pytest.mark.judge("linker_hand_l10_rs485", driver="client", carrier="RS-485, Modbus")
@clients
@pytest.mark.parametrize(("side", "unit"), [("left", 0x28), ("right", 0x27)])
def test_linker_hand_l10(client, side, unit):
    device = fp.create("linker_hand_l10_rs485", side=side)
    device.period_ns = 2_000_000

    def matrix(registers):
        return [register & 0xFF for register in registers][10:82]

    with Rig(device, peak=0.5) as rig:
        many = ask(client, rig, unit, ["write_one", 70, 3], ["inputs", 72, 96], times=200)
        fingers = [part for k in range(1, 6) for part in (["write_one", 70, k], ["inputs", 72, 96])]
        (once,) = ask(client, rig, unit, *fingers)
        refused = ask(client, rig, unit, ["write_one", 70, 6], ["write_one", 82, 1], ["inputs", 168, 1])
    patches = [patch.taxels for patch in device.layout.patches]
    assert_consecutive([matrix(reads[0]) for reads in many], rig.truth, decode=lambda counts: counts[patches[2]])
    for registers, taxels in zip(once, patches, strict=True):
        assert_consecutive([matrix(registers)], rig.truth, decode=lambda counts, taxels=taxels: counts[taxels], count=1)
    assert refused == [[3, 2, 2]]
    assert np.ptp(many[0][0]) > 50, "the finger feels something"
