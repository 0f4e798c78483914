"""OmniHand: what each part answers, which number it has, what is no request."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

PRO, O10 = "agibot_omnihand_pro", "agibot_omnihand_o10"
ZEROS = "00" * 64


def hand(name: str, **options) -> fp.Device:
    device = fp.create(name, **options)
    sample(device)
    return device


def test_a_force_on_one_finger_is_its_normal_tangential_and_angle():
    device = fp.create(PRO)
    for x, y, angle in ((0.0, 1.0, 0), (1.0, 0.0, 90), (0.0, -1.0, 180), (-1.0, 0.0, 270)):
        force = np.zeros((45, 3))
        force[9:18] = (x / 9, y / 9, -3 / 9)
        sample(device, force=force)
        assert device.counts[9:18, 1:].tolist() == [[30, 10, angle]] * 9, "clockwise from the tip, seen from outside"
        assert not device.counts[18:].any() and not device.counts[:9].any()


def test_forces_saturate_at_3000_and_channels_at_16_bits():
    device = fp.create(PRO)
    sample(device, 1e6)
    assert device.counts[0].tolist() == [65535, 3000, 0, 0]
    sample(device, -1e6)
    assert not device.counts.any()
    device = fp.create(O10)
    sample(device, 1e6)
    assert set(device.counts.tolist()) == {255}


@pytest.mark.parametrize(("name", "parts"), [(PRO, 5), (O10, 7)])
def test_parts_that_it_does_not_have_get_silence(name, parts):
    device = hand(name)
    answered = [part for part in range(32) if send(device, f"{part << 24 | 0x050101:08X}##1{ZEROS}")]
    assert answered == list(range(1, parts + 1))
    assert device.counters["unknown_command"] == 32 - parts and device.counters["requests"] == parts


def test_the_write_bit_is_clear_in_the_answer_and_the_number_is_its_own():
    device = hand(O10, device=5)
    assert [f.arbitration_id for f in send(device, f"01050185##1{ZEROS}")] == [0x01050105]
    assert send(device, f"01050101##1{ZEROS}") == []
    ident, mask = device.ports[0].hears[0]
    assert 0x07050185 & mask == ident and 0x07050184 & mask != ident


@pytest.mark.parametrize("request_", ["105##100", "01050101#00", "01060101##100", "01050201##100", "01050101#R"])
def test_what_is_no_request_is_ignored(request_):
    device = hand(PRO)
    assert send(device, request_) == [] and device.counters["ignored"] == 1
