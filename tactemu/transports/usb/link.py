"""The connection of a host that has attached a device: requests in, transfers out."""

from __future__ import annotations

import contextlib
import errno
import socket
from collections import deque

from tactemu.transports.usb import usbip_protocol as protocol
from tactemu.transports.usb.chip import STANDARD, Chip, Setup

_CHUNK_BYTES = 65_536
MAX_HELD_BYTES = 1 << 20
"""Maximum size of what is read of a host and not processed, and of answers that it does not take [byte]."""
MAX_REQUESTS = 1024
"""Maximum number of requests that wait; a host's drivers have some dozens. Beyond it the connection is closed."""
_SET_CONFIGURATION = 9


class Stream:
    """The data of one channel of a device: requests for data wait for data, and data for requests."""

    def __init__(self, chip: Chip):
        self.chip = chip
        self.waiting: dict[int, int] = {}
        """The numbers of waiting requests for data, each with the room for them [byte]."""
        self.held: deque[tuple[int, int, bytes]] = deque()
        """Requests with data that the device has not taken: number, length, data."""
        self.to_host = bytearray()
        """Data that wait for a request."""
        self._ends: deque[int] = deque()
        """The lengths of the frames that wait, on a device of frames [byte]."""
        self._answered: deque[int] = deque(maxlen=MAX_REQUESTS)
        """The numbers of the last requests that got data: a driver may withdraw one at the same moment."""
        self.has_reader = False
        """True while a driver of the host wants data: between two of its requests, too."""

    def next(self) -> tuple[int, bytes] | None:
        """Return the number of a waiting request and the data that it gets, or None if either is missing."""
        if not self.to_host or not self.waiting:
            return None
        number = next(iter(self.waiting))
        self._answered.append(number)
        room = self.waiting.pop(number)
        if self._ends:
            room = min(room, self._ends[0])
            self._ends[0] -= room
            if not self._ends[0]:
                self._ends.popleft()
        return number, self.chip.packets_to_host(self.to_host, room)

    def put(self, data: bytes) -> None:
        """Let data wait for a request."""
        self.to_host += data
        if self.chip.is_framed and data:
            self._ends.append(len(data))

    def clear(self) -> None:
        """Drop what waits for the host."""
        self.to_host.clear()
        self._ends.clear()

    def withdraw(self, number: int) -> bool:
        """Forget a request; return False if it is not of this channel, or done."""
        was_held = [each for each in self.held if each[0] == number]
        for each in was_held:
            self.held.remove(each)
        was_waiting = self.waiting.pop(number, None) is not None
        is_of_reader = was_waiting or number in self._answered
        if is_of_reader and not self.chip.listens_when_configured and not self.waiting:
            self.has_reader = False  # a driver withdraws all of its requests when the port is closed
            self.clear()
        return was_waiting or bool(was_held)


class HostLink:
    """The requests of one host.

    A request for data waits until the device has some; a request with data waits until the device takes them, so that
    a host that sends faster than the line waits, as at the real chip.

    Args:
        connection: the socket, connected.
        chip: the device.
    """

    def __init__(self, connection: socket.socket, chip: Chip):
        self._socket, self._chip = connection, chip
        self._input, self._unsent = bytearray(), bytearray()
        self._streams = {each: Stream(each) for each in chip.channels}
        self._inputs = {each.data_in: stream for each, stream in self._streams.items()}
        self._outputs = {each.data_out: stream for each, stream in self._streams.items()}
        self._others: dict[int, None] = {}
        """The numbers of waiting requests to endpoints that never have data: of notifications."""
        self.is_alive = True
        self.users = 0
        """The number of loops that wait for the connection; it is closed when none does."""

    def fileno(self) -> int:
        """Return the file descriptor of the connection."""
        return self._socket.fileno()

    def close(self) -> None:
        """Cut the connection: the device is unplugged. Its descriptor stays valid for loops that wait for it."""
        self.is_alive = False
        for stream in self._streams.values():
            stream.has_reader = False
        if self.users > 0:
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
        else:
            self._socket.close()

    def release(self) -> None:
        """Note that a loop waits no more; the last one closes a connection that is cut."""
        self.users -= 1
        if self.users <= 0 and not self.is_alive:
            self._socket.close()

    def has_reader(self, channel: Chip) -> bool:
        """Return True while a driver of the host wants data of a channel."""
        return self._streams[channel].has_reader

    def to_host_bytes(self, channel: Chip) -> int:
        """Return the number of bytes of a channel that wait for the host."""
        return len(self._streams[channel].to_host)

    # -- from the host -------------------------------------------------------------------------------------------------

    def receive(self) -> bool:
        """Read what has come, and answer it; return True if there was something. Never blocks.

        A connection that ends, and one that does not speak USB/IP, is closed.
        """
        had = len(self._input)
        try:
            while len(self._input) < MAX_HELD_BYTES and (chunk := self._socket.recv(_CHUNK_BYTES)):
                self._input += chunk
            is_ended = len(self._input) < MAX_HELD_BYTES
        except BlockingIOError:
            is_ended = False
        except OSError:
            is_ended = True
        at, has_news = 0, is_ended or len(self._input) > had
        try:
            while (found := protocol.parsed(self._input, at)) is not None:
                message, at = found
                if isinstance(message, protocol.Unlink):
                    self._unlink(message)
                else:
                    self._submit(message)
        except ValueError:
            is_ended = True
        del self._input[:at]
        self.send()
        if is_ended or self._is_flooded:
            self.close()
        return has_news

    @property
    def _is_flooded(self) -> bool:
        """True if the host asks for more than a driver would, or does not take its answers."""
        waiting = sum(len(stream.held) + len(stream.waiting) for stream in self._streams.values())
        return waiting + len(self._others) > MAX_REQUESTS or len(self._unsent) > MAX_HELD_BYTES

    def _submit(self, request: protocol.Submit) -> None:
        if request.endpoint == 0:
            self._control(request)
        elif request.to_host:
            if stream := self._inputs.get(request.endpoint | 0x80):
                stream.waiting[request.number] = request.length
                stream.has_reader = True
            else:
                self._others[request.number] = None
        elif stream := self._outputs.get(request.endpoint):
            stream.held.append((request.number, request.length, request.data))
        else:
            self._answer(request.number, -errno.EPIPE, 0)

    def _control(self, request: protocol.Submit) -> None:
        setup = Setup(*request.setup[:2], *(int.from_bytes(request.setup[at : at + 2], "little") for at in (2, 4, 6)))
        if setup.type == STANDARD and setup.request == _SET_CONFIGURATION:
            for stream in self._streams.values():
                stream.has_reader = stream.chip.listens_when_configured
        if taker := next((stream for stream in self._streams.values() if stream.chip.takes(setup)), None):
            taker.held.append((request.number, request.length, request.data))
            return
        answer = self._chip.answer(setup, request.data)
        if answer is None:
            self._answer(request.number, -errno.EPIPE, 0)
        elif request.to_host:
            answer = answer[: request.length]
            self._answer(request.number, 0, len(answer), answer)
        else:
            self._answer(request.number, 0, request.length)

    def _unlink(self, request: protocol.Unlink) -> None:
        was_waiting = any(stream.withdraw(request.withdrawn) for stream in self._streams.values())
        if request.withdrawn in self._others:
            del self._others[request.withdrawn]
            was_waiting = True
        self._unsent += protocol.unlinked(request.number, -errno.ECONNRESET if was_waiting else 0)

    def take(self, channel: Chip) -> bytes | None:
        """Return the data of the host's next request to a channel, which is then done, or None if there is none."""
        held = self._streams[channel].held
        if not held:
            return None
        number, length, data = held.popleft()
        self._answer(number, 0, length)
        return channel.from_host(data)

    # -- to the host ---------------------------------------------------------------------------------------------------

    def put(self, channel: Chip, data: bytes) -> None:
        """Hand data of a channel to the host as it asks for them; on a device of frames, one in each transfer."""
        stream = self._streams[channel]
        stream.put(data)
        while (found := stream.next()) is not None:
            number, transfer = found
            self._answer(number, 0, len(transfer), transfer)

    def pump(self, channel: Chip) -> None:
        """Fill requests that have come since with data that wait."""
        if self._streams[channel].to_host:
            self.put(channel, b"")

    def _answer(self, number: int, status: int, length: int, data: bytes = b"") -> None:
        self._unsent += protocol.submitted(number, status, length, data)

    def send(self) -> None:
        """Send what is ready, as far as the kernel takes it."""
        try:
            while self._unsent:
                del self._unsent[: self._socket.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:  # the next read reports it
            pass
