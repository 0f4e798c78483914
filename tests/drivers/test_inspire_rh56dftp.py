"""Unmodified clients read the Inspire hand: Modbus over TCP and as RTU on a bare pty, and EB 90."""

import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]


def hand(**options) -> fp.Device:
    """Sampled fast, so that 200 readings see many samples."""
    device = fp.create("inspire_rh56dftp", **options)
    device.period_ns = 2_000_000
    return device


INDEX_TOP = slice(564, 660)
PALM = [950 + 14 * row + column for column in range(14) for row in range(7, -1, -1)]
"""8 x 14 points, as they are sent: column by column, each from the bottom."""
SENT = [*range(950), *PALM]


@pytest.mark.judge("inspire_rh56dftp", driver="plusml-rh56dftp", carrier="TCP, Modbus")
def test_plusml_rh56dftp_over_tcp(tmp_path):
    with Rig(hand(), kind="tcp", peak=4.5) as rig:
        got = run_driver("RH56DFTP", "plusml_rh56dftp_read.py", rig.port, cwd=tmp_path)
    assert rig.device.counters["refused"] == 0
    # The driver reads one register per byte of the matrix: the matrix is the first half of what it returns.
    assert_consecutive([values[:96] for values in got["many"]], rig.truth, decode=lambda counts: counts[INDEX_TOP])
    for address, values in got["once"].values():
        size = len(values) // 2
        start = (address - 3000) // 2
        part = slice(start, start + size)
        assert_consecutive([values[:size]], rig.truth, decode=lambda counts, part=part: counts[SENT][part], count=1)
    assert len(got["once"]) == 17
    assert got["written"] and got["others"]["POS_SET(2)"] == 300
    assert got["others"]["HAND_ID"] == 1 and got["others"]["TEMP(1)"] == 25 and got["others"]["ERROR(5)"] == 0
    assert got["others"]["FORCE_ACT(0)"] == 4000


@pytest.mark.judge("inspire_rh56dftp", driver="inspire-rh56dftp", carrier="TCP, Modbus")
@pytest.mark.parametrize(("unit", "id_error"), [(0, 0), (255, 1)])
def test_inspire_rh56dftp_over_tcp(unit, id_error):
    """It was written for a hand whose transactions come back one too high, and does not look at them."""
    with Rig(hand(id_error=id_error), kind="tcp", peak=4.5) as rig:
        got = run_driver("inspire_rh56dftp", "inspire_rh56dftp_read.py", rig.port, unit)
    for address, readings in got["batches"].items():
        start = (int(address) - 3000) // 2
        part = slice(start, start + len(readings[0]))
        assert_consecutive(readings, rig.truth, decode=lambda counts, part=part: counts[SENT][part])
    assert len(got["batches"]) == 11
    assert got["moved"] and got["angles"] == [0, 200, 400, 600, 800, 1000]


@pytest.mark.judge("inspire_rh56dftp", driver="pyrh56", carrier="RS-485, EB 90", every_run=True)
def test_pyrh56_native(tmp_path):
    """Byte registers come in order, whatever half of a Modbus register the first would be in."""
    device = fp.create("inspire_rh56dftp", line="native", first_byte="high")
    device.period_ns = 2_000_000
    with Rig(device, peak=4.5) as rig:
        got = run_driver("rh56_sdk", "pyrh56_read.py", rig.port, cwd=tmp_path)
    assert_consecutive(got["many"], rig.truth, decode=lambda counts: counts[INDEX_TOP])
    for address, values in got["once"]:
        part = slice((address - 3000) // 2, (address - 3000) // 2 + len(values))
        assert_consecutive([values], rig.truth, decode=lambda counts, part=part: counts[SENT][part], count=1)
    assert len(got["once"]) == 17
    assert got["angles"] == [0, 200, 400, 600, 800, 900] and got["positions"] == [2000, 1600, 1200, 800, 400, 200]
    assert got["moving"] == [1] * 6 and got["status"] == [2] * 6
    assert got["forces"][0] == 4000 and got["temperatures"] == [25] * 6 and got["errors"] == [0] * 6
    assert device.counters["refused"] == 0
