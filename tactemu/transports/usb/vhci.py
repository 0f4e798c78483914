"""The client side of USB/IP: plugs the devices of a server into this machine's kernel (module ``vhci-hcd``, as root).

``usbip attach`` does the same once; here a device that the server unplugs is attached again when it is back.
"""

from __future__ import annotations

import re
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tactemu.base.errors import TactemuError, reason_of
from tactemu.transports import inet
from tactemu.transports.usb import usbip_protocol as protocol

VHCI = Path("/sys/devices/platform/vhci_hcd.0")
FREE = 4
"""The state of a port of the virtual hub to which nothing is attached."""
_TIMEOUT_S = 5.0
_RETRY_S = 0.2
_ABOUT_BYTES = 312


@dataclass(frozen=True)
class RemoteDevice:
    """A device that a server lists."""

    busid: str
    vid: int
    pid: int


def _connected(host: str, port: int) -> socket.socket:
    link = socket.create_connection((host, port), timeout=_TIMEOUT_S)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return link


def _received(link: socket.socket, count: int) -> bytes:
    data = link.recv(count, socket.MSG_WAITALL)
    if len(data) < count:
        raise ConnectionError("the server closed the connection")
    return data


def listed(host: str, port: int) -> list[RemoteDevice]:
    """Return the devices of a server.

    Raises:
        TactemuError: nothing listens there, or it does not speak USB/IP.
    """
    try:
        with _connected(host, port) as link:
            link.sendall(protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_DEVLIST, 0))
            _, code, status = protocol.OP.unpack(_received(link, protocol.OP.size))
            if code != protocol.OP_REP_DEVLIST or status:
                raise ConnectionError(f"answer {code:04X}, status {status}")
            devices = []
            for _ in range(int.from_bytes(_received(link, 4), "big")):
                about = _received(link, _ABOUT_BYTES)
                vid, pid = struct.unpack_from(">HH", about, 300)
                devices.append(RemoteDevice(about[256:288].rstrip(b"\0").decode(errors="replace"), vid, pid))
                _received(link, 4 * about[-1])
            return devices
    except OSError as error:
        raise TactemuError(
            f"no USB/IP at {inet.join(host, port)}: {reason_of(error)}; start `tactemu run ... --port usbip:` there"
        ) from None


def attach(host: str, port: int, busid: str) -> int:
    """Plug a device into this machine's kernel, and return the port of the virtual hub.

    Raises:
        TactemuError: the server does not give the device now, the kernel has no ``vhci-hcd``, or we are not root.
    """
    if not VHCI.exists():
        raise TactemuError("this kernel has no virtual USB hub: sudo modprobe vhci-hcd")
    try:
        with _connected(host, port) as link:
            link.sendall(
                protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_IMPORT, 0) + busid.encode().ljust(32, b"\0")
            )
            _, _, status = protocol.OP.unpack(_received(link, protocol.OP.size))
            if status:
                raise ConnectionError("it is in use, or unplugged")
            bus, device, speed = struct.unpack_from(">III", _received(link, _ABOUT_BYTES), 288)
            link.settimeout(None)
            free = next((number for number, state in _ports() if state == FREE), None)
            if free is None:
                raise ConnectionError("no port of the virtual hub is free")
            (VHCI / "attach").write_text(f"{free} {link.fileno()} {bus << 16 | device} {speed}")
            return free
    except PermissionError:
        raise TactemuError("attaching a device needs root: sudo $(which tactemu) attach ...") from None
    except OSError as error:
        raise TactemuError(f"{inet.join(host, port)} does not give {busid}: {reason_of(error)}") from None


def detach(number: int) -> None:
    """Unplug the device at a port of the virtual hub."""
    (VHCI / "detach").write_text(str(number))


def is_attached(number: int) -> bool:
    """Return True while a device is attached to a port of the virtual hub."""
    return dict(_ports()).get(number, FREE) != FREE


def _ports() -> Iterator[tuple[int, int]]:
    """Yield the number and the state of each port for devices of full and high speed."""
    for line in (VHCI / "status").read_text().splitlines():
        if found := re.match(r"hs\s+(\d+)\s+(\d+)", line):
            yield int(found[1]), int(found[2])


def keep_attached(host: str, port: int, busids: list[str]) -> Iterator[str]:
    """Attach devices, attach each again when it is back, and yield what happens in words; detach them at the end.

    Raises:
        TactemuError: a device cannot be attached at the beginning.
    """
    at = {busid: attach(host, port, busid) for busid in busids}
    try:
        for busid in busids:
            yield f"{busid} attached"
        while True:
            time.sleep(_RETRY_S)
            for busid, number in list(at.items()):
                if number >= 0 and not is_attached(number):
                    at[busid] = -1
                    yield f"{busid} unplugged"
                elif number < 0:
                    try:
                        at[busid] = attach(host, port, busid)
                    except TactemuError:  # not back yet
                        continue
                    yield f"{busid} attached again"
    finally:
        for number in at.values():
            if number >= 0 and is_attached(number):
                detach(number)
