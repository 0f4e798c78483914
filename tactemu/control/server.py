"""The socket on which a running emulator listens for commands: a thread of its own, so that the loop waits for nobody.

Lines of JSON both ways (``docs/live-control.md``). The server says first who it is; then every request is answered
once, under the number that it had; states, and what happens on the wires, come to those who watch. Everything is
bounded: clients, the length of a line, requests under way, what waits for a client that does not read (it is dropped),
and the share of the time that clients can make this thread busy.
"""

from __future__ import annotations

import base64
import contextlib
import json
import logging
import os
import queue
import select
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Protocol

import numpy as np

from tactemu.base.errors import TactemuError, nearest, shown
from tactemu.base.options import number
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.control.endpoints import PROTOCOL, Endpoint, uid_of_peer
from tactemu.control.loop_task import LoopTask
from tactemu.control.state import row_of
from tactemu.truth import Sample
from tactemu.truth.jsonl_format import array_text
from tactemu.truth.jsonl_format import row_of as row_of_entry
from tactemu.truth.tap import Tap

_logger = logging.getLogger(__name__)

MOST_CLIENTS = 16
LONGEST_LINE = 65_536
"""Bytes of a request."""
MOST_AT_ONCE = 64
"""Requests of one client that are not answered yet."""
MOST_UNREAD = 4_000_000
"""Bytes that may wait for a client, beside the answer that comes last."""
PATIENCE_S = 5.0
"""How long a client may take no byte of what waits for it."""
RATES_HZ = (0.01, 120.0)
"""Of states that a client watches."""
MOST_ENTRIES = 200
"""Frames, faults and events that come with a state."""
_READ_AT_ONCE = 4096
_ITEMS_AT_ONCE = 8
"""Of a long list that are a piece of a message."""
_SLICE_S, _PAUSE_S = 5e-5, 5e-5
_REST = 3.0
"""In real time this thread rests so many times as long as it was busy: whatever clients do, the loop has the most of
the interpreter."""


class Driven(Protocol):
    """What a server hands commands to."""

    clients: Counter[str]

    def submit(self, verb: str, arguments: Mapping[str, Any], by: str, tell: Callable[[LoopTask], None]) -> LoopTask:
        """Have a command done; ``tell`` is called when it is."""
        ...

    def watched(self, by: str, tell: Callable[[LoopTask], None]) -> LoopTask:
        """Have the state looked at, for somebody who watches."""
        ...

    def tap(self, most: int, skin: str | None) -> Tap:
        """What happens on the wires from now on, for somebody who watches; to be given to :meth:`untap`.

        Raises:
            TactemuError: there is no such skin.
        """
        ...

    def untap(self, tap: Tap) -> None:
        """Watched no more."""
        ...

    def hello(self) -> dict[str, Any]:
        """What a client is told first."""
        ...


class _Client:
    """One connection."""

    def __init__(self, connection: socket.socket, number: int):
        self.connection, self.number = connection, number
        self.name = f"client {number}"
        self.heard = bytearray()
        self.unread: deque[memoryview] = deque()
        self.waiting = 0
        """Bytes in it."""
        self.taken_s = time.monotonic()
        """When it took something last, or nothing waited for it."""
        self.under_way = 0
        """Requests that are not answered."""
        self.watch: Any = None
        """Number of the request for states, in a tuple; ``None``: none are wished."""
        self.period_s = self.next_s = 0.0
        self.state_asked = self.as_bytes = False
        self.tap: Tap | None = None
        self.says_no_more = False
        """It is closed when it has its answers and has read them."""

    @property
    def has_line(self) -> bool:
        return b"\n" in self.heard

    @property
    def finished(self) -> bool:
        return self.says_no_more and not (self.under_way or self.unread or self.has_line)

    @property
    def gone(self) -> bool:
        """Whether nobody is at the other end any more, not even to read."""
        look = select.poll()
        look.register(self.connection, 0)
        return bool(look.poll(0))


class Server:
    """Listens until it is closed.

    Args:
        place: the name under which it is found.
        driven: carries the commands out. Its ``clients`` counts: ``accepted``, ``refused`` clients, ``commands``,
            ``errors`` in requests, ``dropped`` clients that did not read.
        gentle: time is real: leave the interpreter to the loop.

    Raises:
        TactemuError: the name is taken, or no socket can be made.
    """

    def __init__(self, place: Endpoint, driven: Driven, *, yield_to_loop: bool):
        self.place, self.driven, self._yield_to_loop = place, driven, yield_to_loop
        self.counters = driven.clients
        self._clients: dict[int, _Client] = {}
        self._number = 0
        self._done: queue.SimpleQueue[tuple[_Client, Any, LoopTask]] = queue.SimpleQueue()
        self._closing = False
        self._listener = place.take()
        self._bell = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._thread = threading.Thread(target=self._work, name="tactemu-control", daemon=True)
        self._maker = os.getpid()
        self._thread.start()

    def close(self) -> None:
        """Close every connection and give the name up. Call when the loop has ended; safe twice, and in a fork."""
        if self._closing or self._maker != os.getpid():
            return
        self._closing = True
        os.eventfd_write(self._bell, 1)
        self._thread.join()
        self.place.leave()
        os.close(self._bell)

    def _tell(self, client: _Client, ident: Any, errand: LoopTask) -> None:
        """A command is done; called in the loop."""
        self._done.put((client, ident, errand))
        os.eventfd_write(self._bell, 1)

    # -- the thread --------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            while not self._closing:
                self._turn()
        finally:
            for client in list(self._clients.values()):
                self._drop(client)
            self._listener.close()

    def _turn(self) -> None:
        clients = list(self._clients.values())
        readers = [each.connection for each in clients if not each.says_no_more and not each.has_line]
        writers = [each.connection for each in clients if each.unread]
        ready, free, _ = select.select([self._listener, self._bell, *readers], writers, (), self._patience_s())
        begun = time.thread_time()
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._bell)
        while not self._done.empty():
            self._answer(*self._done.get())
        for client in clients:
            if client.connection in free:
                self._send(client)
            if client.connection in ready:
                self._read(client)
            if client.has_line:
                self._hear_line(client)
        if self._listener in ready:
            self._accept()
        for client in list(self._clients.values()):
            self._look_after(client)
        if self._yield_to_loop:
            time.sleep(_REST * (time.thread_time() - begun))

    def _patience_s(self) -> float | None:
        """How long nothing needs to be done."""
        clients, now = self._clients.values(), time.monotonic()
        if any(client.has_line for client in clients):
            return 0.0
        times = [client.next_s - now for client in clients if client.watch and not client.state_asked]
        times += [client.taken_s + PATIENCE_S - now for client in clients if client.unread]
        return max(0.0, min(times)) if times else None

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        for each in [each for each in self._clients.values() if each.says_no_more and each.gone]:
            self._drop(each)
        self._number += 1
        client = self._clients[self._number] = _Client(connection, self._number)
        if uid_of_peer(connection) != os.getuid():
            self._refuse(client, "this emulator is another user's")
        elif len(self._clients) > MOST_CLIENTS:
            self._refuse(client, f"{MOST_CLIENTS} clients are connected already")
        else:
            self.counters["accepted"] += 1
            hello = {"protocol": PROTOCOL, "pid": os.getpid(), "name": self.place.name}
            self._put(client, hello | self.driven.hello())

    def _refuse(self, client: _Client, why: str) -> None:
        """Say why, and hear no more of it."""
        self.counters["refused"] += 1
        self._put(client, {"ok": False, "error": why})
        client.heard.clear()
        client.says_no_more = True

    def _drop(self, client: _Client) -> None:
        if self._clients.pop(client.number, None) is not None:
            client.connection.close()
        self._watch_no_more(client)
        client.unread.clear()
        client.heard.clear()

    def _look_after(self, client: _Client) -> None:
        """Ask for a state if one is wished; let go of a client that is done, or does not read."""
        now = time.monotonic()
        if client.finished:
            self._drop(client)
        elif client.unread and now - client.taken_s > PATIENCE_S:
            self.counters["dropped"] += 1
            self._drop(client)
        elif client.watch and not client.state_asked and now >= client.next_s and not client.unread:
            client.next_s = max(client.next_s + client.period_s, now)
            client.state_asked = True
            self.driven.watched(client.name, partial(self._tell, client, client.watch))

    # -- requests ----------------------------------------------------------------------------------------------------

    def _read(self, client: _Client) -> None:
        try:
            data = client.connection.recv(_READ_AT_ONCE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        client.says_no_more = not data
        client.heard += data
        if not client.has_line and len(client.heard) >= LONGEST_LINE:
            self._refuse(client, f"a line is longer than {LONGEST_LINE} bytes")

    def _hear_line(self, client: _Client) -> None:
        line, _, rest = client.heard.partition(b"\n")
        client.heard = rest
        ident = None
        try:
            said = _parsed(bytes(line))
            ident = _number_of(said)
            if said.get("protocol", PROTOCOL) != PROTOCOL:
                raise TactemuError(f"protocol: this emulator speaks version {PROTOCOL}, got {shown(said['protocol'])}")
            self._begin(client, ident, said.get("verb"), said.get("args", {}))
        except TactemuError as error:
            self.counters["errors"] += 1
            self._put(client, {"id": ident, "ok": False, "error": str(error)})

    def _begin(self, client: _Client, ident: Any, verb: Any, args: Any) -> None:
        """Have a request done."""
        if not isinstance(args, dict):
            raise TactemuError(f"args: expected a table, got {shown(args)}")
        if verb in ("watch", "unwatch"):
            self._watch(client, ident, args if verb == "watch" else None)
            return
        if not isinstance(verb, str) or verb not in CONTROL_COMMANDS:
            hint = nearest(verb, CONTROL_COMMANDS) or f"; there are: {', '.join(CONTROL_COMMANDS)}, watch, unwatch"
            raise TactemuError(f"verb: there is no {shown(verb)}{hint}")
        if client.under_way >= MOST_AT_ONCE:
            raise TactemuError(f"{MOST_AT_ONCE} of your requests are under way; wait for an answer")
        arguments = CONTROL_COMMANDS[verb].checked(args)
        client.under_way += 1
        self.counters["commands"] += 1
        self.driven.submit(verb, arguments, client.name, partial(self._tell, client, ident))

    def _watch(self, client: _Client, ident: Any, args: dict[str, Any] | None) -> None:
        self._watch_no_more(client)
        if args is not None:
            if unknown := [name for name in args if name not in WATCH]:
                raise TactemuError(f"watch: no argument {unknown[0]!r}; it has: {', '.join(WATCH)}")
            rate, as_bytes, most, skin = (WATCH[name](args.get(name)) for name in WATCH)
            client.tap = self.driven.tap(most, skin) if most else None
            client.as_bytes = as_bytes
            client.watch, client.period_s, client.next_s = (ident,), 1.0 / rate, time.monotonic()
        self._put(client, {"id": ident, "ok": True})

    def _watch_no_more(self, client: _Client) -> None:
        client.watch = None
        if client.tap is not None:
            self.driven.untap(client.tap)
            client.tap = None

    # -- answers -----------------------------------------------------------------------------------------------------

    def _answer(self, client: _Client, ident: Any, errand: LoopTask) -> None:
        """What a command gave goes to who asked; a state that is watched, unless the one before it is not read yet."""
        if client.number not in self._clients:
            return
        try:
            answer = {"ok": True, "t_s": errand.t_ns / 1e9, "result": errand.result()}
        except TactemuError as error:
            self.counters["errors"] += 1
            answer = {"ok": False, "error": str(error)}
        except Exception as error:  # of a device or a source of the user's own
            _logger.debug("control: a command failed", exc_info=error)
            answer = {"ok": False, "error": f"the command failed: {error}"}
        if not isinstance(ident, tuple):
            client.under_way -= 1
            self._put(client, {"id": ident, **answer})
            return
        client.state_asked = False
        if client.watch == ident and not client.unread:
            if client.tap is not None and answer["ok"]:
                entries, missing = client.tap.take()
                answer["result"] |= {"wire": [row_of_entry(each) for each in entries], "wire_missing": missing}
            self._put(client, {"watch": ident[0], **answer}, client.as_bytes)

    def _put(self, client: _Client, message: dict[str, Any], as_bytes: bool = False) -> None:
        if client.waiting > MOST_UNREAD:
            self.counters["dropped"] += 1
            self._drop(client)
            return
        if not client.unread:
            client.taken_s = time.monotonic()
        line = "".join(self._in_slices(_pieces(message, as_bytes))).encode() + b"\n"
        client.unread.append(memoryview(line))
        client.waiting += len(line)
        self._send(client)

    def _in_slices(self, pieces: Iterator[str]) -> Iterator[str]:
        """The same; in real time the loop may have the interpreter after each slice of work. A thread that only offers
        it takes it back before another has woken up."""
        since = time.perf_counter()
        for piece in pieces:
            yield piece
            if self._yield_to_loop and time.perf_counter() - since > _SLICE_S:
                time.sleep(_PAUSE_S)
                since = time.perf_counter()

    def _send(self, client: _Client) -> None:
        """As much as it takes now."""
        try:
            while client.unread:
                sent = client.connection.send(client.unread[0])
                client.waiting -= sent
                client.taken_s = time.monotonic()
                client.unread[0] = client.unread[0][sent:]
                if not client.unread[0]:
                    client.unread.popleft()
        except BlockingIOError:
            pass
        except OSError:
            self._drop(client)


def _parsed(line: bytes) -> dict[str, Any]:
    """Return the object on a line.

    Raises:
        TactemuError: there is none.
    """
    try:
        said = json.loads(line, parse_constant=_refused)
    except (ValueError, RecursionError):
        said = line
    if not isinstance(said, dict):
        raise TactemuError(f"expected a JSON object on a line, got {shown(said)}")
    return said


def _refused(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def _number_of(said: dict[str, Any]) -> Any:
    """Return the number of a request.

    Raises:
        TactemuError: it is none that could be given back.
    """
    ident = said.get("id")
    if isinstance(ident, float | bool | list | dict) or len(str(ident)) > 100:
        raise TactemuError(f"id: expected a whole number or a short text, got {shown(ident)}")
    return ident


def _checked_rate(given: Any) -> float:
    rate = 10.0 if given is None else given
    return number("watch", "rate", rate, at_least=RATES_HZ[0], at_most=RATES_HZ[1], unit="Hz")


def _checked_arrays(given: Any) -> bool:
    if given not in (None, "lists", "base64"):
        raise TactemuError(f"watch: arrays must be lists or base64, got {shown(given)}")
    return given == "base64"


def _checked_most(given: Any) -> int:
    return int(number("watch", "wire", given or 0, at_least=0, at_most=MOST_ENTRIES, integer=True))


def _checked_skin(given: Any) -> str | None:
    if given is not None and not isinstance(given, str):
        raise TactemuError(f"watch: skin must be a text, got {shown(given)}")
    return given


WATCH: dict[str, Callable[[Any], Any]] = {
    "rate": _checked_rate, "arrays": _checked_arrays, "wire": _checked_most, "skin": _checked_skin,
}  # fmt: skip
"""The arguments of `watch`."""


def _pieces(value: Any, as_bytes: bool = False) -> Iterator[str]:
    """A message in JSON, in pieces that take little time each. Arrays are lists, or their bytes in base64 with their
    type and shape."""
    value = row_of(value) if isinstance(value, Sample) else value
    if isinstance(value, np.ndarray) and as_bytes:
        head = {"dtype": value.dtype.str, "shape": value.shape}
        yield json.dumps(head)[:-1] + f', "base64": "{base64.b64encode(np.ascontiguousarray(value).data).decode()}"}}'
    elif isinstance(value, np.ndarray):
        yield from array_text(value)
    elif isinstance(value, dict):
        for k, (name, each) in enumerate(value.items()):
            yield f"{',' if k else '{'}{json.dumps(name)}:"
            yield from _pieces(each, as_bytes)
        yield "}" if value else "{}"
    elif isinstance(value, list) and len(value) > _ITEMS_AT_ONCE:
        for start in range(0, len(value), _ITEMS_AT_ONCE):
            yield ("," if start else "[") + json.dumps(value[start : start + _ITEMS_AT_ONCE])[1:-1]
        yield "]"
    else:
        yield json.dumps(value)
