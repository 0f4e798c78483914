"""CAN frames go to the methods that answer them: by identifier, or by a part of it."""

import pytest

from firmware_protocols import Can, CanFrame, CanRequests, Device, Identifier, command, grid_layout
from firmware_protocols.frames import frame_of

CAN_ID = Identifier("ppppptttttttt00000001wddddddd", {"part": "p", "message": "t", "write": "w", "device": "d"})


class Board(Device[CanFrame]):
    """A device of two identifiers, and a family of them."""

    name = "board"
    ports = (Can(),)

    def __init__(self):
        self.layout = grid_layout(1, 1, 0.004)
        self.packets = CanRequests()
        self.goals = {}

    @command("200#R", "200#0102", safe=True)
    def version(self, request):
        return b"\1\2"

    @command("204#0A00", data="<H*")
    def rate(self, request):
        self.period_ns = request.value * 1_000_000

    @command("300#0700", on=range(0x300, 0x310, 4), data="<h")
    def go(self, request):
        self.goals[request.id] = request.value


def got(device: Device, text: str) -> list[str]:
    return [str(frame) for frame in device.receive(frame_of(text), 0, "")]


def test_frames_go_to_methods_by_their_identifier():
    device = Board()
    assert got(device, "200#R") == ["200#0102"] and got(device, "204#1400AABB") == [] and device.period_ns == 20_000_000
    for text in ("30C#FEFF", "300#0100"):
        assert got(device, text) == []
    assert device.goals == {0x30C: -2, 0x300: 1} and device.counters["requests"] == 4
    assert [each.name for each in device.commands] == ["version", "rate", "go"]


@pytest.mark.parametrize(("text", "counter"), [
    ("201#R", "ignored"), ("200#00", "bad_length"), ("204#R", "bad_length"), ("204#00", "bad_length"),
    ("00000200#R", "ignored"), ("204##10A00", "ignored"),
])  # fmt: skip
def test_other_frames_are_counted(text, counter):
    device = Board()
    assert got(device, text) == [] and device.counters == {counter: 1}


class Hand(Device[CanFrame]):
    """A device whose requests have the message in a part of the identifier, on CAN-FD."""

    name = "hand"
    ports = (Can(data_bitrate=5_000_000),)

    def __init__(self):
        self.layout = grid_layout(1, 1, 0.004)
        self.packets = CanRequests(CAN_ID, by="message", is_fd=True)

    def accepts(self, request):
        return request.device == 1

    @command("01050101##100", "01050101##1 *", data="*")
    def touch(self, request):
        return bytes(9 + request.part)


def test_parts_of_an_identifier_are_attributes_and_answers_are_padded():
    device = Hand()
    assert got(device, "02050101##100") == [f"02050101##1{'00' * 12}"]
    assert got(device, "01050102##100") == [] and device.counters["other_address"] == 1
    assert got(device, "01060101##100") == [] and device.counters["unknown_command"] == 1
    assert got(device, "01050101#00") == [] and device.counters["ignored"] == 1
