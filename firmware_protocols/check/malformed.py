"""Malformed requests: a documented request with other data, whose length and sum are valid again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from firmware_protocols.declared import frames_of
from firmware_protocols.device import Device
from firmware_protocols.frames import CanFrame, WireFrame, with_payload
from firmware_protocols.stuffing import ppp
from firmware_protocols.sums import SUMS

SIZES = (0, 1, 2, 3, 40)
"""The numbers of data bytes."""
FLAG = b"\x7e"
ORDERS: tuple[Literal["little", "big"], ...] = ("little", "big")


def malformed_requests(cls: type[Device], request: WireFrame) -> Iterator[tuple[int, WireFrame]]:
    """Yield requests like this one, but with zeros or FF as data, and the number of those bytes."""
    if isinstance(request, CanFrame):
        for n in SIZES:
            for head in (0, 1, 2):
                for fill in (b"\0", b"\xff"):
                    data = (request.data[:head] + fill * n)[: 64 if request.is_fd else 8]
                    yield len(data), with_payload(request, data)
        return
    if request.startswith(FLAG) and request.endswith(FLAG) and len(request) > 4:
        content = request[1:-1].replace(b"\x7d\x5e", FLAG).replace(b"\x7d\x5d", b"\x7d")
        yield from ((n, ppp(each)) for n, each in _by_sum(content))
        return
    found = list(_by_table(cls, request)) or list(_by_sum(request))
    yield from dict.fromkeys(found)


def _by_table(cls: type[Device], request: bytes) -> Iterator[tuple[int, WireFrame]]:
    """Yield requests packed by the device's own tables, which fill in lengths and sums."""
    for table in frames_of(cls):
        field = next((each for each in table.fields if each.is_open and each.kind == "bytes"), None)
        if field is None or any(isinstance(count, str) for each in table.fields for count in each.shape):
            continue
        values = table.unpack(request)
        for n in SIZES if values is not None else ():
            for fill in (b"\0", b"\xff"):
                yield n, table.pack(**{**(values or {}), field.name: fill * n})


def _by_sum(request: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield requests with the sum that its last bytes fit, changing every byte that could be its length."""
    for start, size, order, name in [*_sums_of(request), (0, 0, ORDERS[0], "")]:
        body = request[: len(request) - size] if size else request
        lengths = [at for at in range(min(8, len(body))) if 0 <= body[at] <= len(request)]
        for n in SIZES:
            for head in range(1, min(9, len(body) + 1)):
                cut = bytearray(body[:head] + bytes(n))
                for at in [None, *(at for at in lengths if at < head)]:
                    if at is not None:
                        cut[at] = (body[at] + len(cut) - len(body)) & 0xFF
                    check = SUMS[name].function(bytes(cut[start:])).to_bytes(size, order) if name else b""
                    yield n, bytes(cut) + check
                    if at is not None:
                        cut[at] = body[at]


def _sums_of(request: bytes) -> list[tuple[int, int, Literal["little", "big"], str]]:
    """Return start, size, byte order and name of the sums that the last bytes fit, two at most."""
    found: list[tuple[int, int, Literal["little", "big"], str]] = []
    for name, (function, size) in SUMS.items():
        for start in range(min(4, max(len(request) - size, 0))):
            value = function(request[start : len(request) - size])
            for order in ORDERS[: 1 if size == 1 else 2]:
                if request[len(request) - size :] == value.to_bytes(size, order):
                    found.append((start, size, order, name))
    return found[:2]
