"""Tests that the judge's findings on published drivers are those of ``docs/drivers-under-faults.md``.

Three drivers are judged in every run, by the most valuable trials; all ten, by all trials, each night.
"""

import importlib.metadata
import sys
from pathlib import Path

import pytest

from tactemu.judge.trial_runner import Judge, JudgeOptions
from tests.drivers.environments import python_with
from tests.judge.cards import CARDS, SCRIPT

pytestmark = [pytest.mark.driver, pytest.mark.timeout(900)]

NONE = ()
"""No finding that fails a run."""
SHORT = {
    # for each driver and trial the findings, of which one is enough
    "optoforce": {"flipped": NONE, "one cut": NONE, "hang": ("blocks",)},
    "anyskin": {"flipped": ("wrong",), "unplug": NONE},
    "pymodbus": {"exception": NONE},
}
WHOLE = {
    "anyskin": {"flipped": ("wrong",), "cut": ("collateral",), "dropped": NONE, "hang": ("blocks", "spins")},
    "reskin-sensor": {"flipped": ("wrong",), "cut": ("collateral",), "dropped": NONE, "hang": ("blocks", "spins")},
    "pyrobotiqtactile": {"flipped": ("wrong",), "cut": ("wrong",), "reset": ("lost sync", "stale")},
    "flexitac": {"flipped": ("wrong",), "cut": ("wrong",)},
    "optoforce": {"flipped": NONE, "cut": NONE, "dropped": NONE, "doubled": NONE, "hang": ("blocks",), "unplug": NONE},
    "ability-hand": {"flipped": NONE, "cut": NONE, "unplug": NONE, "late answer": ("stale",)},
    "pymodbus": {"flipped": NONE, "cut": NONE, "dropped": NONE, "exception": NONE, "another unit": NONE},
    "modbus_tk": {"flipped": NONE, "cut": NONE, "dropped": NONE},
    "plusml-rh56dftp": {"dropped": NONE, "exception": NONE},
    "linkerbot": {"dropped": NONE},
}


def card_of(name, only=()):
    """Return the outcomes of one driver's card, by trial."""
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"{name} is not installed")
    card = CARDS[name]
    options = JudgeOptions(only=only, port=card.port or None)
    with Judge(card.device, [sys.executable, str(SCRIPT), name, "{port}"], options) as judge:
        return {outcome.name: outcome for outcome in judge.run()}


def agrees(outcomes, expected):
    assert not outcomes["clean"].fails(JudgeOptions().fail_on), outcomes["clean"].verdict
    for trial, kinds in expected.items():
        outcome = outcomes[trial]
        if kinds:
            assert outcome.has(*kinds), (trial, outcome.verdict)
        else:
            assert not outcome.fails(JudgeOptions().fail_on), (trial, outcome.verdict)


@pytest.mark.parametrize("name", SHORT)
def test_a_published_driver_does_as_the_page_says(name):
    agrees(card_of(name, only=list(SHORT[name])), SHORT[name])


@pytest.mark.nightly
@pytest.mark.parametrize("name", WHOLE)
def test_its_whole_card_is_as_the_page_says(name):
    agrees(card_of(name), WHOLE[name])


@pytest.mark.nightly
def test_a_camera_of_lerobot_hands_out_its_last_picture_after_unplugging():
    """Check a stale picture: the camera's thread logs the exception and ends, and its reader goes on."""
    shim = Path(__file__).parents[1] / "drivers" / "scripts" / "lerobot"
    python = [python_with("lerobot_record"), str(SCRIPT), "lerobot-camera-paxini", "{port}"]
    options = JudgeOptions(only=["flipped", "unplug"], start_s=60.0)
    with Judge("paxini_high_speed", ["env", f"PYTHONPATH={shim}", *python], options) as judge:
        outcomes = {outcome.name: outcome for outcome in judge.run()}
    agrees(outcomes, {"flipped": NONE, "unplug": ("stale",)})
