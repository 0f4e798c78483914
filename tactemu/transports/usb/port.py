"""A port that is a USB device: its driver comes and goes, and gives the chip its setting."""

from __future__ import annotations

from collections import deque

from tactemu.transports.transport import DROPPED, Closed, Event, LinesChanged, Opened, SerialSetting, Transport
from tactemu.transports.usb.chip import Chip


class UsbPort(Transport):
    """A USB device, read by one driver at a time."""

    def __init__(self, device: Chip):
        self._device = device
        self._chip = device.channels[0]
        """The channel of the port: mostly the device itself."""
        self._has_reader = False
        self._events: deque[Event] = deque()

    def _forget(self) -> None:
        """Forget the driver and all events, as the cable is pulled."""
        self._has_reader = False
        self._events.clear()

    def _take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events = list(self._events)
        self._events.clear()
        return events

    def _note_chip(self) -> None:
        """Add the events of the chip."""
        self._events += self._chip.events
        self._chip.events.clear()

    def _note_reader(self, has_reader: bool) -> None:
        """Add the events of a driver that opens or closes the port."""
        if has_reader == self._has_reader:
            return
        self._has_reader = has_reader
        if has_reader:
            self._events.append(Opened())
        else:
            self._events += (Closed(), DROPPED) if self._chip.lines != DROPPED else (Closed(),)
            self._chip.lines = LinesChanged(False, False)

    @property
    def has_reader(self) -> bool:
        """True while a driver has the port open."""
        return self._has_reader

    @property
    def setting(self) -> SerialSetting | None:
        """The setting that the driver has given the chip; unknown until then."""
        return self._chip.setting if self._chip.setting.baud else None
