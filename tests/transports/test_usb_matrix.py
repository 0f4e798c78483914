"""Drivers of a dozen devices, unmodified, each through each USB chip, in a guest: ``-m "nightly and kernel"``.

The tests are those of ``tests/drivers``; their rig has a USB device that the guest's kernel has attached, in place of a
pty. Every reading is compared with the samples there.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.kernel, pytest.mark.nightly, pytest.mark.timeout(7000)]
CHIPS = ["cdc", "ftdi", "ft2232", "cp210x", "ch341"]
TESTS = {
    "anyskin": "test_anyskin.py::test_200_consecutive_frames_float_for_float[anyskin]",
    "flexitac": "test_flexitac_optoforce.py::test_flexitac[12]",
    "optoforce": "test_flexitac_optoforce.py::test_optoforce[3-OptoForce16]",
    "robotiq_tsf85": "test_pyrobotiqtactile.py::test_200_readings[one packet]",
    "digity_exohand": "test_digity.py::test_200_readings_of_five_boards[right]",
    "paxini_high_speed": "test_paxini_high_speed.py::test_paxini_sdk_reads_200_pushes",
    "paxini_px6ax": "test_paxini_sdk.py::test_200_readings",
    "nibotics_prvs01": "test_nibotics_prvs01.py::test_200_readings[24]",
    "fulai_glove": "test_fulai_tactile.py::test_every_version[3.1-left-True]",
    "feetech_sts3215": "test_feetech_sts3215.py::test_200_readings_of_six_loads",
    "ability_hand": "test_ability_hand.py::test_200_readings[1]",
    "synria_60": "test_synria_60.py::test_200_readings",
    "inspire_rh56dftp": "test_inspire_rh56dftp.py::test_pyrh56_native",
    "robotis_hx5": "test_robotis_hx5.py::test_200_readings",
}
NO_NODE = {("paxini_px6ax", "ch341"): "1A86:55D3 is a CH343, which Linux drives as CDC-ACM"}
"""The devices whose ids the kernel's driver of a chip does not know."""
PAIRS = [(device, chip) for device in TESTS for chip in CHIPS if (device, chip) not in NO_NODE]


@pytest.fixture(scope="module")
def results():
    """What became of each test on each chip, by the tests' and the chip's names."""
    program = [sys.executable, "-m", "tests.transports.usb_matrix_guest", *CHIPS, "--"]
    tests = [f"tests/drivers/{each}" for each in TESTS.values()]
    guest = [
        ROOT / "scripts/kernel-guest",
        "-m",
        "2G",
        "-t",
        "6000",
        "-M",
        "vhci-hcd cdc-acm ftdi_sio cp210x ch341",
        "--",
    ]
    done = subprocess.run([*guest, *program, *tests], capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode == 125:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    said = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert [each["chip"] for each in said] == CHIPS, done.stderr[-3000:]
    return {(name, each["chip"]): outcome for each in said for name, outcome in each["results"].items()}


@pytest.mark.parametrize(("device", "chip"), PAIRS)
def test_every_reading_of_a_driver_is_a_sample(results, device, chip):
    outcome, why = results[f"tests/drivers/{TESTS[device]}", chip]
    assert outcome == "passed", why
