"""``can.Bus(interface="tactemu", channel="linker_hand_l6")``: a CAN bus with a simulated device on it, in this process.

python-can finds this module by its entry point. Options follow the channel after a question mark
(:func:`tactemu.integrations.target.device_for`). Buses with the same channel are nodes of one bus; the device is
powered on with the first and off when the last is shut down.
"""

from __future__ import annotations

import itertools
import os
import threading
from dataclasses import dataclass
from typing import Any

from can import CanInitializationError
from can.bus import CanProtocol
from can.interfaces.virtual import VirtualBus

from tactemu.base.errors import TactemuError
from tactemu.integrations.target import device_for
from tactemu.session.serving import Served

SOCKETCAN = "TACTEMU_SOCKETCAN"
"""The environment variable that maps SocketCAN channels to devices: ``can0=linker_hand_l6,can1=xela_uskin``."""


@dataclass
class _Shared:
    """A device, and the number of buses of this process that it is on."""

    served: Served
    name: str
    buses: int = 0


_SHARED: dict[str, _Shared] = {}
_LOCK = threading.Lock()
_NUMBERS = itertools.count()


class TactemuBus(VirtualBus):
    """A node of a bus inside this process.

    ``bus.served`` is the device on it (:class:`tactemu.session.serving.Served`).
    """

    def __init__(self, channel: str, *, fd: bool = False, receive_own_messages: bool = False, **options: Any):
        with _LOCK:
            self._target, shared = channel, _SHARED.get(channel) or _start(channel)
            shared.buses += 1
            _SHARED[channel] = shared
        self.served = shared.served
        super().__init__(
            shared.name, receive_own_messages, can_filters=options.get("can_filters"),
            protocol=CanProtocol.CAN_FD if fd else CanProtocol.CAN_20,
        )  # fmt: skip
        self.channel_info = f"tactemu: {channel}"

    def shutdown(self) -> None:
        """Leave the bus, and stop the device if this was the last node."""
        if not self._is_shutdown:
            super().shutdown()
            with _LOCK:
                shared = _SHARED[self._target]
                shared.buses -= 1
                last = shared.buses == 0 and _SHARED.pop(self._target)
            if last:
                last.served.stop()


def _start(channel: str) -> _Shared:
    name = f"tactemu-{next(_NUMBERS)}"
    try:
        return _Shared(device_for(channel, f"can:virtual:{name}").start(), name)
    except TactemuError as error:
        raise CanInitializationError(f"{channel}: {error}") from error


class SocketcanBus:
    """A replacement of python-can's own ``socketcan`` for drivers that request it (``python -m tactemu.integrations``).

    Channels that :data:`SOCKETCAN` names lead to a device, all others to Linux CAN.
    """

    def __new__(cls, channel: str = "", **options: Any):
        """Return a bus of another class: that of a device, or python-can's own."""
        entries = (entry.partition("=") for entry in os.environ.get(SOCKETCAN, "").split(","))
        targets = {name.strip(): target.strip() for name, _, target in entries}
        if channel in targets:
            return TactemuBus(targets[channel], **options)
        from can.interfaces.socketcan import SocketcanBus as LinuxCan

        return LinuxCan(channel, **options)
