"""``i2cdriver:PATH``: an I2CDriver (Excamera), a USB adapter for an I2C bus, on a pseudo terminal.

A driver opens it as ``i2cdriver.I2CDriver(PATH)``. Monitor and capture modes are not there.

    host            adapter
    s A             start with an address and the R/W bit; the answer is the acknowledgement
    C0..FF bytes    write 1 to 64 bytes; the answer is the acknowledgement
    80..BF, a N     read 1 to 64 bytes, the last without acknowledgement, or N bytes with it
    p               stop
    r A R N         write register R of address A, then read N bytes
    d               scan: 112 digits, 1 where addresses 8 to 119 are acknowledged
    ?, x, e B       status in 80 characters, reset, echo of a byte
    1, 4, u P       100 kHz, 400 kHz, pull-ups
"""

from __future__ import annotations

from collections.abc import Sequence

from firmware_protocols import WireFrame
from tactemu.base.errors import TransportError
from tactemu.transports.pty import PtyTransport
from tactemu.transports.transport import CanFilter, Closed, Event, Received

ACK = b"1"
"""The answer to an address or bytes that a target has acknowledged."""
NACK = b"0"
LINES_HIGH = b"\x03"
"""The answer to a reset: SDA and SCL are high."""
ARGUMENT_BYTES = {b"e": 1, b"u": 1, b"s": 1, b"a": 1, b"r": 3}
"""Number of bytes behind a letter."""
SPEEDS_KHZ = {b"1": 100, b"4": 400}
RESYNC = b"@"
"""A byte without effect, by which hosts end whatever the adapter waits for."""
SCANNED = range(8, 120)
STATUS_CHARACTERS = 80


class I2cDriverTransport(PtyTransport):
    """An adapter with one controller, its host; transactions become frames of :class:`~firmware_protocols.I2c`."""

    scheme = "i2cdriver"

    def __init__(self, location: str):
        super().__init__(location)
        self._addresses: set[int] = set()
        self._reset()

    def _reset(self) -> None:
        self._commands = b""
        self._speed_khz = 100
        self._start: int | None = None
        """The address byte of the transaction, if a target has acknowledged it."""
        self._written = b""
        self._handed_out = 0
        """Number of bytes that were read in the transaction."""
        self._wanted = 0
        """Number of bytes that the host waits for."""

    def set_filters(self, filters: Sequence[CanFilter]) -> None:
        """Take over the addresses that the devices acknowledge."""
        self._addresses = {each.ident for each in filters}

    def poll(self, reading: bool = True) -> list[Event]:
        """Return the transactions of the host as frames, and the events of the port."""
        events: list[Event] = []
        for event in super().poll(reading):
            if isinstance(event, Received) and isinstance(event.data, bytes):
                self._commands += event.data
                continue
            if isinstance(event, Closed):
                self._reset()
            events.append(event)
        return events + self._obey()

    def _obey(self) -> list[Event]:
        """Return the frames of the commands that are complete; while a read waits for its bytes, the others wait."""
        frames: list[bytes] = []
        while self._commands:
            order = self._commands[:1]
            if self._wanted and order != RESYNC:
                break
            size = 1 + (order[0] - 0xBF if order[0] >= 0xC0 else ARGUMENT_BYTES.get(order, 0))
            if len(self._commands) < size:
                break
            command, self._commands = self._commands[:size], self._commands[size:]
            frames += self._execute(order, command[1:])
        return [Received(frame) for frame in frames]

    def _execute(self, order: bytes, argument: bytes) -> list[bytes]:
        code = order[0]
        if order == RESYNC:
            self._wanted = 0
        elif order == b"s":
            written = self._end_write()
            self._begin(argument[0])
            self._answer(NACK if self._start is None else ACK)
            return written
        elif code >= 0xC0:
            self._written += argument
            self._answer(NACK if self._start is None else ACK)
        elif code >= 0x80 or order == b"a":
            return self._ask(argument[0] if order == b"a" else code - 0x80 + 1)
        elif order == b"r":
            address, register, count = argument
            self._begin(address << 1)
            self._written = bytes([register])
            written = self._end_write()
            self._begin(address << 1 | 1)
            return written + self._ask(count)
        elif order in b"px":
            written = self._end_write()
            self._start = None
            self._answer(LINES_HIGH if order == b"x" else b"")
            return written
        elif order == b"d":
            self._answer(b"".join(ACK if address in self._addresses else NACK for address in SCANNED))
        else:
            self._speed_khz = SPEEDS_KHZ.get(order, self._speed_khz)
            self._answer(argument if order == b"e" else self._status() if order == b"?" else b"")
        return []

    def _begin(self, start: int) -> None:
        self._start = start if start >> 1 in self._addresses else None
        self._written, self._handed_out = b"", 0

    def _end_write(self) -> list[bytes]:
        """Return the bytes that the transaction has written, as a frame, if a target takes them."""
        data, self._written = self._written, b""
        return [bytes([self._start]) + data] if data and self._start is not None else []

    def _ask(self, count: int) -> list[bytes]:
        """Return the frame of a read; where no target has acknowledged, the host reads a bus that is high."""
        if self._start is None or not self._start & 1:
            self._answer(b"\xff" * count)
            return []
        self._wanted = count
        return [bytes([self._start]) + self._handed_out.to_bytes(2, "big") + count.to_bytes(2, "big")]

    def _answer(self, data: bytes) -> None:
        if data:
            super().write(data)

    def _status(self) -> bytes:
        words = f"i2cdriver1 00000000 000000000 5.000 000 25.0 I 1 1 {self._speed_khz} 24 0000"
        return f"[{words:{STATUS_CHARACTERS - 2}}]".encode()

    def write(self, frame: WireFrame) -> bool:
        """Hand out the bytes of a read; ``False`` if the host waits for none."""
        if not isinstance(frame, bytes):
            raise TransportError(f"an I2C bus cannot carry the CAN frame {frame}")
        if not self._wanted:
            return False
        count, self._wanted = self._wanted, 0
        self._handed_out += count
        return super().write(frame[:count].ljust(count, b"\xff"))
