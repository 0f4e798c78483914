"""The way of requests to the methods that answer them, which declare them with :func:`~firmware_protocols.command`.

A cutter (``self.packets``) cuts requests from what arrives. The one of a frame table tells them apart by a field
(``Packets(MESSAGE, by="command", ...)``), which the examples of each method have, too; one of CAN frames by the
identifier or a part of it (:mod:`firmware_protocols.can_requests`); a cutter of lines by the whole line, or by the
method's pattern. A method takes the :class:`Request` and returns what the firmware does; bytes, or
``None`` for no bytes, are the content of one answer, which :meth:`Device.reply` frames.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from firmware_protocols.commands import Handled, handled_in
from firmware_protocols.framing import Broken, Stage
from firmware_protocols.registers import Refused

REMOTE = -1
"""The length of the data of a remote frame, which has none."""
Device = Any
"""A device: :mod:`firmware_protocols.device` imports this module, not the other way round."""


class Request:
    """A request; the fields of its table are attributes, too.

    Attributes:
        packet: its bytes, without the end of a line, or its CAN frame.
        values: the numbers of its data, or the groups of its pattern; ``value`` is the first of them.
        t_ns: the time at which its last byte arrived.
        port: the port on which it arrived.
        why: the reason of :class:`Refused` for a request that is refused.
        wanted: the length of the data that its command has, for a request with data of another length.
    """

    why = ""
    wanted = 0

    def __init__(self, packet: Any, t_ns: int, port: str, fields: dict[str, Any]):
        vars(self).update(packet=packet, t_ns=t_ns, port=port, values=(), value=None)
        vars(self).update(fields)
        self.fields = fields

    def take(self, values: Sequence[Any]) -> None:
        """Set the numbers of the data, or the groups of the pattern; a field of the table keeps its name."""
        self.values = tuple(values)
        if values and "value" not in self.fields:
            self.value = values[0]

    packet: Any
    values: tuple[Any, ...]
    value: Any
    t_ns: int
    port: str

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...
        def __setattr__(self, name: str, value: Any) -> None: ...


@dataclass(frozen=True)
class Handler:
    """A method, with the requests that it answers."""

    method: str
    handled: Handled
    sizes: frozenset[int]
    """The lengths of the data in its examples."""

    @property
    def wanted(self) -> int:
        """The valid length, the greatest if there are several."""
        form = self.handled.data
        return max(self.sizes, default=0) if form is None else struct.calcsize(form.rstrip("*"))

    def values(self, data: bytes | None) -> tuple[Any, ...] | None:
        """Return the numbers in the data of a request, ``None`` if their length is not valid."""
        form = self.handled.data
        if form is None:
            return () if not self.sizes or (REMOTE if data is None else len(data)) in self.sizes else None
        needed = struct.calcsize(form.rstrip("*"))
        if data is None or len(data) < needed or (len(data) > needed and not form.endswith("*")):
            return None
        return struct.unpack_from(form.rstrip("*"), data)


_HANDLERS: dict[tuple[type, str], tuple[dict[Hashable, Handler], list[Handler]]] = {}
"""The handlers of each class: by key, and those with a pattern."""


def answers(device: Device, data: Any, t_ns: int, port: str) -> list[Any]:
    """Return what a device does with data that arrive, request by request."""
    done: list[Any] = []
    for packet, fields in device.packets.requests(data, t_ns):
        done += answer(device, packet, t_ns, port, fields)
    return done


def answer(device: Device, packet: Any, t_ns: int, port: str, fields: dict[str, Any] | None = None) -> Sequence[Any]:
    """Return what a device does with one request, whose fields are given if they have been read."""
    cutter = device.packets
    if isinstance(packet, Broken):
        return device.refused(Request(packet, t_ns, port, {}), packet.why)
    if isinstance(packet, Stage):
        return _called(device, "staged", Request(packet, t_ns, port, {}))
    if not cutter.by:
        return _matched(device, Request(packet, t_ns, port, {}))
    if fields is None and (fields := cutter.fields(packet)) is None and cutter.misfit:
        device.counters[cutter.misfit] += 1
        return ()
    request = Request(packet, t_ns, port, fields or {})
    if not device.accepts(request):
        device.counters[cutter.others] += 1
        return ()
    return _handled(device, request)


def handlers(device: Device) -> tuple[dict[Hashable, Handler], list[Handler]]:
    """Return the handlers of a device's class: by the key of their requests, and those with a pattern."""
    cutter = device.packets
    known = type(device), cutter.by
    if known not in _HANDLERS:
        by_key: dict[Hashable, Handler] = {}
        patterns = []
        for method, handled in handled_in(type(device)).items():
            keys, sizes = dict.fromkeys(handled.on), set()
            for each in handled.commands:
                key, size = _key_of(cutter, each.stages[0])
                sizes |= {size} - {None}
                keys |= {} if handled.on or key is None else {key: None}
            handler = Handler(method, handled, frozenset(sizes))
            by_key |= dict.fromkeys(keys if handled.pattern is None else (), handler)
            patterns += [handler] if handled.pattern is not None else []
        _HANDLERS[known] = by_key, patterns
    return _HANDLERS[known]


def _key_of(cutter: Any, frame: Any) -> tuple[Hashable, int | None]:
    """Return the key of an example, and the length of its data; ``None`` where the cutter does not take it."""
    content = cutter.content(frame)
    if not cutter.by:
        return content, None
    fields = cutter.fields(content)
    if fields is None:
        return None, None
    data = cutter.data(fields)
    return cutter.key(fields), REMOTE if data is None else len(data)


def _handled(device: Device, request: Request) -> Sequence[Any]:
    cutter = device.packets
    fields = request.fields
    found = handlers(device)[0].get(cutter.key(fields))
    if found is None or (values := found.values(cutter.data(fields))) is None:
        why = cutter.unknown if found is None else "bad_length"
        device.counters[why] += 1
        request.wanted = found.wanted if found else 0
        return device.refused(request, why)
    request.take(values)
    device.counters["requests"] += not cutter.counts_requests
    return _called(device, found.method, request)


def _matched(device: Device, request: Request) -> Sequence[Any]:
    """Return what the method does that declares this line or packet, or a pattern that fits it."""
    by_key, patterns = handlers(device)
    found, groups = by_key.get(request.packet), ()
    for handler in patterns if found is None else ():
        assert handler.handled.pattern is not None
        if (match := re.fullmatch(handler.handled.pattern, request.packet)) is not None:
            found, groups = handler, match.groups()
            break
    if found is None:
        device.counters["unknown_command"] += 1
        return device.refused(request, "unknown_command")
    request.take(groups)
    device.counters["requests"] += not device.packets.counts_requests
    return _called(device, found.method, request)


def _called(device: Device, method: str, request: Request) -> Sequence[Any]:
    try:
        done = getattr(device, method)(request)
    except Refused as refused:
        device.counters["refused"] += 1
        request.why = refused.why
        return device.refused(request, "refused")
    return device.reply(request, done or b"") if done is None or isinstance(done, bytes) else done
