"""``can:INTERFACE:CHANNEL``: any interface of python-can, CAN and CAN-FD.

``can:udp_multicast:239.74.163.2`` needs no CAN in the kernel, ``can:virtual:NAME`` stays inside this process;
``can:socketcan:vcan0`` is Linux CAN, which needs no python-can: :mod:`tactemu.transports.socketcan`. An adapter with a
real bus, ``can:pcan:PCAN_USBBUS1``, is set to the bit rates of the device, and its bus takes a frame's time itself.

Multicast stays on this machine, since every receiver may also command the device. To reach other machines, set
python-can's ``CAN_CONFIG='{"hop_limit": 1}'``, for the driver's process too.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import time
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any

import can

from firmware_protocols import Can, CanFrame, Connector, WireFrame
from tactemu.base.errors import TransportError, TransportUnavailable
from tactemu.transports.can_messages import frame_of, message_of
from tactemu.transports.forks import close_in_children
from tactemu.transports.receive_queue import ReceiveQueue
from tactemu.transports.transport import CanFilter, Counted, Event, Received, Transport

_logger = logging.getLogger(__name__)

MAX_ECHOES = 16_384
"""Maximum number of own frames that are expected back on an interface that returns them; its queue holds as many."""

WITHOUT_BUS = ("udp_multicast", "virtual", "socketcand", "tactemu")
"""The interfaces of python-can behind which there is no bus that takes a frame's time, or none that one knows of."""


class CanTransport(Transport):
    """A node of a CAN bus. It always receives: a bus has no open and close."""

    scheme = "can"

    def __init__(self, location: str):
        self.interface, _, self.channel = location.partition(":")
        if not self.interface or not self.channel:
            raise TransportError(f"port 'can:{location}': expected can:INTERFACE:CHANNEL, as in can:socketcan:vcan0")
        self.address = location
        self.is_paced = self.interface not in WITHOUT_BUS
        self._device = Can()
        self._bus: can.BusABC | None = None
        self._fileno = -1
        self._queue: ReceiveQueue | None = None
        self._echoes: deque[CanFrame] | None = deque() if self.interface == "udp_multicast" else None
        self._echo_counts: Counter[CanFrame] = Counter()
        self._filters: tuple[CanFilter, ...] = ()

    def set_filters(self, filters: Sequence[CanFilter]) -> None:
        """Drop frames with other identifiers before they are decoded.

        They are then not on the bus that the wire models either: its frames do not wait for them. Call before
        :meth:`open`; the default, an empty sequence, receives all.
        """
        self._filters = tuple(filters)

    def set_connector(self, connector: Connector) -> None:
        """Take over the bit rates, to which an adapter is set."""
        if isinstance(connector, Can):
            self._device = connector

    def open(self) -> None:
        """Join the bus.

        Raises:
            TransportError: no such interface or channel; the message names the fix.
        """
        if self._bus is not None:
            return
        try:
            self._bus = can.Bus(interface=self.interface, channel=self.channel, **self._options())
        except (can.CanError, OSError, ImportError, ValueError, TypeError, NotImplementedError) as error:
            raise TransportUnavailable(f"cannot open can:{self.address}: {error}; {self._fix()}") from error
        close_in_children(self)
        try:
            self._fileno = self._bus.fileno()
        except NotImplementedError:
            self._fileno = -1
        if self.interface == "udp_multicast":
            _receive_own_group_only(self._fileno)
        self._queue = ReceiveQueue(self._fileno)

    def close(self) -> None:
        """Leave the bus."""
        if self._queue is not None:
            self._queue.close()
            self._queue = None
        if self._bus is not None:
            self._bus.shutdown()
            self._bus, self._fileno = None, -1

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the bus's socket, where it has one."""
        return [self._fileno] if self._fileno >= 0 and reading else []

    def is_quiet(self, readable: Sequence[int]) -> bool:
        """Return True where the bus has a socket and nothing to read."""
        return self._queue is not None and self._fileno >= 0 and self._queue.is_empty(self._fileno, readable)

    def poll(self, reading: bool = True) -> list[Event]:
        """Return frames of the other nodes, and the number of errors of a real bus."""
        if self._bus is None or self._queue is None:
            return []
        events: list[Event] = []
        errors = 0
        end = self._queue.poll_deadline_s()
        while reading:
            try:
                message = self._bus.recv(0)
            except can.CanError:  # an adapter that was away comes back unchanged
                break
            if message is None:
                break
            errors += message.is_error_frame
            if self._passes_filters(message) and not self._is_echo(frame := frame_of(message)):
                events.append(Received(frame))
            if time.monotonic() > end:
                break
        if errors and self.is_paced:
            events.append(Counted("bus_error", errors))
        return events + self._queue.overflows() if events else events

    def _passes_filters(self, message: can.Message) -> bool:
        if message.is_error_frame:
            return False
        return not self._filters or any(
            each.passes(message.arbitration_id, message.is_extended_id) for each in self._filters
        )

    def write(self, frame: WireFrame) -> bool:
        """Send one frame; ``False`` when the adapter does not take it."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        if self._bus is None:
            return False
        try:
            self._bus.send(message_of(frame), timeout=None if self.interface == "virtual" else 0)
        except (can.CanError, OSError):
            return False
        if self._echoes is not None and not frame.is_error_frame:
            self._echoes.append(frame)
            self._echo_counts[frame] += 1
            if len(self._echoes) > MAX_ECHOES:
                self._forget_echo()
        return True

    @property
    def has_reader(self) -> bool:
        """True while this node is on the bus."""
        return self._bus is not None

    def _is_echo(self, frame: CanFrame) -> bool:
        """Return True for an own frame, which multicast returns in order; a lost one must not hide those after it."""
        if not self._echoes or frame not in self._echo_counts:
            return False
        while self._forget_echo() != frame:
            pass
        return True

    def _forget_echo(self) -> CanFrame:
        """Remove the oldest own frame from those that are expected back, and return it."""
        assert self._echoes is not None
        oldest = self._echoes.popleft()
        self._echo_counts[oldest] -= 1
        if not self._echo_counts[oldest]:
            del self._echo_counts[oldest]
        return oldest

    def _options(self) -> dict[str, Any]:
        """Return the options for python-can beside interface and channel."""
        options: dict[str, Any] = {"fd": True} if self.interface == "udp_multicast" else {}
        if self.is_paced:
            options["bitrate"] = self._device.bitrate
            if self._device.data_bitrate:
                options |= {"fd": True, "data_bitrate": self._device.data_bitrate}
        if self.interface == "udp_multicast":
            options["hop_limit"] = int(can.util.load_config(config={"interface": self.interface}).get("hop_limit", 0))
            if options["hop_limit"] > 0:
                _logger.warning("can:%s: everyone on the network may read and command the device", self.address)
        return options

    def _fix(self) -> str:
        if self.interface == "udp_multicast":
            return "install msgpack, and use a multicast address such as 239.74.163.2 on a machine with a network route"
        return f"choose an interface of python-can: {', '.join(sorted(can.interfaces.VALID_INTERFACES))}"


def _receive_own_group_only(fileno: int) -> None:
    """Restrict a socket to its own group; Linux delivers every joined group to each socket on the port."""
    option = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(fileno)) as copy:
        copy.setsockopt(*option[copy.family], 0)  # IP_MULTICAST_ALL, IPV6_MULTICAST_ALL: Python has no names for them
