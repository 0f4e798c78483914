"""Two unmodified Modbus clients read sensors whose own drivers are on no index, register by register as those do."""

import json

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]
clients = pytest.mark.parametrize("client", ["pymodbus", "modbus_tk"])


def fast(name, **options):
    device = fp.create(name, **options)
    device.period_ns = 2_000_000
    return device


def ask(client: str, rig: Rig, unit: int, *steps, times: int = 1):
    """What the registers read, by round and step."""
    script = f"{client}_steps.py"
    return run_driver(client, script, rig.port, rig.device.ports[0].baud, unit, times, json.dumps(steps))


@pytest.mark.judge("linker_hand_l10_rs485", driver="client", carrier="RS-485, Modbus")
@clients
@pytest.mark.parametrize(("side", "unit"), [("left", 0x28), ("right", 0x27)])
def test_linker_hand_l10(client, side, unit):

    def matrix(registers):
        return [register & 0xFF for register in registers][10:82]

    with Rig(fast("linker_hand_l10_rs485", side=side), peak=0.5) as rig:
        many = ask(client, rig, unit, ["write_one", 70, 3], ["inputs", 72, 96], times=200)
        fingers = [part for k in range(1, 6) for part in (["write_one", 70, k], ["inputs", 72, 96])]
        (once,) = ask(client, rig, unit, *fingers)
        refused = ask(client, rig, unit, ["write_one", 70, 6], ["write_one", 82, 1], ["inputs", 168, 1])
    patches = [patch.taxels for patch in rig.device.layout.patches]
    assert_consecutive([matrix(reads[0]) for reads in many], rig.truth, decode=lambda counts: counts[patches[2]])
    for registers, taxels in zip(once, patches, strict=True):
        assert_consecutive([matrix(registers)], rig.truth, decode=lambda counts, taxels=taxels: counts[taxels], count=1)
    assert refused == [[3, 2, 2]]
    assert np.ptp(many[0][0]) > 50, "the finger feels something"


PARTS = [(2000, 18), (2100, 30), (2200, 30), (2300, 30), (2400, 16), (2500, 28)]


@pytest.mark.judge("rohand", driver="client", carrier="RS-485, Modbus")
@clients
def test_rohand_dots(client):
    def dots(registers):
        return [byte for register in registers for byte in divmod(register, 256)]

    with Rig(fast("rohand"), peak=5.0) as rig:
        many = ask(client, rig, 2, ["holding", 2100, 30], times=200)
        (once,) = ask(client, rig, 2, ["holding", 1265, 1], *(["holding", *part] for part in PARTS))
        refused = ask(client, rig, 2, ["write_one", 1005, 248], ["holding", 1006, 1], ["holding", 9000, 1])
    patches = [patch.taxels for patch in rig.device.layout.patches]
    assert_consecutive([dots(reads[0]) for reads in many], rig.truth, decode=lambda counts: counts[patches[1]])
    assert once[0] == [0]
    for registers, taxels in zip(once[1:], patches, strict=True):
        assert_consecutive([dots(registers)], rig.truth, decode=lambda counts, taxels=taxels: counts[taxels], count=1)
    assert refused == [[4, [3], 2]]


@pytest.mark.judge("rohand", driver="client", carrier="RS-485, Modbus")
@clients
def test_rohand_three_axis_points(client):
    def points(registers):
        return [high << 8 | low for low, high in (divmod(register, 256) for register in registers)]

    with Rig(fast("rohand", touch="three_axis"), peak=5.0) as rig:
        many = ask(client, rig, 2, ["holding", 2200, 6], times=200)
    assert_consecutive([points(reads[0]) for reads in many], rig.truth, decode=lambda counts: counts[3:5].ravel())


@pytest.mark.judge("rohand", driver="unienv-rohand", environment="rohand", carrier="RS-485, Modbus")
def test_unienv_rohand():
    """It reads six forces where there are five: the last is the first one's speed."""
    with Rig(fast("rohand", touch="finger"), peak=3.0) as rig:
        got = run_driver("unienv_rohand", "unienv_rohand_read.py", rig.port, environment="rohand")
    assert_consecutive([forces[:5] for forces in got["many"]], rig.truth)
    assert all(forces[5] == 65535 for forces in got["many"])
    assert np.allclose(got["opened"], [36.7, 178.37, 176.06, 176.56, 174.86, 0], atol=0.01)
    assert np.allclose(got["closed"], [2.26, 100.22, 97.81, 101.38, 98.84, 89.98], atol=0.01)
    assert np.allclose(np.rad2deg(got["seen"]["joint_angles"]), [20, 150, 140, 130, 120, 45], atol=0.01)
    assert got["moving"] == [1] * 6 and got["seen"]["joint_currents"] == [0] * 6


GHAND = [(0x1090, 57), (0x10C9, 47), (0x10F8, 47), (0x1127, 47), (0x1156, 47)]


@pytest.mark.judge("ghand5", driver="client", carrier="RS-485, Modbus")
@clients
def test_ghand5(client):
    def taxels(finger, registers):
        axes = np.array([divmod(register, 256) for register in registers], np.uint8).ravel()[: 3 * finger]
        return np.stack([axes[0::3].view(np.int8), axes[1::3].view(np.int8), axes[2::3]], axis=-1, dtype=int)

    with Rig(fast("ghand5"), peak=20.0) as rig:
        many = ask(client, rig, 0x31, ["inputs", *GHAND[1]], times=200)
        (once,) = ask(client, rig, 0x31, ["inputs", 0x1080, 16], *(["inputs", *part] for part in GHAND))
    patches = [patch.taxels for patch in rig.device.layout.patches]
    assert_consecutive([taxels(31, reads[0]) for reads in many], rig.truth, decode=lambda counts: counts[patches[1]])
    assert once[0][0] == 0x1F00 and once[0][3::3] == [0xFF00] * 5
    for registers, part in zip(once[1:], patches, strict=True):
        read = taxels(part.stop - part.start, registers)
        assert_consecutive([read], rig.truth, decode=lambda counts, part=part: counts[part], count=1)


@pytest.mark.judge("dfrobot_tactile", driver="client", carrier="RS-485, Modbus")
@clients
@pytest.mark.parametrize(("model", "shape"), [("4x8", (4, 8)), ("6x6", (6, 6))])
def test_dfrobot_tactile(client, model, shape):
    count = shape[0] * shape[1]
    with Rig(fast("dfrobot_tactile", model=model), peak=9.0) as rig:
        many = ask(client, rig, 1, ["inputs", 7, count], times=200)
        once = ask(client, rig, 1, ["inputs", 1, 1], ["inputs", 43, 1], ["write_one", 6, 0xFF0F], ["inputs", 7, count])
    turned = [np.reshape(reads[0], shape)[::-1].ravel() for reads in many]
    assert_consecutive(turned, rig.truth)
    assert once[0][:2] == [[0x3343], [int(model == "6x6")]]
