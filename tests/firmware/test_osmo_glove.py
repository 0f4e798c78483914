"""OSMO glove: messages, what is left out, clocks, counter."""

from collections import Counter

import firmware_protocols as fp
from firmware_protocols.stuffing import Cobs
from tests.firmware.feeding import sample, send


def messages(device, **values):
    return Cobs(counters=Counter()).cut(b"".join(sample(device, **values)))


def test_a_board_sends_two_magnetometers_and_its_orientation():
    found = messages(fp.create("osmo_glove"))
    assert len(found) == 15
    assert [message[4:10].hex() for message in found[12:]] == ["100518012011", "100518012025", "100518012011"]
    assert found[0][10] == found[1][10] == 0x2A and found[2][10] == 0x32, "Mag, Mag, Quat"


def test_an_axis_that_is_zero_is_left_out():
    device = fp.create("osmo_glove", gains=(38.0, 60.0, -90.0))
    (first, *_) = messages(device, force=(1.0, 0.0, 0.0))
    assert first[12:].hex() == "08d804" + "1080ade204" + "25" + "00000a43" + "2d" + "00c02845", "no field 3"


def test_each_board_has_a_clock_of_its_own():
    device = fp.create("osmo_glove", uptime_s=600.5)
    found = messages(device, t_ns=15_700)
    assert found[0][12:21].hex() == "08d804" + "1089c4b6ee01", "600 s, 500_015_625 ns"
    assert found[3][12:].startswith(bytes.fromhex("08d40410" + "897a")), "4.5 s later: 596 s, 15_625 ns"


def test_the_index_counts_samples_and_turns_negative():
    device = fp.create("osmo_glove")
    device.preset("index", 0x7FFFFFFF)
    assert messages(device)[0].startswith(bytes.fromhex("08ffffffff07"))
    assert messages(device)[0].startswith(bytes.fromhex("0880808080f8ffffffff01"))


def test_all_links():
    found = messages(fp.create("osmo_glove", sensors="all"))
    assert len(found) == 60
    assert found[-2][4:10].hex() == "100518042028" and found[-1][4:10].hex() == "100518042014"


def test_hears_nothing():
    device = fp.create("osmo_glove")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
