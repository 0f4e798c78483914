"""``can:socketcan:NAME``: a CAN or CAN-FD interface of Linux; frames have the kernel's layout."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import socket
import struct
import time
from collections.abc import Sequence

from firmware_protocols import Can, CanFrame, Connector, WireFrame
from firmware_protocols.can_frames import CAN_FRAME, CanFrames
from tactemu.base.errors import TransportError, TransportUnavailable
from tactemu.base.frame_text import PROTOCOL_ERROR
from tactemu.transports import can_link
from tactemu.transports.can_errors import ALL_ERRORS, BusErrors
from tactemu.transports.forks import close_in_children
from tactemu.transports.receive_queue import ReceiveQueue
from tactemu.transports.transport import CanFilter, Closed, Event, Opened, Received, Transport

_logger = logging.getLogger(__name__)

_MAX_NAME_BYTES = 15
"""Maximum length of the name of a network interface on Linux [byte]."""
_SIZE, _FD_SIZE = CAN_FRAME.itemsize, 72
_CAN_FRAME, _CANFD_FRAME = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")
_FILTER = struct.Struct("=II")
_SIOCGIFFLAGS, _SIOCGIFMTU, _IFF_UP = 0x8913, 0x8921, 1
"""Constants of ``linux/sockios.h`` and ``net/if.h``."""
_CAN_RAW_ERR_FILTER = 2
"""A constant of ``linux/can/raw.h`` for which Python has no name."""
_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29
_SWITCHED, _FD_FLAG = 1, 4
"""Flags of a CAN-FD frame: bit rate switch, and FD format."""


class SocketCanTransport(Transport):
    """A node of a CAN bus. It receives whenever its network interface is there: a bus has no open and close."""

    scheme = "can"

    def __init__(self, location: str):
        self.channel = location.partition(":")[2]
        if not self.channel:
            raise TransportError(f"port 'can:{location}': expected can:INTERFACE:CHANNEL, as in can:socketcan:vcan0")
        self.address = location
        self._in: socket.socket | None = None
        self._out: socket.socket | None = None
        """The socket that frames are written to; the same as ``_in`` where the kernel has CAN."""
        self._queue: ReceiveQueue | None = None
        self._errors = BusErrors(self.channel)
        self._filters: tuple[CanFilter, ...] = ()
        self._device: Can | None = None
        """The device's connector, with its bit rates."""
        self._index = 0
        """Linux's number of the network interface; one that is made again under the same name has another."""
        self._away = False

    def set_filters(self, filters: Sequence[CanFilter]) -> None:
        """Let the kernel drop frames with other identifiers.

        They are then not on the bus that the wire models either: its frames do not wait for them. Call before
        :meth:`open`; the default, an empty sequence, receives all.
        """
        self._filters = tuple(filters)

    def set_connector(self, connector: Connector) -> None:
        """Take over the bit rates; a device with a data rate needs an interface that carries CAN-FD."""
        self._device = connector if isinstance(connector, Can) else None

    def open(self) -> None:
        """Join the bus.

        Raises:
            TransportError: there is no such interface, it is down, it has another bit rate than the device, or it
                carries no CAN-FD though the device needs it; the message names the fix.
        """
        if self._in is not None:
            return
        self._check_bus()
        if self._is_down():
            raise TransportUnavailable(f"cannot open can:{self.address}: the interface is down; {self._fix()}")
        try:
            self._in, self._out = self._join()
        except OSError as error:
            raise TransportUnavailable(f"cannot open can:{self.address}: {error}; {self._fix()}") from error
        close_in_children(self)
        self._queue = ReceiveQueue(self._in.fileno())
        self._index = self._index_now()

    def _join(self) -> tuple[socket.socket, socket.socket]:
        """Return the socket that frames are read from, and the one that they are written to.

        Raises:
            OSError: there is no such interface.
        """
        made = can_socket(self.channel, self._filters)
        if self.is_paced:
            made.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, ALL_ERRORS)
        if self._data_bitrate and (mtu := mtu_of(self.channel)) < _FD_SIZE:
            made.close()
            raise TransportUnavailable(
                f"cannot open can:{self.address}: {self.channel} carries no CAN-FD (MTU {mtu}), which the device "
                f"needs; {self._fd_fix()}"
            )
        return made, made

    def _fd_fix(self) -> str:
        return f"sudo ip link set {self.channel} down && sudo ip link set {self.channel} mtu 72 up"

    @property
    def _data_bitrate(self) -> int:
        """The data rate of the device [bit/s]; 0 where it sends no CAN-FD frames."""
        return (self._device.data_bitrate or 0) if self._device is not None else 0

    def _check_bus(self) -> None:
        """Compare a real bus with the device; a real bus also takes a frame's time itself.

        Raises:
            TransportUnavailable: they do not agree.
        """
        link = can_link.can_link(self.channel)
        self.is_paced = link is not None and link.is_real
        if link is None or not link.is_real or self._device is None:
            return
        if (why := can_link.mismatch(link, self.channel, self._device)) is not None:
            raise TransportUnavailable(f"cannot open can:{self.address}: {why}")
        for advice in can_link.advice(link, self.channel):
            _logger.warning("can:%s: %s", self.address, advice)

    def close(self) -> None:
        """Leave the bus."""
        for each in (self._in, self._out, self._queue):
            if each is not None:
                each.close()
        self._in = self._out = self._queue = None
        self._away = False

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the bus's socket."""
        return [self._in.fileno()] if self._in is not None and reading else []

    def is_quiet(self, readable: Sequence[int]) -> bool:
        """Return True while the bus is there and has nothing to read."""
        return self._in is not None and self._queue is not None and self._queue.is_empty(self._in.fileno(), readable)

    def poll(self, reading: bool = True) -> list[Event]:
        """Return frames of the other nodes, errors of a real bus, and whether the interface went away or came back."""
        events: list[Event] = []
        if self._away and self._come_back():
            events.append(Opened())
        end = self._queue.poll_deadline_s() if self._queue is not None else 0.0
        while reading and self._in is not None:
            try:
                data = self._in.recv(_FD_SIZE)
            except BlockingIOError:
                break
            except OSError:  # a network interface that is down may come up again unchanged
                if self._has_gone():
                    events.append(Closed())
                break
            if self.is_paced and (error := _error_of(data)) is not None:
                self._errors.add(*error)
            elif (frame := _frame_of(data)) is not None and self._passes_filters(frame):
                events.append(Received(frame))
            if time.monotonic() > end:
                break
        events += self._errors.take()
        return events + self._queue.overflows() if events and self._queue is not None else events

    def _passes_filters(self, frame: CanFrame) -> bool:
        return not self._filters or any(
            each.passes(frame.arbitration_id, frame.is_extended_id) for each in self._filters
        )

    def _is_down(self) -> bool:
        return is_down(self.channel)

    def _index_now(self) -> int:
        return _index_of(self.channel)

    def _has_gone(self) -> bool:
        """Return True if the network interface was removed, and close its socket, which is then useless."""
        if self._index_now() == self._index:
            return False
        _logger.warning("can:%s: the interface is gone; waiting for it to come back", self.address)
        self.close()
        self._away = True
        return True

    def _come_back(self) -> bool:
        if not self._index_now() or self._is_down():
            return False
        with contextlib.suppress(TransportError):  # gone again
            self.open()
            self._away = False
            _logger.warning("can:%s: the interface is back", self.address)
        return not self._away

    def write(self, frame: WireFrame) -> bool:
        """Send one frame; ``False`` when the interface is down or its queue is full."""
        if not isinstance(frame, CanFrame):
            raise TransportError(f"a CAN bus cannot carry {len(frame)} bytes of a serial stream")
        if self._out is None:
            return False
        try:
            self._out.send(_packed(frame), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def write_all(self, frames: CanFrames) -> int:
        """Send frames in their memory layout until one is not taken, and return how many were.

        Each frame is one ``send``: a ``sendmmsg`` for all of them, by ctypes, takes as long.
        """
        if self._out is None:
            return 0
        send, data, at = self._out.send, frames.array.tobytes(), 0
        try:
            for at in range(0, len(data), _SIZE):
                send(data[at : at + _SIZE], socket.MSG_DONTWAIT)
        except OSError:
            return at // _SIZE
        return len(frames)

    @property
    def has_reader(self) -> bool:
        """True while this node is on the bus."""
        return self._in is not None

    def _fix(self) -> str:
        name = self.channel
        if _index_of(name):
            return f"bring it up: sudo ip link set {name} up"
        if len(name.encode()) > _MAX_NAME_BYTES:
            return f"the kernel has no interface whose name is longer than {_MAX_NAME_BYTES} bytes; shorten it"
        return (
            f"make it: sudo modprobe vcan && sudo ip link add dev {name} type vcan && sudo ip link set {name} mtu 72 "
            "up; where the kernel has no CAN, `tactemu exec` gives a driver one, or use can:udp_multicast:239.74.163.2"
        )


def can_socket(name: str, filters: Sequence[CanFilter] = ()) -> socket.socket:
    """Return a non-blocking CAN socket on an interface, which receives what the filters pass, or all.

    Raises:
        OSError: there is no such interface, or the kernel has no CAN.
    """
    made = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        made.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        if filters:
            pairs = [(f.ident | f.extended << 31, f.mask | _EXTENDED) for f in filters]
            packed = b"".join(_FILTER.pack(*pair) for pair in pairs)
            made.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, packed)
        made.setblocking(False)
        made.bind((name,))
    except BaseException:
        made.close()
        raise
    return made


def mtu_of(name: str) -> int:
    """Return the MTU of a network interface [byte]: 16 for CAN, 72 for CAN-FD, more for CAN XL.

    Raises:
        OSError: there is no such interface.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
        request = fcntl.ioctl(any_socket, _SIOCGIFMTU, struct.pack("16si20x", name.encode()[:15], 0))
    return struct.unpack_from("i", request, 16)[0]


def is_down(name: str) -> bool:
    """Return True if there is such a network interface and it is down."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
        try:
            flags = fcntl.ioctl(any_socket, _SIOCGIFFLAGS, struct.pack("16sH22x", name.encode()[:15], 0))
        except OSError:
            return False
    return not struct.unpack_from("H", flags, 16)[0] & _IFF_UP


def _index_of(name: str) -> int:
    """Return Linux's number of a network interface; 0 if there is none of that name."""
    try:
        return socket.if_nametoindex(name)
    except OSError:
        return 0


def _packed(frame: CanFrame) -> bytes:
    """Return a frame as the kernel's ``struct can_frame`` or ``struct canfd_frame``."""
    identifier = PROTOCOL_ERROR if frame.is_error_frame else frame.arbitration_id
    identifier |= frame.is_extended_id << 31 | frame.is_remote_frame << 30 | frame.is_error_frame << 29
    if frame.is_fd:
        return _CANFD_FRAME.pack(identifier, len(frame.data), _FD_FLAG | frame.bitrate_switch, frame.data)
    if frame.is_error_frame:
        return _CAN_FRAME.pack(identifier, 8, bytes(8))
    return _CAN_FRAME.pack(identifier, len(frame.data), frame.data)


def _error_of(data: bytes) -> tuple[int, bytes] | None:
    """Return the classes and details of an error frame; ``None`` for other data."""
    if len(data) != _SIZE:
        return None
    identifier, size, details = _CAN_FRAME.unpack(data)
    return (identifier & ALL_ERRORS, details[:size]) if identifier & _ERROR else None


def _frame_of(data: bytes) -> CanFrame | None:
    """Return the frame of one of the kernel's structures; ``None`` for an error frame and for other data."""
    if len(data) == _SIZE:
        identifier, size, payload = _CAN_FRAME.unpack(data)
        flags = 0
    elif len(data) == _FD_SIZE:
        identifier, size, flags, payload = _CANFD_FRAME.unpack(data)
    else:
        return None
    if identifier & _ERROR:
        return None
    extended, remote = bool(identifier & _EXTENDED), bool(identifier & _REMOTE)
    return CanFrame(
        arbitration_id=identifier & (0x1FFF_FFFF if extended else 0x7FF),
        data=b"" if remote else payload[:size],
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=len(data) == _FD_SIZE,
        bitrate_switch=bool(flags & _SWITCHED),
    )
