"""A CAN bus without kernel support for the rig: python-can's ``udp_multicast``, on a group of its own."""

import itertools
import os
from collections import deque

from firmware_protocols import CanFrame

INTERFACE = "udp_multicast"
_groups = itertools.count(os.getpid())


class CanLink:
    """Reads and writes the frames of one bus."""

    def __init__(self, channel: str):
        import can

        self.message = can.Message
        self.bus = can.Bus(interface=INTERFACE, channel=channel)
        self.echoes: deque[CanFrame] = deque(maxlen=256)
        """Frames of our own that multicast will return, in order."""

    def filenos(self):
        return [self.bus.fileno()]

    def read(self):
        message = self.bus.recv(0)
        if message is None:
            return []
        frame = CanFrame(
            arbitration_id=message.arbitration_id,
            data=bytes(message.data),
            is_extended_id=message.is_extended_id,
            is_remote_frame=message.is_remote_frame,
            is_fd=message.is_fd,
            bitrate_switch=message.bitrate_switch,
        )
        if frame not in self.echoes:
            return [frame]
        while self.echoes.popleft() != frame:
            pass
        return []

    def write(self, frame):
        self.echoes.append(frame)
        self.bus.send(
            self.message(
                arbitration_id=frame.arbitration_id,
                data=frame.data,
                is_extended_id=frame.is_extended_id,
                is_fd=frame.is_fd,
                bitrate_switch=frame.bitrate_switch,
                check=True,
            )
        )

    def close(self):
        self.bus.shutdown()


def open_can():
    """The channel (a multicast group of this process and call) and the link."""
    number = next(_groups)
    channel = f"239.74.{number >> 8 & 255}.{number & 255}"
    return channel, CanLink(channel)
