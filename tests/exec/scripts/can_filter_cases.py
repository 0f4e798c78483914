"""The cases of :mod:`can_behaviour` about filters."""

import struct

from can_kit import (
    EFF,
    ERR,
    ERRORS,
    FD,
    FILTER,
    JOIN,
    LOOPBACK,
    OWN,
    RAW,
    RTR,
    case,
    filters,
    frame,
    heard,
    node,
    tried,
)

SENT = [
    0x000, 0x123, 0x124, 0x7FF, 0x123 | RTR, 0x123 | EFF, 0x1ABCDEF0 & 0x1FFFFFFF | EFF, 0x123 | EFF | RTR, 0x5FF,
    ERR | 0x40, ERR | 0x4, ERR | 0x100, 0x800,
]  # fmt: skip
LISTS = {
    "none": filters(),
    "all": filters((0, 0)),
    "one": filters((0x123, 0x7FF)),
    "one exactly": filters((0x123, 0x7FF | EFF | RTR)),
    "extended": filters((0x123 | EFF, 0x1FFFFFFF | EFF)),
    "extended of standard": filters((0x123, 0x1FFFFFFF | EFF)),
    "extended exactly": filters((0x123 | EFF, 0x1FFFFFFF | EFF | RTR)),
    "remote": filters((RTR, RTR)),
    "inverted": filters((0x123 | ERR, 0x7FF)),
    "two": filters((0x123, 0x7FF), (0x7FF, 0x7FF)),
    "overlapping": filters((0x123, 0x7FF), (0x120, 0x7F0)),
    "two inverted": filters((0x123 | ERR, 0x7FF), (0x124 | ERR, 0x7FF)),
    "errors by filter": filters((0, ERR | 0x40)),
    "errors and data": filters((0, ERR | 0x40), (0x123, 0x7FF)),
    "zero mask": filters((0x55, 0)),
    "inverted zero mask": filters((0x55 | ERR, 0)),
}


def _filtered(join):
    found = {}
    for name, packed in LISTS.items():
        for errors in (0,) if join else (0, 0x1FFFFFFF, 0x40):  # the kernel gives some errors twice to who joins
            with node(FILTER=packed, JOIN=join, ERRORS=struct.pack("=I", errors)) as reader, node() as writer:
                for ident in SENT:
                    writer.send(frame(ident))
                found[f"{name}, errors {errors:x}"] = heard(reader)
    return found


@case
def filters_any():
    return _filtered(0)


@case
def filters_joined():
    return _filtered(1)


@case
def filters_kept():
    with node(FILTER=filters((0x123, 0x7FF), (0x5 | ERR, 0x7))) as one:
        told = [one.getsockopt(RAW, FILTER, 64).hex(), one.getsockopt(RAW, ERRORS, 4).hex()]
        one.setsockopt(RAW, FD, 1)
        told += [one.getsockopt(RAW, FILTER, 64).hex(), one.getsockopt(RAW, FD), one.getsockopt(RAW, LOOPBACK)]
        told += [one.getsockopt(RAW, OWN), one.getsockopt(RAW, JOIN), tried(one.getsockopt, RAW, 99)]
        told += [tried(one.setsockopt, RAW, FILTER, bytes(7)), tried(one.setsockopt, RAW, 99, 1)]
        told += [tried(one.setsockopt, RAW, FILTER, bytes(8 * 513)), tried(one.setsockopt, RAW, FD, b"\1")]
        told += [tried(one.getsockopt, RAW, FILTER, 8)]
        one.setsockopt(RAW, FILTER, filters(*((k, 0x7FF) for k in range(512))))
        with node() as writer:
            for ident in (0, 1, 255, 511, 512, 600):
                writer.send(frame(ident))
        return [*told, heard(one)]


@case
def filters_while_waiting():
    with node() as reader, node() as writer:
        writer.send(frame(0x11))
        reader.setsockopt(RAW, FILTER, filters((0x22, 0x7FF)))
        writer.send(frame(0x22))
        writer.send(frame(0x33))
        return heard(reader)
