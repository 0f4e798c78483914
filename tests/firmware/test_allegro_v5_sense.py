"""Allegro V5 Sense: channels at their places, saturation below the invalid byte."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "allegro_v5_sense"


def channels(frames) -> list[int]:
    assert [f.arbitration_id for f in frames] == [0x54 << 2, 0x55 << 2]
    return list(frames[0].data + frames[1].data)


def test_each_channel_at_its_place():
    device = fp.create(NAME)
    assert channels(sample(device, np.arange(16) * 0.4)) == list(range(0, 160, 10))
    names = [patch.name for patch in device.layout.patches]
    assert names[0] == "palm" and [names[k] for k in (3, 7, 11, 15)] == [
        "index tip", "middle tip", "ring tip", "thumb tip"
    ]  # fmt: skip


def test_a_push_never_says_invalid():
    device = fp.create(NAME, invalid=[5])
    got = channels(sample(device, 1e9))
    assert got == [254] * 5 + [255] + [254] * 10
    assert device.counts[5] == 0, "what a driver shows of it"


@pytest.mark.parametrize("request_", ["204#030000000000", "200#R", "220#R", "150#00"])
def test_nothing_is_answered(request_):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == []


def test_channels_that_it_does_not_have_are_refused():
    with pytest.raises(ValueError, match="invalid"):
        fp.create(NAME, invalid=[16])
