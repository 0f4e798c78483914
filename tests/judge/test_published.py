"""Published drivers, judged: what ``docs/drivers-under-faults.md`` says of them, found without knowing them."""

import importlib.util
import sys
from pathlib import Path

import pytest

from tactemu.judge.running import Judge, Options

pytestmark = [pytest.mark.nightly, pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(600)]

SCRIPT = str(Path(__file__).with_name("published.py"))
FOUND = {
    # by driver: its device, and by trial the findings of which one is enough; none: no failing one
    "optoforce": (
        "optoforce",
        {"flipped": (), "cut": (), "dropped": (), "doubled": (), "hang": ("blocks",), "unplug": ()},
    ),
    "anyskin": (
        "anyskin",
        {"flipped": ("wrong",), "cut": ("collateral",), "dropped": (), "hang": ("blocks", "spins"), "unplug": ()},
    ),
    "pymodbus": ("inspire_rh56dftp", {"flipped": (), "cut": (), "dropped": (), "exception": (), "another unit": ()}),
    "pyrobotiqtactile": ("robotiq_tsf85", {"flipped": ("wrong",), "cut": ("wrong",), "reset": ("lost sync", "stale")}),
}


@pytest.mark.parametrize("name", FOUND)
def test_a_published_driver_does_as_the_page_says(name):
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed")
    device, expected = FOUND[name]
    with Judge(device, [sys.executable, SCRIPT, name, "{port}"], Options(only=list(expected))) as judge:
        outcomes = {outcome.name: outcome for outcome in judge.run()}
    assert not outcomes["clean"].fails(Options().fail_on), outcomes["clean"].verdict
    for trial, kinds in expected.items():
        outcome = outcomes[trial]
        if kinds:
            assert outcome.has(*kinds), (trial, outcome.verdict)
        else:
            assert not outcome.fails(Options().fail_on), (trial, outcome.verdict)
