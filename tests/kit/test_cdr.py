"""CDR of messages: ROS 2's own decoder reads what is written."""

import struct

import numpy as np
import pytest

from firmware_protocols.cdr import Codec, members_of

DEFINITION = """# Members in an order that needs padding.
bool first
int64 second
string[] texts
uint8[] bytes
float64 third
float64[] none
int16 fourth
string last
"""
VALUES = [True, -5, ("", "häh"), np.array([1, 2, 3], np.uint8), 0.5, np.zeros(0), -7, "end"]


def test_values_come_back():
    codec = Codec(members_of(DEFINITION))
    back = codec.decode(codec.encode(VALUES))
    assert [each.tolist() if isinstance(each, np.ndarray) else each for each in back] == [
        True, -5, ("", "häh"), [1, 2, 3], 0.5, [], -7, "end",
    ]  # fmt: skip
    assert type(back[6]) is int and type(back[4]) is float


def test_ros_reads_them():
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(DEFINITION, "a/msg/B"))
    found = store.deserialize_cdr(Codec(members_of(DEFINITION)).encode(VALUES), "a/msg/B")
    assert (found.first, found.second, found.third, found.fourth, found.last) == (True, -5, 0.5, -7, "end")
    assert list(found.texts) == ["", "häh"] and found.bytes.tolist() == [1, 2, 3] and len(found.none) == 0


def test_a_message_that_is_too_short_is_refused():
    codec = Codec(members_of(DEFINITION))
    data = codec.encode(VALUES)
    for size in range(4, len(data)):
        with pytest.raises((ValueError, struct.error)):
            codec.decode(data[:size])
