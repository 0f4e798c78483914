"""A device's state as plain data: what may be kept, what comes back, what is refused by name."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.framing import Packets
from firmware_protocols.state import NotPlain
from firmware_protocols.tables import Frame

TABLE = Frame("""
    image
    0   55 AA           start
    2   u1 x taxels     touch
""")


def four(data: bytes) -> int:
    return 4


class Keeps(fp.Device):
    name = "keeps"

    def __init__(self, **kept):
        self.layout = fp.points({"dome": (0.0, 0.0, 0.0)})
        vars(self).update(kept)

    def feel(self, reading, t_ns):
        return np.zeros(1)


def again(**kept) -> Keeps:
    device = Keeps(**kept)
    other = Keeps(**kept)
    other.restore(device.snapshot())
    return other


def test_half_a_packet_and_the_functions_that_cut_it():
    device = Keeps()
    device.packets = Packets(b"\x55", four, counters=device.counters)
    device.packets.cut(b"\x55\x01")
    other = Keeps()
    other.restore(device.snapshot())
    assert other.packets.cut(b"\x02\x03") == [b"\x55\x01\x02\x03"] and other.counters["requests"] == 1
    assert device.packets.cut(b"\x04\x05") == [b"\x55\x01\x04\x05"], "they share nothing"


def test_a_bound_table():
    table = again(table=TABLE.bind(wire_order=[2, 0, 1])).table
    assert table.pack(touch=np.array([10, 20, 30])) == bytes.fromhex("55aa1e0a14")


@pytest.mark.parametrize(
    "value", [lambda data: 4, slice(0, 3), iter([1]), len], ids=["lambda", "slice", "iterator", "len"]
)
def test_what_cannot_be_saved_is_refused_by_name(value):
    with pytest.raises(NotPlain, match=r"self\.kept"):
        Keeps(kept=value).snapshot()
