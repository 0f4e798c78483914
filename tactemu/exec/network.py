"""The view's own network of loopback and CAN buses, in the keeper.

A bus is an interface of the view: a vcan if the kernel has one, else an end of a veth pair, which carries the frames of
programs with the preload library (see ``preload/can.c``).
"""

from __future__ import annotations

import errno
import os
import socket
import struct
from pathlib import Path

from tactemu.exec import system

NATIVE, PRELOAD = "native", "preload"
_TAG_BUS = 0x00FA
"""The protocol number of frames from the bus, as in ``preload/can.c``."""
_ALL = 3  # ETH_P_ALL
_ATTACH_FILTER = 26
_MTU, _ARPHRD_CAN = 72, 280

_NEWLINK, _DELLINK = 16, 17
_REQUEST, _ACK, _CREATE, _EXCLUSIVE = 1, 4, 0x400, 0x200
_HEADER, _LINK, _ATTRIBUTE = struct.Struct("=IHHII"), struct.Struct("=BxHiII"), struct.Struct("=HH")
_NAME, _MTU_OF, _INFO, _KIND, _DATA, _PEER, _SPEC, _INET6, _ADDRESSES = 3, 4, 18, 1, 2, 1, 26, 10, 8
_UP = 1


class Network:
    """A network namespace with buses, which this process enters with the first bus.

    Args:
        room: the folder with the files for the preload library.
    """

    def __init__(self, room: Path):
        self._room = room
        self._buses: dict[str, str] = {}
        """The way in which each bus was made, by name."""

    def plug(self, name: str, way: str) -> tuple[str, list[int]]:
        """Make a bus, and return its way and the descriptors of the sockets for reading and for writing frames.

        Args:
            name: the name of the interface.
            way: ``native`` or ``preload``; empty: native if this kernel can, else preload.

        Raises:
            OSError: the kernel refuses it.
            ValueError: the interface exists, or the kernel has no vcan.
        """
        if not self._buses and not os.path.exists(self._room / "network"):
            self._enter()
        if name in self._buses:
            raise ValueError(f"{name} exists already")
        way = self._make(name, way)
        self._buses[name] = way
        try:
            self._describe(name, way)
            sockets = _of_kernel(name) if way == NATIVE else _of_packets(name)
        except BaseException:
            self.unplug(name)
            raise
        return way, [each.detach() for each in sockets]

    def unplug(self, name: str) -> None:
        """Remove an interface, as when its adapter is unplugged."""
        del self._buses[name]
        _ask(_DELLINK, 0, _LINK.pack(0, 0, 0, 0, 0) + _text(_NAME, name))
        for each in Path("/sys/class/net", name).glob("*"):
            each.unlink()
        if os.path.isdir(f"/sys/class/net/{name}"):
            os.rmdir(f"/sys/class/net/{name}")

    def socket(self) -> list[int]:
        """Return the descriptor of a TCP socket of this network, to connect to a server in the view."""
        return [socket.socket().detach()]

    def listen(self, port: int) -> list[int]:
        """Return the descriptor of a TCP socket that listens on this network's loopback.

        Raises:
            OSError: the port is taken.
        """
        return [socket.create_server(("127.0.0.1", port)).detach()]

    def unplug_all(self) -> None:
        """Remove all interfaces, after the emulator has ended."""
        for name in list(self._buses):
            self.unplug(name)

    def _enter(self) -> None:
        system.unshare(system.CLONE_NEWNET)
        (self._room / "network").touch()
        _set_up("lo")
        system.mount(
            "tmpfs", "/sys/class/net", "tmpfs", system.MS_NOSUID, "mode=755"
        )  # hides the machine's interfaces, which are not in this network

    def _make(self, name: str, way: str) -> str:
        if way != PRELOAD:
            try:
                _add(name, "vcan")
                return NATIVE
            except OSError as error:
                if error.errno != errno.EOPNOTSUPP:
                    raise
                if way == NATIVE:
                    raise ValueError("this kernel has no vcan; load it: sudo modprobe vcan") from None
        (self._room / "can").touch()
        _add(name, "veth", f"far.{name[:11]}")
        _set_up(f"far.{name[:11]}")
        return PRELOAD

    def _describe(self, name: str, way: str) -> None:
        _set_up(name)
        folder = Path("/sys/class/net", name)
        folder.mkdir()
        told = {"type": _ARPHRD_CAN, "mtu": _MTU, "ifindex": socket.if_nametoindex(name), "flags": "0x400c1"}
        state = {"operstate": "up", "carrier": 1, "tx_queue_len": 10}
        for file, value in (told | state).items():
            (folder / file).write_text(f"{value}\n", encoding="ascii")


def _of_kernel(name: str) -> list[socket.socket]:
    made = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    made.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    made.bind((name,))
    return [made]


def _of_packets(name: str) -> list[socket.socket]:
    """Return a socket that receives the frames sent through the interface by others, and one that only sends."""
    receiver, sender = (socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) for _ in range(2))
    others = [
        (0x20, 0, 0, 0xFFFFF004),  # load the direction of the packet
        (0x15, 1, 0, socket.PACKET_OUTGOING), (0x06, 0, 0, 0),
        (0x20, 0, 0, 0xFFFFF000),  # load its protocol
        (0x15, 0, 1, _TAG_BUS), (0x06, 0, 0, 0),
        (0x06, 0, 0, 0xFFFF),
    ]  # fmt: skip
    for each, lines in ((receiver, others), (sender, [(0x06, 0, 0, 0)])):
        program = b"".join(struct.pack("=HBBI", *line) for line in lines)
        with system.buffer(program) as address:
            each.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, struct.pack("HxxxxxxP", len(lines), address))
    receiver.bind((name, _ALL))
    sender.bind((name, _TAG_BUS))
    return [receiver, sender]


# -- netlink -----------------------------------------------------------------------------------------------------------


def _add(name: str, kind: str, peer: str = "") -> None:
    data = _attribute(_DATA, _attribute(_PEER, _LINK.pack(0, 0, 0, 0, 0) + _own(peer))) if peer else b""
    info = _attribute(_INFO, _text(_KIND, kind) + data)
    up = 0 if peer else _UP  # up at once unless it needs a peer, so that no program finds it down
    _ask(_NEWLINK, _CREATE | _EXCLUSIVE, _LINK.pack(0, 0, 0, up, up) + _own(name) + info)


def _own(name: str) -> bytes:
    return _text(_NAME, name) + _attribute(_MTU_OF, struct.pack("=I", _MTU))


def _set_up(name: str) -> None:
    """Set an interface up without IPv6 addresses, whose packets do not belong on a CAN bus."""
    silent = b""
    if name != "lo":
        silent = _attribute(_SPEC, _attribute(_INET6, _attribute(_ADDRESSES, b"\1")))
    index = socket.if_nametoindex(name)
    try:
        _ask(_NEWLINK, 0, _LINK.pack(0, 0, index, 0, 0) + silent)
    except OSError:  # a kernel without IPv6, or a vcan, which has no addresses
        pass
    _ask(_NEWLINK, 0, _LINK.pack(0, 0, index, _UP, _UP))


def _attribute(kind: int, data: bytes) -> bytes:
    return _ATTRIBUTE.pack(_ATTRIBUTE.size + len(data), kind) + data + bytes(-len(data) % 4)


def _text(kind: int, text: str) -> bytes:
    return _attribute(kind, text.encode() + b"\0")


def _ask(kind: int, flags: int, body: bytes) -> None:
    """Send a request for a change of interfaces to the kernel.

    Raises:
        OSError: the kernel refuses it.
    """
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as wire:
        wire.send(_HEADER.pack(_HEADER.size + len(body), kind, flags | _REQUEST | _ACK, 1, 0) + body)
        (number,) = struct.unpack_from("=i", wire.recv(65_536), _HEADER.size)
    if number:
        raise OSError(-number, os.strerror(-number))
