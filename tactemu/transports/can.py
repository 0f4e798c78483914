"""``can:INTERFACE:CHANNEL``: any interface of python-can, CAN and CAN-FD.

``can:socketcan:vcan0`` is Linux CAN, ``can:udp_multicast:239.74.163.2`` needs no CAN in the kernel,
``can:virtual:NAME`` stays inside this process.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections import deque
from typing import Any

import can

from firmware_protocols import CanFrame, Frame
from tactemu.errors import TransportError, TransportUnavailable
from tactemu.frame_text import PROTOCOL_ERROR
from tactemu.transports.can_messages import frame_of, message_of
from tactemu.transports.forks import keep_from_children
from tactemu.transports.transport import Event, Received, Transport

_AT_ONCE_S = 0.001
"""For how long one look takes frames [s], so that a flood of them leaves time for the rest."""
_LONGEST_NAME = 15
"""Of a network interface on Linux [bytes]."""
_ECHOES = 256
"""Own frames that are waited for on an interface that returns them."""
_CAN_FRAME, _CANFD_FRAME = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")


class CanTransport(Transport):
    """A node of a CAN bus. Always listening: a bus has no open and close."""

    scheme = "can"
    kinds = ("can",)

    def __init__(self, rest: str):
        self.interface, _, self.channel = rest.partition(":")
        if not self.interface or not self.channel:
            raise TransportError(f"port 'can:{rest}': expected can:INTERFACE:CHANNEL, as in can:socketcan:vcan0")
        self.address = rest
        self._bus: can.BusABC | None = None
        self._fileno = -1
        self._socket: socket.socket | None = None
        """Linux CAN: frames are sent without python-can, which would ask before each whether it may."""
        self._echoes: deque[CanFrame] | None = deque(maxlen=_ECHOES) if self.interface == "udp_multicast" else None

    def open(self) -> None:
        """Join the bus.

        Raises:
            TransportError: no such interface or channel; the message names the fix.
        """
        if self._bus is not None:
            return
        if self.interface == "socketcan" and _is_down(self.channel):
            raise TransportUnavailable(f"cannot open can:{self.address}: the interface is down; {self._fix()}")
        options: dict[str, Any] = {"fd": True} if self.interface in ("socketcan", "udp_multicast") else {}
        try:
            self._bus = can.Bus(interface=self.interface, channel=self.channel, **options)
        except (can.CanError, OSError, ImportError, ValueError, NotImplementedError) as error:
            raise TransportUnavailable(f"cannot open can:{self.address}: {error}; {self._fix()}") from error
        keep_from_children(self)
        try:
            self._fileno = self._bus.fileno()
        except NotImplementedError:
            self._fileno = -1
        if self.interface == "socketcan":
            self._socket = self._bus.socket  # type: ignore[attr-defined]
        if self.interface == "udp_multicast":
            _hear_own_group_only(self._fileno)

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus, self._fileno, self._socket = None, -1, None

    def filenos(self, reading: bool = True) -> list[int]:
        """The bus's socket, where it has one."""
        return [self._fileno] if self._fileno >= 0 and reading else []

    def poll(self, reading: bool = True) -> list[Event]:
        """Frames of the other nodes."""
        events: list[Event] = []
        end = time.monotonic() + _AT_ONCE_S
        while reading and self._bus is not None:
            try:
                message = self._bus.recv(0)
            except can.CanError:
                break  # interface down: nothing arrives until it is up again
            if message is None:
                break
            if message.is_error_frame:
                continue
            frame = frame_of(message)
            if not self._is_echo(frame):
                events.append(Received(frame))
            if time.monotonic() > end:
                break
        return events

    def write(self, frame: Frame) -> bool:
        """Send one frame; ``False`` when the interface is down or its queue is full."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        if self._bus is None:
            return False
        try:
            if self._socket is not None:
                self._socket.send(_packed(frame), socket.MSG_DONTWAIT)
            else:
                self._bus.send(message_of(frame), timeout=None if self.interface == "virtual" else 0)
        except (can.CanError, OSError):
            return False
        if self._echoes is not None and not frame.is_error_frame:
            self._echoes.append(frame)
        return True

    @property
    def listening(self) -> bool:
        """Whether this node is on the bus."""
        return self._bus is not None

    def _is_echo(self, frame: CanFrame) -> bool:
        """Multicast returns our own frames, in order; a lost one must not hide those after it."""
        if not self._echoes or frame not in self._echoes:
            return False
        while self._echoes.popleft() != frame:
            pass
        return True

    def _fix(self) -> str:
        if self.interface == "socketcan":
            name = self.channel
            if os.path.exists(f"/sys/class/net/{name}"):
                return f"bring it up: sudo ip link set {name} up"
            if len(name.encode()) > _LONGEST_NAME:
                return f"the kernel knows no interface whose name is longer than {_LONGEST_NAME} bytes; shorten it"
            return (
                f"make it: sudo modprobe vcan && sudo ip link add dev {name} type vcan && "
                f"sudo ip link set {name} mtu 72 up; "
                "where the kernel has no CAN use can:udp_multicast:239.74.163.2 or scripts/vcan-run"
            )
        if self.interface == "udp_multicast":
            return "install msgpack, and use a multicast address such as 239.74.163.2 on a machine with a network route"
        return f"python-can knows {', '.join(sorted(can.interfaces.VALID_INTERFACES))}"


def _hear_own_group_only(fileno: int) -> None:
    """Linux delivers every group that any program here has joined to each socket on the port, unless told not to."""
    option = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(fileno)) as copy:
        copy.setsockopt(*option[copy.family], 0)  # IP_MULTICAST_ALL, IPV6_MULTICAST_ALL: Python has no names for them


def _is_down(name: str) -> bool:
    """Whether there is such a network interface, and it is down. (A virtual one that is up says ``unknown``.)"""
    try:
        with open(f"/sys/class/net/{name}/operstate", encoding="ascii") as state:
            return state.read().strip() == "down"
    except OSError:
        return False


def _packed(frame: CanFrame) -> bytes:
    """``struct can_frame`` or ``struct canfd_frame`` of the kernel."""
    identifier = PROTOCOL_ERROR if frame.is_error_frame else frame.arbitration_id
    identifier |= frame.is_extended_id << 31 | frame.is_remote_frame << 30 | frame.is_error_frame << 29
    if frame.is_fd:
        return _CANFD_FRAME.pack(identifier, len(frame.data), frame.bitrate_switch, frame.data)
    if frame.is_error_frame:
        return _CAN_FRAME.pack(identifier, 8, bytes(8))
    return _CAN_FRAME.pack(identifier, len(frame.data), frame.data)
