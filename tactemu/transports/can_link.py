"""The state of a CAN interface of the kernel: bit rates, FD, error state, queue; asked by netlink.

Constants are those of Linux: ``linux/rtnetlink.h``, ``linux/if_link.h``, ``linux/can/netlink.h``. python-can's own
answer about an interface's state is not used: it names one that is down active.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from firmware_protocols import Can
from tactemu.transports import can_errors

_RTM_GETLINK, _RTM_NEWLINK, _NLM_F_REQUEST = 18, 16, 1
_IFLA_IFNAME, _IFLA_TXQLEN, _IFLA_LINKINFO = 3, 13, 18
_IFLA_INFO_KIND, _IFLA_INFO_DATA, _IFLA_INFO_XSTATS = 1, 2, 3
_CAN_BITTIMING, _CAN_STATE, _CAN_CTRLMODE, _CAN_DATA_BITTIMING = 1, 4, 5, 9
_CTRLMODE_FD = 0x20
_HEADER, _IFINFO, _ATTRIBUTE = struct.Struct("=IHHII"), struct.Struct("=BxHiII"), struct.Struct("=HH")
_TIMING = struct.Struct("=II")
STATES = ("ERROR-ACTIVE", "ERROR-WARNING", "ERROR-PASSIVE", "BUS-OFF", "STOPPED", "SLEEPING")
KINDS = ("can", "vcan", "vxcan")
"""The kinds of interfaces that carry CAN frames."""
COUNTS = ("bus_error", "error_warning", "error_passive", "bus_off", "arbitration_lost", "restarts")
"""The counters of ``struct can_device_stats``."""
USUAL_SAMPLE_POINTS = (0.7, 0.9)
"""Places in a bit at which nodes of a bus sample, from the earliest to the latest that go together."""
SHORT_QUEUE = 100
"""Length of a transmit queue below which a burst of a hand finds no room; Linux gives a new interface 10."""
_MAX_REPLY_BYTES = 65_536


@dataclass(frozen=True)
class CanLink:
    """The settings and the state of an interface."""

    kind: str
    """``can`` for a real bus, ``vcan`` ..."""
    bitrate: int = 0
    """The bit rate [bit/s]; 0: not set."""
    sample_point: float = 0.0
    """The place in a bit at which it is sampled, 0 to 1."""
    data_bitrate: int = 0
    """The bit rate of the data of FD frames [bit/s]; 0: not set."""
    is_fd: bool = False
    state: str = ""
    queue_length: int = 0
    """The number of frames that the transmit queue holds."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """The errors that the kernel has counted since the adapter was plugged in."""

    @property
    def is_real(self) -> bool:
        """True if a controller is behind the interface, which has a bit rate."""
        return self.kind == "can"


def names() -> list[str]:
    """Return the names of the CAN interfaces of this machine."""
    names = sorted(name for _, name in socket.if_nameindex())
    return [name for name in names if (link := can_link(name)) is not None and link.kind in KINDS]


def can_link(name: str) -> CanLink | None:
    """Return the state of a network interface, or None if there is none of this name or the kernel does not tell."""
    body = _IFINFO.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + _packed(_IFLA_IFNAME, name.encode() + b"\0")
    request = _HEADER.pack(_HEADER.size + len(body), _RTM_GETLINK, _NLM_F_REQUEST, 1, 0) + body
    try:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as link:
            link.settimeout(1.0)
            link.send(request)
            reply = link.recv(_MAX_REPLY_BYTES)
    except OSError:
        return None
    length, kind, *_ = _HEADER.unpack_from(reply)
    if kind != _RTM_NEWLINK:
        return None
    found = dict(_attributes(reply[_HEADER.size + _IFINFO.size : length]))
    info = dict(_attributes(found.get(_IFLA_LINKINFO, b"")))
    data = dict(_attributes(info.get(_IFLA_INFO_DATA, b"")))
    counted = info.get(_IFLA_INFO_XSTATS, b"")[: 4 * len(COUNTS)]
    bitrate, sample_point = _timing(data.get(_CAN_BITTIMING))
    state = int.from_bytes(data.get(_CAN_STATE, b"\xff")[:4], "little")
    modes = struct.unpack_from("=II", data[_CAN_CTRLMODE])[1] if len(data.get(_CAN_CTRLMODE, b"")) >= 8 else 0
    return CanLink(
        kind=info.get(_IFLA_INFO_KIND, b"").rstrip(b"\0").decode(errors="replace"),
        bitrate=bitrate,
        sample_point=sample_point,
        data_bitrate=_timing(data.get(_CAN_DATA_BITTIMING))[0],
        is_fd=bool(modes & _CTRLMODE_FD),
        state=STATES[state] if state < len(STATES) else "",
        queue_length=int.from_bytes(found.get(_IFLA_TXQLEN, b"")[:4], "little"),
        counts=dict(zip(COUNTS, struct.unpack(f"={len(counted) // 4}I", counted))),
    )


def _packed(kind: int, value: bytes) -> bytes:
    return _ATTRIBUTE.pack(_ATTRIBUTE.size + len(value), kind) + value + bytes(-len(value) % 4)


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and value of each attribute; a nested one has attributes as its value."""
    at = 0
    while at + _ATTRIBUTE.size <= len(data):
        length, kind = _ATTRIBUTE.unpack_from(data, at)
        if length < _ATTRIBUTE.size:
            return
        yield kind & 0x3FFF, data[at + _ATTRIBUTE.size : at + length]
        at += length + -length % 4


def _timing(data: bytes | None) -> tuple[int, float]:
    """Return bit rate and sample point of a ``struct can_bittiming``; the kernel counts the latter in thousandths."""
    if data is None or len(data) < _TIMING.size:
        return 0, 0.0
    bitrate, thousandths = _TIMING.unpack_from(data)
    return bitrate, thousandths / 1000


def describe(link: CanLink) -> str:
    """Return the settings and the state of an interface in words."""
    if not link.bitrate:
        return "it has no bit rate"
    data = f", data at {link.data_bitrate} bit/s" if link.is_fd else ", no CAN-FD"
    return f"{link.bitrate} bit/s{data}, sample point {link.sample_point:.1%}, {link.state}"


def set_up(name: str, device: Can) -> str:
    """Return the command that sets an interface up for a device."""
    data = f" dbitrate {device.data_bitrate} fd on" if device.data_bitrate else ""
    return f"sudo ip link set {name} up type can bitrate {device.bitrate}{data}"


def mismatch(link: CanLink, name: str, device: Can) -> str | None:
    """Return in words why a device cannot be on an interface as it is set, and the command that mends it, or None."""
    mend = f"sudo ip link set {name} down && {set_up(name, device)}"
    if not link.bitrate:
        return f"{name} has no bit rate; {set_up(name, device)}"
    if link.bitrate != device.bitrate:
        return f"{name} runs at {link.bitrate} bit/s, the device at {device.bitrate}; {mend}"
    if device.data_bitrate and not link.is_fd:
        return f"{name} carries no CAN-FD, which the device needs; {mend}"
    if device.data_bitrate and link.data_bitrate != device.data_bitrate:
        return f"{name} sends data at {link.data_bitrate} bit/s, the device at {device.data_bitrate}; {mend}"
    if link.state == "BUS-OFF":
        return f"{name} is bus-off; sudo ip link set {name} type can restart, or down and up again"
    return None


def advice(link: CanLink, name: str) -> list[str]:
    """Return what should be changed of an interface that works."""
    words = []
    if link.state == "ERROR-PASSIVE":
        words.append(f"{name} {can_errors.ADVICE['error_passive']}")
    low, high = USUAL_SAMPLE_POINTS
    if link.sample_point and not low <= link.sample_point <= high:
        words.append(
            f"{name} samples at {link.sample_point:.0%} of a bit, most nodes at {low:.0%} to {high:.0%}; that makes "
            f"errors on long wires: sudo ip link set {name} type can bitrate {link.bitrate} sample-point 0.8"
        )
    if link.queue_length < SHORT_QUEUE:
        words.append(
            f"the transmit queue of {name} holds {link.queue_length} frames, fewer than a burst of a hand: "
            f"sudo ip link set {name} txqueuelen 1000"
        )
    return words
