"""The server of a running emulator's control socket, in a thread of its own, so that the loop never waits for a client.

Both sides send lines of JSON (``docs/live-control.md``). The server first sends a greeting; then it answers every
request once, under the request's ``id``; clients that watch receive states and what passes over the wires. Everything
is bounded: the number of clients, the length of a line, open requests, bytes that wait for a client that does not read
(it is dropped), and the share of the time for which clients can keep this thread busy.
"""

from __future__ import annotations

import contextlib
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

from tactemu.base.errors import TactemuError, nearest, shown
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.control.endpoints import PROTOCOL, Endpoint, uid_of_peer
from tactemu.control.loop_task import LoopTask
from tactemu.control.messages import message_pieces, parse_request, request_id, watch_options
from tactemu.truth.jsonl_format import row_of as row_of_entry
from tactemu.truth.tap import Tap

_logger = logging.getLogger(__name__)

MAX_CLIENTS = 16
MAX_REQUEST_BYTES = 65_536
"""Maximum length of a request; bounds the memory that a client can take."""
MAX_OPEN_REQUESTS = 64
"""Maximum number of a client's requests that are not answered yet."""
MAX_PENDING_BYTES = 4_000_000
"""Maximum number of bytes that wait for a client, beside its latest answer."""
CLIENT_TIMEOUT_S = 5.0
"""Longest time for which a client may read no byte of its pending answers before it is dropped."""
_MAX_READ_BYTES = 4096
_MAX_SLICE_S = 5e-5
"""Longest time, in real time, for which this thread keeps the interpreter while it writes a message."""
_SLICE_PAUSE_S = 5e-5
_PAUSE_PER_BUSY_TIME = 3.0
"""Ratio of pause to busy time of this thread, in real time; it leaves the loop most of the interpreter's time."""


class CommandTarget(Protocol):
    """The emulator or replay to which a server passes commands."""

    clients: Counter[str]

    def submit(self, verb: str, arguments: Mapping[str, Any], by: str, on_done: Callable[[LoopTask], None]) -> LoopTask:
        """Have the loop carry out a command; ``on_done`` is called when it is done."""
        ...

    def watched(self, by: str, on_done: Callable[[LoopTask], None]) -> LoopTask:
        """Have the loop take the state for a client that watches it."""
        ...

    def tap(self, most: int, skin: str | None) -> Tap:
        """Return a tap that collects what passes over the wires from now on, until :meth:`untap`.

        Raises:
            TactemuError: there is no such skin.
        """
        ...

    def untap(self, tap: Tap) -> None:
        """Remove a tap."""
        ...

    def hello(self) -> dict[str, Any]:
        """Return the greeting of a client, beside protocol, process and name."""
        ...


class _Client:
    """One connection."""

    def __init__(self, connection: socket.socket, number: int):
        self.connection, self.number = connection, number
        self.name = f"client {number}"
        self.received = bytearray()
        self.pending: deque[memoryview] = deque()
        self.pending_bytes = 0
        """Number of bytes in :attr:`pending`."""
        self.accepted_s = time.monotonic()
        """Time at which the client last read something, or nothing waited for it."""
        self.open_requests = 0
        """Number of requests that are not answered yet."""
        self.watch: Any = None
        """The ``id`` of the request for states, in a tuple; ``None`` if the client does not watch."""
        self.period_s = self.next_s = 0.0
        self.is_state_requested = self.as_base64 = False
        self.tap: Tap | None = None
        self.is_half_closed = False
        """True if the client sends no more; the connection is closed when it has read its answers."""

    @property
    def has_line(self) -> bool:
        return b"\n" in self.received

    @property
    def is_listened_to(self) -> bool:
        return not self.is_half_closed and not self.has_line

    @property
    def is_finished(self) -> bool:
        return self.is_half_closed and not (self.open_requests or self.pending or self.has_line)

    @property
    def has_hung_up(self) -> bool:
        """True if the other end is closed, also for reading."""
        poll = select.poll()
        poll.register(self.connection, 0)
        return bool(poll.poll(0))


class Server:
    """A server that accepts clients until it is closed.

    Args:
        endpoint: the name and the socket.
        target: carries the commands out. Its ``clients`` counts: ``accepted``, ``refused`` clients, ``commands``,
            ``errors`` in requests, ``dropped`` clients that did not read.
        yield_to_loop: leave the interpreter to the loop most of the time, because time is real.

    Raises:
        TactemuError: the name is taken, or no socket can be made.
    """

    def __init__(self, endpoint: Endpoint, target: CommandTarget, *, yield_to_loop: bool):
        self.endpoint, self.target, self._yield_to_loop = endpoint, target, yield_to_loop
        self.counters = target.clients
        self._clients: dict[int, _Client] = {}
        self._number = 0
        self._done: queue.SimpleQueue[tuple[_Client, Any, LoopTask]] = queue.SimpleQueue()
        self._closing = False
        self._listener = endpoint.take()
        self._event_fd = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._thread = threading.Thread(target=self._work, name="tactemu-control", daemon=True)
        self._owner_pid = os.getpid()
        self._thread.start()

    def close(self) -> None:
        """Close every connection and release the name. Call when the loop has ended; safe twice, and in a fork."""
        if self._closing or self._owner_pid != os.getpid():
            return
        self._closing = True
        os.eventfd_write(self._event_fd, 1)
        self._thread.join()
        self.endpoint.leave()
        os.close(self._event_fd)

    def _on_done(self, client: _Client, ident: Any, task: LoopTask) -> None:
        """Queue the result of a command for the server's thread; called in the loop."""
        self._done.put((client, ident, task))
        os.eventfd_write(self._event_fd, 1)

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
        events = self._wait(clients)
        begun = time.thread_time()
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._event_fd)
        while not self._done.empty():
            self._answer(*self._done.get())
        for client in clients:
            event = events.get(client.connection.fileno(), 0)
            if event & ~select.POLLIN:  # writable, or closed at the other end
                self._send(client)
            if event & ~select.POLLOUT and client.is_listened_to:
                self._read(client)
            if client.has_line:
                self._handle_line(client)
        if self._listener.fileno() in events:
            self._accept()
        for client in list(self._clients.values()):
            self._maintain(client)
        if self._yield_to_loop:
            time.sleep(_PAUSE_PER_BUSY_TIME * (time.thread_time() - begun))

    def _wait(self, clients: list[_Client]) -> dict[int, int]:
        """Sleep until a client, a new one or the loop has something, and return the events of `poll` by descriptor."""
        poll = select.poll()
        for each in (self._listener, self._event_fd):
            poll.register(each, select.POLLIN)
        for client in clients:
            reads = select.POLLIN if client.is_listened_to else 0
            writes = select.POLLOUT if client.pending else 0
            if reads or writes:  # else a client that has hung up would wake it again and again
                poll.register(client.connection, reads | writes)
        timeout_s = self._timeout_s()
        return dict(poll.poll(None if timeout_s is None else 1e3 * timeout_s))

    def _timeout_s(self) -> float | None:
        """Return the longest time to wait for clients; ``None``: no deadline."""
        clients, now = self._clients.values(), time.monotonic()
        if any(client.has_line for client in clients):
            return 0.0
        times = [client.next_s - now for client in clients if client.watch and not client.is_state_requested]
        times += [client.accepted_s + CLIENT_TIMEOUT_S - now for client in clients if client.pending]
        return max(0.0, min(times)) if times else None

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        for each in [each for each in self._clients.values() if each.is_half_closed and each.has_hung_up]:
            self._drop(each)
        self._number += 1
        client = self._clients[self._number] = _Client(connection, self._number)
        if uid_of_peer(connection) != os.getuid():
            self._refuse(client, "this emulator belongs to another user")
        elif len(self._clients) > MAX_CLIENTS:
            self._refuse(client, f"{MAX_CLIENTS} clients are connected already; close one of them")
        else:
            self.counters["accepted"] += 1
            hello = {"protocol": PROTOCOL, "pid": os.getpid(), "name": self.endpoint.name}
            self._put(client, hello | self.target.hello())

    def _refuse(self, client: _Client, why: str) -> None:
        """Send the reason, and receive no more from the client."""
        self.counters["refused"] += 1
        self._put(client, {"ok": False, "error": why})
        client.received.clear()
        client.is_half_closed = True

    def _drop(self, client: _Client) -> None:
        if self._clients.pop(client.number, None) is not None:
            client.connection.close()
        self._stop_watching(client)
        client.pending.clear()
        client.received.clear()

    def _maintain(self, client: _Client) -> None:
        """Drop a client that is finished or does not read; request a state for a client that watches."""
        now = time.monotonic()
        if client.is_finished:
            self._drop(client)
        elif client.pending and now - client.accepted_s > CLIENT_TIMEOUT_S:
            self.counters["dropped"] += 1
            self._drop(client)
        elif client.watch and not client.is_state_requested and now >= client.next_s and not client.pending:
            client.next_s = max(client.next_s + client.period_s, now)
            client.is_state_requested = True
            self.target.watched(client.name, partial(self._on_done, client, client.watch))

    # -- requests ----------------------------------------------------------------------------------------------------

    def _read(self, client: _Client) -> None:
        try:
            data = client.connection.recv(_MAX_READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        client.is_half_closed = not data
        client.received += data
        if not client.has_line and len(client.received) >= MAX_REQUEST_BYTES:
            self._refuse(client, f"a line is longer than {MAX_REQUEST_BYTES} bytes")

    def _handle_line(self, client: _Client) -> None:
        line, _, client.received = client.received.partition(b"\n")
        ident = None
        try:
            request = parse_request(bytes(line))
            ident = request_id(request)
            if request.get("protocol", PROTOCOL) != PROTOCOL:
                raise TactemuError(f"protocol: this emulator has version {PROTOCOL}, got {shown(request['protocol'])}")
            self._begin(client, ident, request.get("verb"), request.get("args", {}))
        except TactemuError as error:
            self.counters["errors"] += 1
            self._put(client, {"id": ident, "ok": False, "error": str(error)})

    def _begin(self, client: _Client, ident: Any, verb: Any, args: Any) -> None:
        """Pass a request to the target."""
        if not isinstance(args, dict):
            raise TactemuError(f"args: expected a table, got {shown(args)}")
        if verb in ("watch", "unwatch"):
            self._watch(client, ident, args if verb == "watch" else None)
            return
        if verb is None:
            raise TactemuError('expected a JSON object with a "verb", such as {"verb": "state"}')
        if not isinstance(verb, str) or verb not in CONTROL_COMMANDS:
            hint = nearest(verb, CONTROL_COMMANDS) or f"; there are: {', '.join(CONTROL_COMMANDS)}, watch, unwatch"
            raise TactemuError(f"verb: there is no {shown(verb)}{hint}")
        if client.open_requests >= MAX_OPEN_REQUESTS:
            raise TactemuError(f"{MAX_OPEN_REQUESTS} of your requests are under way; wait for an answer")
        arguments = CONTROL_COMMANDS[verb].checked(args)
        client.open_requests += 1
        self.counters["commands"] += 1
        self.target.submit(verb, arguments, client.name, partial(self._on_done, client, ident))

    def _watch(self, client: _Client, ident: Any, args: dict[str, Any] | None) -> None:
        self._stop_watching(client)
        if args is not None:
            options = watch_options(args)
            client.tap = self.target.tap(options.wire, options.skin) if options.wire else None
            client.as_base64 = options.arrays
            client.watch, client.period_s, client.next_s = (ident,), 1.0 / options.rate, time.monotonic()
        self._put(client, {"id": ident, "ok": True})

    def _stop_watching(self, client: _Client) -> None:
        client.watch = None
        if client.tap is not None:
            self.target.untap(client.tap)
            client.tap = None

    # -- answers -----------------------------------------------------------------------------------------------------

    def _answer(self, client: _Client, ident: Any, task: LoopTask) -> None:
        """Send the result of a command to its client; skip a watched state if the client has not read the last one."""
        if client.number not in self._clients:
            return
        try:
            answer = {"ok": True, "t_s": task.t_ns / 1e9, "result": task.result()}
        except TactemuError as error:
            self.counters["errors"] += 1
            answer = {"ok": False, "error": str(error)}
        except Exception as error:  # raised by the user's own device or source
            _logger.debug("control: a command failed", exc_info=error)
            answer = {"ok": False, "error": f"the command failed: {error}"}
        if not isinstance(ident, tuple):
            client.open_requests -= 1
            self._put(client, {"id": ident, **answer})
            return
        client.is_state_requested = False
        if client.watch == ident and not client.pending:
            if client.tap is not None and answer["ok"]:
                entries, missing = client.tap.take()
                answer["result"] |= {"wire": [row_of_entry(each) for each in entries], "wire_missing": missing}
            self._put(client, {"watch": ident[0], **answer}, client.as_base64)

    def _put(self, client: _Client, message: dict[str, Any], as_base64: bool = False) -> None:
        if client.pending_bytes > MAX_PENDING_BYTES:
            self.counters["dropped"] += 1
            self._drop(client)
            return
        if not client.pending:
            client.accepted_s = time.monotonic()
        line = "".join(self._in_slices(message_pieces(message, as_base64))).encode() + b"\n"
        client.pending.append(memoryview(line))
        client.pending_bytes += len(line)
        self._send(client)

    def _in_slices(self, pieces: Iterator[str]) -> Iterator[str]:
        """Yield the pieces; in real time, sleep after each slice of work. A thread that yields the interpreter without
        sleep takes it back before the loop's thread wakes up."""
        since = time.perf_counter()
        for piece in pieces:
            yield piece
            if self._yield_to_loop and time.perf_counter() - since > _MAX_SLICE_S:
                time.sleep(_SLICE_PAUSE_S)
                since = time.perf_counter()

    def _send(self, client: _Client) -> None:
        """Send as many pending bytes as the connection accepts now."""
        try:
            while client.pending:
                sent = client.connection.send(client.pending[0])
                client.pending_bytes -= sent
                client.accepted_s = time.monotonic()
                client.pending[0] = client.pending[0][sent:]
                if not client.pending[0]:
                    client.pending.popleft()
        except BlockingIOError:
            pass
        except OSError:
            self._drop(client)
