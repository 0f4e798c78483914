"""Fulai glove: frames, slots, text."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


@pytest.mark.parametrize(("hardware", "floats", "taxels"), [("3.0", 415, 415), ("3.1", 401, 401), ("3.2", 615, 600)])
def test_as_many_floats_as_the_version_has(hardware, floats, taxels):
    device = fp.create("fulai_glove", hardware=hardware)
    (frame,) = sample(device)
    assert len(frame) == 4 * floats + 4 and frame.endswith(b"\x00\x00\x80\x7f")
    assert len(device.layout) == taxels and np.count_nonzero(np.frombuffer(frame[:-4], "<f4")) == taxels


def test_slots_without_a_taxel_are_those_of_thumb_and_thenar():
    (frame,) = sample(fp.create("fulai_glove", hardware="3.2"))
    empty = np.flatnonzero(np.frombuffer(frame[:-4], "<f4") == 0)
    assert empty.tolist() == [*range(82, 90), *range(530, 537)]


def test_the_stream_stops_and_goes_on():
    device = fp.create("fulai_glove")
    assert not send(device, b"vofa ") and not send(device, b"off\r\n") and not sample(device)
    assert not send(device, b"vofa on\r\n") and len(sample(device)) == 1
    assert send(device, b"reboot\r\n") == [b"ERR unknown command\r\n"] and device.counters["unknown_command"] == 1


def test_old_firmware_does_not_know_who_it_is():
    device = fp.create("fulai_glove", identity=False)
    assert send(device, b"bridge info get\r\n") == [b"ERR unknown command\r\n"]
    assert not device.counters["unknown_command"]


def test_identity():
    (line,) = send(fp.create("fulai_glove", hand="right", hardware="3.2", firmware="2.1"), b"bridge info get\r\n")
    assert line == (
        b"OK BRIDGE MODEL=FuLai_SensorGlove FW=2.1 HW=3.2 PROTOCOL=1.5 HAND=RIGHT HAND_DEFAULT=RIGHT "
        b"HAND_SOURCE=FLASH IAP=1\r\n"
    )


def test_a_zero_before_4088_looks_like_the_tail():
    device = fp.create("fulai_glove", baseline=0)
    device.counts = np.zeros(401, int)
    device.counts[7] = 4088
    (frame,) = device.stream(0, "")
    assert frame.find(b"\x00\x00\x80\x7f") == 4 * 7 - 1
