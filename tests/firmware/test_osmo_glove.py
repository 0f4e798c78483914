"""OSMO glove: messages, what is left out, stuffing."""

from collections import Counter

import firmware_protocols as fp
from firmware_protocols.framing import Cobs
from tests.firmware.feeding import sample, send


def messages(**values):
    stream = b"".join(sample(fp.create("osmo_glove"), **values))
    return Cobs(counters=Counter()).cut(stream)


def test_what_is_zero_is_left_out():
    """At time 0, untouched: index 0 is missing, and so is all of Mag."""
    first, second, *_ = messages()
    assert first.hex() == "1001180120012a00" and second.hex() == "08011002180120012a00"


def test_seconds_and_nanoseconds_are_varints():
    (*_, last) = messages(t_ns=300_000_000_007)
    assert last.hex() == "08041005180120012a05" + "08ac02" + "1007"


def test_a_push_raises_z():
    (first, *_) = messages(force=(0.0, 0.0, -0.5))
    assert first.hex() == "1001180120012a05" + "2d00003442", "field 5, 45.0"


def test_hears_nothing():
    device = fp.create("osmo_glove")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
