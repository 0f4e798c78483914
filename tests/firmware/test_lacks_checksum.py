"""Tests of the devices that declare that their readings have no checksum."""

import re

import pytest

from firmware_protocols import create
from firmware_protocols.registry import DEVICES
from tactemu.wire.line_models import line_model_for
from tests.pages import ROOT

UNSEEN = {
    "feetech_sts3215": False,  # each packet of the bus has one
    "kata_hand": True,
}
"""Devices of which the captures of docs/infer.md do not tell, and whether they lack a checksum."""


@pytest.fixture(scope="module")
def sums():
    """Return what the inference of a device from its captured bytes has found: "right" or "none", by device."""
    page = (ROOT / "docs" / "infer.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| [^|]+ \| [^|]+ \| (right|none) \|", page, re.M))


def test_a_device_lacks_a_checksum_where_none_is_found_in_its_bytes(sums):
    told = {}
    for name in DEVICES:
        device = create(name)
        if any("flip" in line_model_for(port).likely_faults for port in device.ports):
            told[name] = device.lacks_checksum
    assert len(told) > 40
    assert told == {name: UNSEEN.get(name, sums.get(name) == "none") for name in told}
