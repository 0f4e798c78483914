"""A candleLight CAN adapter (gs_usb): Linux makes ``can0`` of it, with its bit timing, state and error counters.

Requests and structures are those of Linux 6.1, ``drivers/net/can/usb/gs_usb.c``, and of candle-usb/candleLight_fw.
Descriptors are those of ``lsusb -v`` in its issue 175, and of its ``src/usbd_gs_can.c``.
"""

from __future__ import annotations

import struct

from firmware_protocols import USB, Can, CanFrame
from firmware_protocols.frames import FD_LENGTHS
from tactemu.transports.usb.chip import CLASS, DONE, TO_HOST, VENDOR, Chip, Setup
from tactemu.transports.usb.descriptors import Descriptors, Endpoint, Interface, descriptor

CLOCK_HZ = 80_000_000
CLASSIC_BYTES, FD_BYTES = 20, 76
"""The size of a frame of CAN and of CAN-FD on the USB bus."""
_HEAD = struct.Struct("<IIBBBB")
_FROM_BUS = 0xFFFF_FFFF
"""The echo number of a frame that another node has sent."""
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_FD, _BITRATE_SWITCH = 2, 4
_HAS_FD, _HAS_EXTENDED_CONSTANTS = 1 << 8, 1 << 10
_LIMITS = (1, 256, 1, 128, 128, 1, 1024, 1)
"""Bit timing in time quanta: segment 1 and 2 (least, most), largest jump; prescaler: least, most, step."""
_DATA_LIMITS = (1, 32, 1, 16, 16, 1, 32, 1)
ACK_ERROR, PASSIVE_ERROR = 0x20, 0x04
"""Classes of error frames (``linux/can/error.h``): no node acknowledged, a controller is in trouble."""
_PASSIVE = 0x30
_UPGRADE = 0xE0
"""The number of the string of the interface for firmware upgrades."""


class Candle(Chip):
    """The adapter, between a host's frames and the bus."""

    listens_when_configured = True
    is_framed = True

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self.bus = Can()
        """The bus that the adapter is plugged into."""
        self.bitrate = self.data_bitrate = 0
        """The rates that the host has set [bit/s]; 0: none yet."""
        self.is_started = False

    def descriptors(self) -> Descriptors:
        """Return the descriptors of a candleLight adapter."""
        vid, pid = self.ids(0x1D50, 0x606F)
        ends = (Endpoint(0x81, "bulk", 32), Endpoint(0x02, "bulk", 32))
        names = self.named("bytewerk", "candleLight USB to CAN adapter", "000000000001")
        upgrade = descriptor(0x21, struct.pack("<BHHH", 0x0B, 255, 2048, 0x011A))  # DFU 1.1a: detach, up- and download
        interfaces = (
            Interface((0xFF, 0xFF, 0xFF), ends),
            Interface((0xFE, 0x01, 0x01), (), string=_UPGRADE, extra=upgrade),
        )
        more = {_UPGRADE: "candleLight firmware upgrade interface"}
        return Descriptors(vid, pid, 0x0000, interfaces, names, more_strings=more, power_ma=150)

    @property
    def agrees(self) -> bool:
        """True if the host has set the bit rates of the bus."""
        wants_data = self.bus.data_bitrate is not None and self.data_bitrate != 0
        return self.bitrate == self.bus.bitrate and (not wants_data or self.data_bitrate == self.bus.data_bitrate)

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out the requests of gs_usb: constants, bit timing, start and stop; and DFU's for its state."""
        if setup.type == CLASS and setup.kind & TO_HOST and (setup.request, setup.target) == (3, 1):
            return b"\0\0\0\0\0\xff"  # it runs, and no upgrade is under way
        if setup.type != VENDOR:
            return None
        is_fd = self.bus.data_bitrate is not None
        features = (_HAS_FD | _HAS_EXTENDED_CONSTANTS) * is_fd
        if setup.kind & TO_HOST:
            return {
                4: struct.pack("<10I", features, CLOCK_HZ, *_LIMITS),
                5: struct.pack("<4B2I", 0, 0, 0, 0, 2, 1),
                11: struct.pack("<18I", features, CLOCK_HZ, *_LIMITS, *_DATA_LIMITS) if is_fd else None,
            }.get(setup.request)
        match setup.request:
            case 0:  # byte order: little
                return DONE
            case 1 if len(data) >= 20:
                self.bitrate = _rate(data)
                self.note(f"bit rate {self.bitrate}")
                return DONE
            case 10 if len(data) >= 20:
                self.data_bitrate = _rate(data)
                self.note(f"data bit rate {self.data_bitrate}")
                return DONE
            case 2 if len(data) >= 8:
                self.is_started = data[0] == 1
                self.note("channel started" if self.is_started else "channel stopped")
                return DONE
        return None


def _rate(timing: bytes) -> int:
    """Return the bit rate of a timing: propagation and phase segments, jump width, prescaler."""
    propagation, phase1, phase2, _, prescaler = struct.unpack_from("<5I", timing)
    quanta = 1 + propagation + phase1 + phase2
    return round(CLOCK_HZ / (prescaler * quanta)) if prescaler else 0


def to_host(frame: CanFrame) -> bytes:
    """Return a frame of the bus as the adapter passes it on."""
    return _HEAD.pack(_FROM_BUS, _identifier(frame), FD_LENGTHS.index(len(frame.data)), 0, _flags(frame), 0) + (
        frame.data.ljust(64 if frame.is_fd else 8, b"\0")
    )


def _identifier(frame: CanFrame) -> int:
    return frame.arbitration_id | _EXTENDED * frame.is_extended_id | _REMOTE * frame.is_remote_frame


def _flags(frame: CanFrame) -> int:
    return _FD * frame.is_fd | _BITRATE_SWITCH * frame.bitrate_switch


def from_host(data: bytes) -> tuple[CanFrame, bytes] | None:
    """Return the frame of a transfer, and the echo that says that it was sent; None if the transfer holds none."""
    if len(data) < CLASSIC_BYTES:
        return None
    _, ident, length_code, _, flags, _ = _HEAD.unpack_from(data)
    is_fd = bool(flags & _FD)
    size = FD_LENGTHS[length_code & 15]
    if (size > 8 and not is_fd) or len(data) < _HEAD.size + size:
        return None
    frame = CanFrame(
        arbitration_id=ident & 0x1FFF_FFFF,
        data=b"" if ident & _REMOTE else bytes(data[_HEAD.size : _HEAD.size + size]),
        is_extended_id=bool(ident & _EXTENDED),
        is_remote_frame=bool(ident & _REMOTE),
        is_fd=is_fd,
        bitrate_switch=bool(flags & _BITRATE_SWITCH),
    )
    return frame, bytes(data[: FD_BYTES if is_fd else CLASSIC_BYTES])


def unacknowledged() -> bytes:
    """Return the error frame of a controller whose frame no node acknowledges.

    It repeats the frame at once; after 16 times, a few milliseconds, it is error-passive, and goes on.
    """
    what = _ERROR | ACK_ERROR | PASSIVE_ERROR
    return _HEAD.pack(_FROM_BUS, what, 8, 0, 0, 0) + bytes((0, _PASSIVE, *bytes(6)))
