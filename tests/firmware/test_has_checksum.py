"""Tests of whether a device's declarations contain a checksum."""

import re

import pytest

from firmware_protocols import Device, create
from firmware_protocols.declared import has_checksum
from firmware_protocols.registry import DEVICES
from firmware_protocols.sums import crc8  # noqa: F401  (it makes this file one that computes a sum)
from tactemu.wire.line_models import line_model_for
from tests.pages import ROOT

UNSEEN = {
    "feetech_sts3215": True,  # each packet of the bus has one
}
"""Devices of which the captures of docs/infer.md do not tell, and whether they have a checksum."""


@pytest.fixture(scope="module")
def sums():
    """Return what the inference of a device from its captured bytes has found: "right" or "none", by device."""
    page = (ROOT / "docs" / "infer.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| [^|]+ \| [^|]+ \| (right|none) \|", page, re.M))


def test_a_device_has_a_checksum_where_one_is_found_in_its_bytes(sums):
    told = {}
    for name in DEVICES:
        device = create(name)
        if any("flip" in line_model_for(port).likely_faults for port in device.ports):
            told[name] = has_checksum(device)
    assert len(told) > 40
    assert told == {name: UNSEEN.get(name, sums.get(name) == "right") for name in told}


def test_a_sum_that_a_file_computes_in_its_own_code_counts(monkeypatch):
    class Computed(Device):
        name, ports = "computed", ()

    assert has_checksum(Computed())
    monkeypatch.delitem(globals(), "crc8")
    assert not has_checksum(Computed())
