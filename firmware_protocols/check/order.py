"""One taxel at a time: which bits of what is sent belong to it, and in which order they follow.

Pressing taxels one by one would take n conversions. Instead they are pressed in pairs of groups, each taxel in one
group of every pair, no two taxels alike: a bit that moves for exactly one group of each pair is one taxel's own, and
the groups say whose. Sums and checksums move for both.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check.examples import examples_with
from firmware_protocols.check.facts import order, order_of, reordered, said, ways, words_of
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.memory import memory_of
from firmware_protocols.check.report import Fault
from firmware_protocols.frames import payload
from firmware_protocols.layouts import Layout

AMOUNTS = (2.7, 0.31)
"""Newtons."""
SPARE_PAIRS = 12
"""More than tell the taxels apart, or a bit of a checksum, the parity of many taxels, may by chance look like one."""
PRESSING = "pressing one taxel at a time finds"

Look = tuple[tuple[Any, str], ...]
"""Requests with their ports; then what the last answers and the next conversion sends is looked at."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Taxels that nothing shows, orders that differ from what is declared, declared orders without effect."""
    if len(subject.make().layout) < 2:
        return
    try:
        sights = _sights(subject)
        if not sights and subject.options and not subject.commands:
            return  # the commands are documented for the device as it comes
        texts = list(_judged(subject, sights)) if sights else ["no request and no stream shows the touch"]
        shows_taxels = any((owners >= 0).any() for owners in sights.values())
        if shows_taxels and not texts and _without_effect(subject, sights):
            texts = ["reversing layout.wire_order changes no byte: send layout.on_wire(values), or bind a table to it"]
    except AuthorError as error:
        yield Fault.of("order", error)
        return
    file, line = source_line(subject.cls)
    yield from (Fault("order", text, file, line) for text in texts)


class _Watcher:
    """Shows a device to pushes, always from the same state."""

    def __init__(self, subject: Subject):
        self.host = Host(subject.make())
        self.state, self.t_ns = self.host.device.snapshot(), self.host.t_ns

    def sight(self, look: Look, newtons: Any) -> np.ndarray:
        """Return the bits of all that is sent; pressed before the last request, as those before may set a zero."""
        host = self.host
        host.device.restore(self.state)
        host.t_ns, host.pushes = self.t_ns, 0.0
        for request, port in look[:-1]:
            host.send(request, port)
        host.pushes = newtons
        for stream in host.device.periods:
            host.measure(stream)
        sent = [frame for request, port in look[-1:] for frame in host.send(request, port)]
        sent = sent + host.convert()
        if not look and (memory := memory_of(host.device)) is not None:
            sent.append(memory.everything(host.t_ns))
        return np.unpackbits(np.frombuffer(b"".join(_of_fixed_length(payload(frame)) for frame in sent), np.uint8))


def _of_fixed_length(data: bytes) -> bytes:
    """Return a frame as it is; of a line of text, each number in 8 bytes."""
    if not data.isascii() or not data.decode("ascii").translate(_SPACES).isprintable():
        return data
    return re.sub(rb"[-+]?\d+(?:\.\d+)?", lambda found: struct.pack(">d", float(found[0])), data)


_SPACES = str.maketrans("\r\n\t", "   ")


def _looks(subject: Subject) -> list[Look]:
    """Nothing, each documented command after what goes before it, and what the examples send."""
    looks: list[Look] = [()]
    for command in subject.commands:
        requests = (*command.after, command.request)
        looks.append(tuple((request, command.port) for request in requests))
    for example in examples_with(subject):
        texts = [*example.after, *([example.request] if example.request is not None else [])]
        looks.append(tuple((text, example.port) for text in texts))
    return list(dict.fromkeys(looks))


def _sights(subject: Subject) -> dict[Look, np.ndarray]:
    """By look: for each bit of what is sent, the taxel that it belongs to, or -1."""
    watcher = _Watcher(subject)
    n = len(watcher.host.device.layout)
    sights: dict[Look, np.ndarray] = {}
    for look in _looks(subject):
        if _moves(watcher, look):
            sights[look] = _owners(watcher, look, n)
            if memory_of(watcher.host.device) is not None and len(_following(sights[look])) == n:
                break  # all registers have been seen: commands that read some of them tell no more
    return sights


def _moves(watcher: _Watcher, look: Look) -> bool:
    return not np.array_equal(watcher.sight(look, 0.0), watcher.sight(look, AMOUNTS[0]))


def _codes(n: int) -> np.ndarray:
    """Which group of each pair a taxel is in; shape ``(n_pairs, n)``, bool, no two columns alike."""
    bits = max(1, (n - 1).bit_length())
    codes = (np.arange(n) >> np.arange(bits)[:, None] & 1).astype(bool)
    more = np.random.default_rng(1).random((SPARE_PAIRS, n)) < 0.5
    return np.concatenate([codes, more])


def _owners(watcher: _Watcher, look: Look, n: int) -> np.ndarray:
    """Empty where frames change their length as taxels are pressed: nothing can be told then."""
    codes = _codes(n)
    rest = watcher.sight(look, 0.0)
    owner = np.full(rest.size, -1)
    for amount in AMOUNTS:
        moved = np.zeros((2, len(codes), rest.size), bool)
        for k, code in enumerate(codes):
            for side, group in enumerate((~code, code)):
                seen = watcher.sight(look, amount * group)
                if seen.size != rest.size:
                    return owner[:0]
                moved[side, k] = seen != rest
        own = (moved[0] ^ moved[1]).all(axis=0)
        bits = codes[: max(1, (n - 1).bit_length())]
        taxel = (moved[1, : len(bits)] * (1 << np.arange(len(bits)))[:, None]).sum(axis=0)
        own &= taxel < n
        own[own] = (moved[1][:, own] == codes[:, taxel[own]]).all(axis=0)
        owner = np.where(own & (owner < 0), taxel, owner)
    return owner


def _judged(subject: Subject, sights: dict[Look, np.ndarray]) -> Iterator[str]:
    layout = subject.make().layout
    n = len(layout)
    shown, open_length = np.unique(np.concatenate(list(sights.values()))), any(not len(o) for o in sights.values())
    blind = np.setdiff1d(np.arange(n), shown)
    # None at all: only sums are sent. With options: the examples are of the device as it comes.
    if 0 < len(blind) < n and not open_length and not subject.options:
        few = ", ".join(map(str, blind[:5].tolist())) + (" …" if len(blind) > 5 else "")
        yield f"{len(blind)} of {n} taxels move no bit of their own in what any command or example sends: {few}"
        return
    for owners in sights.values():
        found = _following(owners)
        declared = layout.wire_order[np.isin(layout.wire_order, found)]
        if len(found) > 1 and not np.array_equal(found, declared):
            yield f"layout.wire_order says {_worded(layout, declared)}, {PRESSING} {_worded(layout, found)}"
            return
        if n > 1 and len(found) == n:
            yield from _against_words(subject, layout, found)


def _following(owners: np.ndarray) -> np.ndarray:
    """Return taxels in the order in which their first bits stand."""
    taxels, first = np.unique(owners, return_index=True)
    return taxels[taxels >= 0][np.argsort(first[taxels >= 0])]


def _against_words(subject: Subject, layout: Layout, found: np.ndarray) -> Iterator[str]:
    spoken = said(words_of(subject.cls))
    if spoken and not _fits(layout, spoken, found) and all(patch.rows for patch in layout.patches):
        yield f"tables and docstring say {' and '.join(map(repr, spoken))}, {PRESSING} {_worded(layout, found)}"


def _fits(layout: Layout, spoken: list[str], found: np.ndarray) -> bool:
    """Whether one of the ways is that of all patches, or each patch follows one of them."""
    if any(np.array_equal(order(layout, way), found) for way in spoken):
        return True
    runs = np.split(found, np.cumsum([len(patch) for patch in layout.patches])[:-1])
    return all(
        any(np.array_equal(run, order_of(patch, way)) for way in spoken) for patch, run in zip(layout.patches, runs)
    )


def wordless(subject: Subject) -> list[str]:
    """Return a fact that nothing pins: how the taxels of a grid follow, where no text says it."""
    layout = subject.make().layout
    grids = any(patch.rows > 1 and patch.cols > 1 for patch in layout.patches)
    return (
        ["the order of the taxels: no table or docstring says it in words"]
        if grids and not said(words_of(subject.cls))
        else []
    )


def _worded(layout: Layout, found: np.ndarray) -> str:
    if len(found) == len(layout) and (fitting := ways(layout, found)):
        return repr(fitting[0])
    return " ".join(map(str, found[:8].tolist())) + (" …" if len(found) > 8 else "")


def _without_effect(subject: Subject, sights: dict[Look, np.ndarray]) -> bool:
    n = len(subject.make().layout)
    newtons = 0.2 + 2.0 * np.arange(n) / n
    plain = _Watcher(subject)
    with reordered(subject.cls, lambda layout: layout.wire_order[::-1]), subject.changed():
        other = _Watcher(subject)
        pairs: Sequence[tuple[np.ndarray, np.ndarray]] = [
            (plain.sight(look, newtons), other.sight(look, newtons)) for look in sights
        ]
    return all(np.array_equal(mine, theirs) for mine, theirs in pairs)
