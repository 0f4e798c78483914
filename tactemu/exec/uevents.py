"""The messages of the kernel and of udev when a device is plugged in or out (``NETLINK_KOBJECT_UEVENT``).

The kernel's message is ``ACTION@DEVPATH`` and properties, each with a final zero. Udev's has a header with hashes of
subsystem and type, by which libudev filters in the kernel (systemd, ``src/libsystemd/sd-device/device-monitor.c``).
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
    """The sender of events to all listeners in the view, whose sockets are in the folder of their group."""

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
        """Send the event of one device; ``properties`` are the kernel's, ``udev`` those that udev's rules add."""
        self._number += 1
        told = {"ACTION": action, "DEVPATH": devpath, **properties, "SEQNUM": str(self._number)}
        self._to("kernel", f"{action}@{devpath}\0".encode() + _listed(told))
        self._to("udev", _for_udev({**told, **udev}))

    def _to(self, group: str, message: bytes) -> None:
        for path in (self._folder / group).iterdir():
            try:
                self._senders[group].sendto(message, str(path))
            except BlockingIOError:
                pass  # the listener does not read: the message is lost, as with the kernel
            except OSError:
                path.unlink(missing_ok=True)  # no process has it open any more

    def tidy(self) -> None:
        """Remove sockets that no process has open."""
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
    """Return MurmurHash2 with seed 0, as libudev computes it."""
    factor, mask = 0x5BD1E995, 0xFFFF_FFFF
    result = len(data)
    aligned = len(data) // 4 * 4
    for (word,) in struct.iter_unpack("<I", data[:aligned]):
        word = word * factor & mask
        word = (word ^ word >> 24) * factor & mask
        result = (result * factor & mask) ^ word
    if tail := data[aligned:]:
        result = (result ^ int.from_bytes(tail, "little")) * factor & mask
    result = (result ^ result >> 13) * factor & mask
    return result ^ result >> 15
