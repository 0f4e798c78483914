"""The check of the order of the taxels on the wire: it finds the bits that belong to each taxel.

Pressing taxels one by one would take n conversions. Instead they are pressed in pairs of groups, each taxel in one
group of every pair, no two taxels in the same groups: a bit that changes for exactly one group of each pair belongs to
one taxel, which the groups identify. Sums and checksums change for both.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check.examples import examples_with
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.memory import memory_of
from firmware_protocols.check.mutations import words_of
from firmware_protocols.check.report import Fault
from firmware_protocols.check.taxel_orders import matching_names, names_in, patch_order, reordered, wire_order_of
from firmware_protocols.frames import payload
from firmware_protocols.layouts import Layout

PUSHES_N = (2.7, 0.31)
"""The pushes on pressed taxels."""
SPARE_PAIRS = 12
"""The number of pairs beyond those that identify a taxel; fewer would take some bits of a checksum for a taxel's."""
PRESSING = "pressing one taxel at a time finds"

Query = tuple[tuple[Any, str], ...]
"""Requests with their ports; the answer to the last one and the frames of the next conversion are compared."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield taxels without bits of their own, orders that differ from the declared one, and orders without effect."""
    if len(subject.make().layout) < 2:
        return
    try:
        owners = _owners_by_query(subject)
        if not owners and subject.options and not subject.commands:
            return  # the commands are documented for the device with its default options
        texts = list(_order_faults(subject, owners)) if owners else ["no answer and no stream changes under a push"]
        has_taxels = any((each >= 0).any() for each in owners.values())
        if has_taxels and not texts and _has_no_effect(subject, owners):
            texts = ["reversing layout.wire_order changes no byte: send layout.on_wire(values), or bind a table to it"]
    except AuthorError as error:
        yield Fault.of("order", error)
        return
    file, line = source_line(subject.cls)
    yield from (Fault("order", text, file, line) for text in texts)


class _BitReader:
    """A reader of the bits that a device sends under pushes, always from the same state."""

    def __init__(self, subject: Subject):
        self.host = Host(subject.make())
        self.state, self.t_ns = self.host.device.snapshot(), self.host.t_ns

    def bits(self, query: Query, newtons: Any) -> np.ndarray:
        """Return the bits of all frames; taxels are pressed before the last request, as earlier ones may set a zero."""
        host = self.host
        host.device.restore(self.state)
        host.t_ns, host.pushes = self.t_ns, 0.0
        for request, port in query[:-1]:
            host.send(request, port)
        host.pushes = newtons
        for stream in host.device.periods:
            host.measure(stream)
        sent = [frame for request, port in query[-1:] for frame in host.send(request, port)]
        sent = sent + host.convert()
        if not query and (memory := memory_of(host.device)) is not None:
            sent.append(memory.read_all(host.t_ns))
        return np.unpackbits(np.frombuffer(b"".join(_of_fixed_length(payload(frame)) for frame in sent), np.uint8))


def _of_fixed_length(data: bytes) -> bytes:
    """Return a frame as it is; a line of text with each number in 8 bytes."""
    if not data.isascii() or not data.decode("ascii").translate(_SPACES).isprintable():
        return data
    return re.sub(rb"[-+]?\d+(?:\.\d+)?", lambda found: struct.pack(">d", float(found[0])), data)


_SPACES = str.maketrans("\r\n\t", "   ")


def _queries(subject: Subject) -> list[Query]:
    """Return the empty query, each documented command with the requests before it, and the requests of examples."""
    queries: list[Query] = [()]
    for command in subject.commands:
        requests = (*command.after, command.frame)
        queries.append(tuple((request, command.port) for request in requests))
    for example in examples_with(subject):
        texts = [*example.after, *([example.request] if example.request is not None else [])]
        queries.append(tuple((text, example.port) for text in texts))
    return list(dict.fromkeys(queries))


def _owners_by_query(subject: Subject) -> dict[Query, np.ndarray]:
    """Return, for each query under which a push changes bits, the taxel of each bit, or -1."""
    reader = _BitReader(subject)
    n = len(reader.host.device.layout)
    owners: dict[Query, np.ndarray] = {}
    for query in _queries(subject):
        if not np.array_equal(reader.bits(query, 0.0), reader.bits(query, PUSHES_N[0])):
            owners[query] = _owners(reader, query, n)
            if memory_of(reader.host.device) is not None and len(_taxels_in_order(owners[query])) == n:
                break  # all registers have been read, so commands that read some of them add nothing
    return owners


def _codes(n: int) -> np.ndarray:
    """Return the group of each pair that a taxel is in; shape ``(n_pairs, n)``, bool, no two columns alike."""
    bits = max(1, (n - 1).bit_length())
    codes = (np.arange(n) >> np.arange(bits)[:, None] & 1).astype(bool)
    more = np.random.default_rng(1).random((SPARE_PAIRS, n)) < 0.5
    return np.concatenate([codes, more])


def _owners(reader: _BitReader, query: Query, n: int) -> np.ndarray:
    """Return the taxel of each bit, or -1; an empty array if a push changes the length of frames."""
    codes = _codes(n)
    rest = reader.bits(query, 0.0)
    owner = np.full(rest.size, -1)
    for push in PUSHES_N:
        changed = np.zeros((2, len(codes), rest.size), bool)
        for k, code in enumerate(codes):
            for side, group in enumerate((~code, code)):
                pressed = reader.bits(query, push * group)
                if pressed.size != rest.size:
                    return owner[:0]
                changed[side, k] = pressed != rest
        own = (changed[0] ^ changed[1]).all(axis=0)
        bits = codes[: max(1, (n - 1).bit_length())]
        taxel = (changed[1, : len(bits)] * (1 << np.arange(len(bits)))[:, None]).sum(axis=0)
        own &= taxel < n
        own[own] = (changed[1][:, own] == codes[:, taxel[own]]).all(axis=0)
        owner = np.where(own & (owner < 0), taxel, owner)
    return owner


def _order_faults(subject: Subject, owners: dict[Query, np.ndarray]) -> Iterator[str]:
    layout = subject.make().layout
    n = len(layout)
    shown, open_length = np.unique(np.concatenate(list(owners.values()))), any(not len(o) for o in owners.values())
    hidden = np.setdiff1d(np.arange(n), shown)
    # If all are hidden, the device sends only sums. With options, the examples do not apply: they are of the defaults.
    if 0 < len(hidden) < n and not open_length and not subject.options:
        few = ", ".join(map(str, hidden[:5].tolist())) + (" …" if len(hidden) > 5 else "")
        yield f"{len(hidden)} of {n} taxels change no bit of their own in the frames of any command or example: {few}"
        return
    for each in owners.values():
        found = _taxels_in_order(each)
        declared = layout.wire_order[np.isin(layout.wire_order, found)]
        if len(found) > 1 and not np.array_equal(found, declared):
            seen = _described(layout, found, declared)
            yield f"layout.wire_order is {_described(layout, declared)}, {PRESSING} {seen}"
            return
        if n > 1 and len(found) == n:
            yield from _contradicted_words(subject, layout, found)


def _taxels_in_order(owners: np.ndarray) -> np.ndarray:
    """Return the taxels in the order of their first bits."""
    taxels, first = np.unique(owners, return_index=True)
    return taxels[taxels >= 0][np.argsort(first[taxels >= 0])]


def _contradicted_words(subject: Subject, layout: Layout, found: np.ndarray) -> Iterator[str]:
    names = names_in(words_of(subject.cls))
    if names and not _matches(layout, names, found) and all(patch.rows for patch in layout.patches):
        said = wire_order_of(layout, names[0])
        yield f"tables and docstring say {' and '.join(map(repr, names))}, {PRESSING} {_described(layout, found, said)}"


def _matches(layout: Layout, names: list[str], found: np.ndarray) -> bool:
    """Return True if one of the named orders is that of all patches, or each patch has one of them."""
    if any(np.array_equal(wire_order_of(layout, name), found) for name in names):
        return True
    runs = np.split(found, np.cumsum([len(patch) for patch in layout.patches])[:-1])
    return all(
        any(np.array_equal(run, patch_order(patch, name)) for name in names) for patch, run in zip(layout.patches, runs)
    )


def undocumented(subject: Subject) -> list[str]:
    """Return the order of the taxels of a grid as an unpinned fact, if no text names it."""
    layout = subject.make().layout
    grids = any(patch.rows > 1 and patch.cols > 1 for patch in layout.patches)
    return (
        ["the order of the taxels: no table or docstring says it in words"]
        if grids and not names_in(words_of(subject.cls))
        else []
    )


def _described(layout: Layout, found: np.ndarray, other: np.ndarray | None = None) -> str:
    """Return the name of an order, or its first difference from another one, or its first taxels."""
    if len(found) == len(layout) and (names := matching_names(layout, found)):
        return repr(names[0])
    if other is not None and other.shape == found.shape and (places := np.flatnonzero(found != other)).size:
        first = [f"taxel {found[k]} at place {k}, not {other[k]}" for k in places[:2].tolist()]
        return ", ".join(first) + (f", and {len(places) - 2} more" if len(places) > 2 else "")
    return " ".join(map(str, found[:8].tolist())) + (" …" if len(found) > 8 else "")


def _has_no_effect(subject: Subject, queries: Iterable[Query]) -> bool:
    n = len(subject.make().layout)
    newtons = 0.2 + 2.0 * np.arange(n) / n
    plain = _BitReader(subject)
    with reordered(subject.cls, lambda layout: layout.wire_order[::-1]), subject.without_snapshots():
        other = _BitReader(subject)
        pairs: Sequence[tuple[np.ndarray, np.ndarray]] = [
            (plain.bits(query, newtons), other.bits(query, newtons)) for query in queries
        ]
    return all(np.array_equal(declared, reversed_) for declared, reversed_ in pairs)
