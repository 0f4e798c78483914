"""A stand-in for Kvaser's ``canlib``, whose library needs a Kvaser adapter: the same calls over SocketCAN's can0."""

import sys
from types import SimpleNamespace

import can

__all__ = ["Bitrate", "CanNoMsg", "Channel", "ChannelData", "Frame", "MessageFlag", "canError", "canlib", "openChannel"]

Bitrate = SimpleNamespace(BITRATE_1M=1_000_000)
MessageFlag = SimpleNamespace(STD=2)
canOPEN_ACCEPT_VIRTUAL = canDRIVER_NORMAL = 0


class canError(Exception):
    """An error of the library."""


class CanNoMsg(canError):
    """No frame within the time."""


class Frame:
    """A frame."""

    def __init__(self, id_, data, flags=None):
        self.id, self.data, self.flags = id_, bytearray(data), flags


class ChannelData:
    """The names of a channel."""

    def __init__(self, number):
        self.channel_name, self.card_upc_no, self.card_serial_no = f"can{number}", "-", "-"


class Channel:
    """A channel of an adapter."""

    def __init__(self, number):
        self.channel_data, self._number = ChannelData(number), number

    def setBusOutputControl(self, mode):
        pass

    setBusParams = setBusOutputControl

    def busOn(self):
        self._bus = can.Bus(interface="socketcan", channel=f"can{self._number}")

    def busOff(self):
        self._bus.shutdown()

    def close(self):
        pass

    def read(self, timeout):
        message = self._bus.recv(timeout / 1000)
        if message is None:
            raise CanNoMsg
        return Frame(message.arbitration_id, message.data)

    def write(self, frame):
        self._bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))


def openChannel(number, flags=0):
    return Channel(number)


canlib = sys.modules[__name__]
