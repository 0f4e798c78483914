"""The connection of a host that has attached a device: requests in, transfers out."""

from __future__ import annotations

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
        self._waiting: dict[int, dict[int, int]] = {}
        """The numbers of waiting requests for data, each with the room for them [byte], by endpoint address."""
        self._held: deque[tuple[int, int, bytes]] = deque()
        """Requests with data that the device has not taken: number, length, data."""
        self._to_host = bytearray()
        """Data that wait for a request."""
        self.has_reader = False
        """True while a driver of the host wants data: between two of its requests, too."""
        self.is_alive = True

    def fileno(self) -> int:
        """Return the file descriptor of the connection."""
        return self._socket.fileno()

    def close(self) -> None:
        """Cut the connection: the device is unplugged."""
        self._socket.close()
        self.is_alive = self.has_reader = False

    @property
    def to_host_bytes(self) -> int:
        """The number of bytes that wait for the host."""
        return len(self._to_host)

    # -- from the host -------------------------------------------------------------------------------------------------

    def receive(self) -> None:
        """Read what has come, and answer it. Never blocks.

        A connection that ends, and one that does not speak USB/IP, is closed.
        """
        try:
            while len(self._input) < MAX_HELD_BYTES and (chunk := self._socket.recv(_CHUNK_BYTES)):
                self._input += chunk
            is_ended = len(self._input) < MAX_HELD_BYTES
        except BlockingIOError:
            is_ended = False
        except OSError:
            is_ended = True
        at = 0
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

    @property
    def _is_flooded(self) -> bool:
        """True if the host asks for more than a driver would, or does not take its answers."""
        waiting = len(self._held) + sum(map(len, self._waiting.values()))
        return waiting > MAX_REQUESTS or len(self._unsent) > MAX_HELD_BYTES

    def _submit(self, request: protocol.Submit) -> None:
        if request.endpoint == 0:
            self._control(request)
        elif request.to_host:
            self._waiting.setdefault(request.endpoint | 0x80, {})[request.number] = request.length
            self.has_reader |= request.endpoint | 0x80 == self._chip.data_in
        elif request.endpoint == self._chip.data_out:
            self._held.append((request.number, request.length, request.data))
        else:
            self._answer(request.number, -errno.EPIPE, 0)

    def _control(self, request: protocol.Submit) -> None:
        setup = Setup(*request.setup[:2], *(int.from_bytes(request.setup[at : at + 2], "little") for at in (2, 4, 6)))
        if setup.type == STANDARD and setup.request == _SET_CONFIGURATION:
            self.has_reader = self._chip.listens_when_configured
        answer = self._chip.answer(setup, request.data)
        if answer is None:
            self._answer(request.number, -errno.EPIPE, 0)
        elif request.to_host:
            answer = answer[: request.length]
            self._answer(request.number, 0, len(answer), answer)
        else:
            self._answer(request.number, 0, request.length)

    def _unlink(self, request: protocol.Unlink) -> None:
        was_waiting = any(queue.pop(request.withdrawn, None) is not None for queue in self._waiting.values())
        for entry in [each for each in self._held if each[0] == request.withdrawn]:
            self._held.remove(entry)
            was_waiting = True
        if not self._chip.listens_when_configured and not self._waiting.get(self._chip.data_in):
            self.has_reader = False  # a driver withdraws all of its requests when the port is closed
            self._to_host.clear()
        self._unsent += protocol.unlinked(request.number, -errno.ECONNRESET if was_waiting else 0)

    def take(self) -> bytes | None:
        """Return the data of the host's next request, which is then done, or None if it has sent none."""
        if not self._held:
            return None
        number, length, data = self._held.popleft()
        self._answer(number, 0, length)
        return self._chip.from_host(data)

    # -- to the host ---------------------------------------------------------------------------------------------------

    def put(self, data: bytes) -> None:
        """Hand data to the host as it asks for them; on a device of frames, one in each transfer."""
        self._to_host += data
        queue = self._waiting.get(self._chip.data_in)
        while self._to_host and queue:
            number = next(iter(queue))
            transfer = self._chip.packets_to_host(self._to_host, queue.pop(number))
            self._answer(number, 0, len(transfer), transfer)

    def pump(self) -> None:
        """Fill requests that have come since with data that wait."""
        if self._to_host:
            self.put(b"")

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
