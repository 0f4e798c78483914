"""A device's state as plain data: what may be kept, what comes back, what is refused by name."""

from collections import deque

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.framing import Packets
from firmware_protocols.state import NotPlain
from firmware_protocols.state_file import read, to_bytes
from firmware_protocols.tables import Frame
from tactemu.base.errors import StateError
from tactemu.emulator.saving.leaves import LeafCheck

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

    def measure(self, reading, t_ns):
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


def test_bytes_hold_the_whole_state():
    value = {"text": "é", "bytes": b"\x00\xff", "none": None, "huge": 1 << 80, 3: [1.5, float("inf")], "flags": (True,)}
    device = Keeps(kept=[value, np.arange(6).reshape(2, 3), np.float32(1.5), deque([1], maxlen=2)])
    other = Keeps(kept=None)
    other.restore(read(to_bytes(device.snapshot()))[0])
    plain, array, number, recent = other.kept
    assert plain == value and np.array_equal(array, device.kept[1]) and array.dtype == device.kept[1].dtype
    assert number == 1.5 and type(number) is np.float32 and recent == device.kept[3] and recent.maxlen == 2


class Forgets(Keeps):
    """A device with attributes that are None at times."""

    def __init__(self):
        super().__init__()
        self.later = None
        self.annotated: bytes | None = b"x"
        self.bare = b"x"


@pytest.mark.parametrize(
    "name, value, is_taken", [("later", b"x", True), ("annotated", None, True), ("bare", None, False)]
)
def test_an_attribute_that_is_none_at_times_is_none_at_power_up_or_annotated(name, value, is_taken):
    """As docs/adding-a-device.md says of saved states."""
    here = {key: getattr(Forgets(), key) for key in ("later", "annotated", "bare")}
    check = LeafCheck(t_ns=0)
    if is_taken:
        check.attributes(Forgets, here | {name: value}, [here], "keeps")
    else:
        with pytest.raises(StateError, match=r"keeps\.bare: expected bytes, got null"):
            check.attributes(Forgets, here | {name: value}, [here], "keeps")
