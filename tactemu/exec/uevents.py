"""The messages that the kernel and udev send when a device comes or goes (``NETLINK_KOBJECT_UEVENT``).

The kernel's is ``ACTION@DEVPATH`` and properties, each ended by a zero. Udev's has a header with hashes of subsystem
and type, by which libudev filters in the kernel (systemd, ``src/libsystemd/sd-device/device-monitor.c``).
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Mapping
from pathlib import Path

_HEADER = struct.Struct("=8s4s3I4s4s8x")
_MAGIC = bytes.fromhex("feedcafe")


class Events:
    """Sends to everybody who listens in the view: each has a socket in the folder of its group."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._number = 0
        self._senders: dict[str, socket.socket] = {}
        for group in ("none", "kernel", "udev"):
            (folder / group).mkdir(parents=True)
            (folder / group).chmod(0o1777)
        for group in ("kernel", "udev"):
            sender = self._senders[group] = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
            sender.bind(str(folder / f"from-{group}"))

    def send(self, action: str, devpath: str, properties: Mapping[str, str], udev: Mapping[str, str]) -> None:
        """Tell of one device; ``properties`` are the kernel's, ``udev`` those that its rules add."""
        self._number += 1
        told = {"ACTION": action, "DEVPATH": devpath, **properties, "SEQNUM": str(self._number)}
        self._to("kernel", f"{action}@{devpath}\0".encode() + _listed(told))
        self._to("udev", _for_udev({**told, **udev}))

    def _to(self, group: str, message: bytes) -> None:
        for path in (self._folder / group).iterdir():
            try:
                self._senders[group].sendto(message, str(path))
            except BlockingIOError:
                pass  # it does not read: lost, as with the kernel
            except OSError:
                path.unlink(missing_ok=True)  # nobody has it open any more

    def tidy(self) -> None:
        """Forget sockets that nobody has open."""
        for path in (self._folder / "none").iterdir():
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
                try:
                    probe.connect(str(path))
                except OSError:
                    path.unlink(missing_ok=True)


def _listed(properties: Mapping[str, str]) -> bytes:
    return b"".join(os.fsencode(f"{key}={value}\0") for key, value in properties.items())


def _for_udev(properties: Mapping[str, str]) -> bytes:
    body = _listed(properties)
    hashes = [
        struct.pack(">I", _hash(properties[key].encode()) if key in properties else 0)
        for key in ("SUBSYSTEM", "DEVTYPE")
    ]
    size = _HEADER.size
    return _HEADER.pack(b"libudev\0", _MAGIC, size, size, len(body), *hashes) + body


def _hash(data: bytes) -> int:
    """MurmurHash2 with seed 0, as libudev computes it."""
    factor, mask = 0x5BD1E995, 0xFFFF_FFFF
    result = len(data)
    whole = len(data) // 4 * 4
    for (word,) in struct.iter_unpack("<I", data[:whole]):
        word = word * factor & mask
        word = (word ^ word >> 24) * factor & mask
        result = (result * factor & mask) ^ word
    if rest := data[whole:]:
        result = (result ^ int.from_bytes(rest, "little")) * factor & mask
    result = (result ^ result >> 13) * factor & mask
    return result ^ result >> 15
