"""A USB device and the host that has it; each channel of a chip with several may belong to another emulator.

The emulators may run in threads of their own. Whoever reads the connection reads it for all channels, and wakes the
others; :attr:`SharedDevice.lock` is held meanwhile.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from collections import deque
from dataclasses import dataclass

from tactemu.transports.usb.chip import Chip
from tactemu.transports.usb.link import HostLink


@dataclass
class _Wake:
    """An alarm for the loop of a channel."""

    fileno: int
    """A file descriptor, readable from :meth:`set` until :meth:`clear`."""
    is_set: bool = False

    def set(self) -> None:
        os.eventfd_write(self.fileno, 1)  # first: whoever finds the flag resets what woke it
        self.is_set = True

    def clear(self) -> None:
        if self.is_set:
            self.is_set = False
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self.fileno)


class SharedDevice:
    """A device, plugged in while all channels that a port has taken are open.

    Args:
        chip: the device.
    """

    def __init__(self, chip: Chip):
        self.chip = chip
        self.lock = threading.RLock()
        self._link: HostLink | None = None
        self._attached: deque[socket.socket] = deque()
        """Connections of hosts that another thread may have accepted."""
        self._is_given = False
        self._taken: set[Chip] = set()
        """The channels that ports have taken, open or not."""
        self._wakes: dict[Chip, _Wake] = {}
        """The channels that are open."""

    def take(self, number: int | None) -> Chip | None:
        """Take a channel for a port: one by its number, or the first free one; None if it is not free."""
        with self.lock:
            wanted = self.chip.channels if number is None else self.chip.channels[number : number + 1]
            channel = next((each for each in wanted if each not in self._taken), None)
            if channel is not None:
                self._taken.add(channel)
            return channel

    def open(self, channel: Chip) -> bool:
        """Open a channel; return True if it is the first one."""
        with self.lock:
            self._wakes[channel] = _Wake(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC))
            return len(self._wakes) == 1

    def close(self, channel: Chip) -> bool:
        """Pull the cable, for all channels; return True if no other channel is open."""
        with self.lock:
            if self._link is not None:
                self.drop(self._link)
            while self._attached:
                self._attached.popleft().close()
            if (wake := self._wakes.pop(channel, None)) is not None:
                os.close(wake.fileno)
            self._is_given = False
            return not self._wakes

    # -- hosts ---------------------------------------------------------------------------------------------------------

    @property
    def is_free(self) -> bool:
        """True if a host may attach the device: it is plugged in, and no host has it."""
        return not self._is_given and self._taken == set(self._wakes)

    def give(self, connection: socket.socket) -> None:
        """Give the device to a host; may be called in any thread."""
        self._is_given = True
        self._attached.append(connection)
        self.wake()

    def fileno(self, channel: Chip) -> int:
        """Return the file descriptor that is readable while there is something new for a channel."""
        return self._wakes[channel].fileno

    def link(self, channel: Chip) -> HostLink | None:
        """Return the host that has the device, for the loop of a channel, which has awoken."""
        self._wakes[channel].clear()
        if self._link is None and self._attached:
            self._link = HostLink(self._attached.popleft(), self.chip)
            self.wake(but=channel)
        return self._link

    def drop(self, link: HostLink) -> None:
        """Cut the connection of a host; the device is free again."""
        link.close()
        if link is self._link:
            self._link, self._is_given = None, False
        self.wake()

    def wake(self, but: Chip | None = None) -> None:
        """Wake the loops of all channels that are open, but one."""
        for channel, wake in list(self._wakes.items()):
            if channel is not but:
                wake.set()
