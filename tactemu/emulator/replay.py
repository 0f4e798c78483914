"""The replay of recorded streams to a driver, and the recording of a sensor's stream: loops around ``recording.py``."""

from __future__ import annotations

import os
import select
from collections.abc import Callable

from firmware_protocols import Can, Connector, Serial
from tactemu.base.clock import Clock
from tactemu.base.errors import TactemuError, TransportError, reason_of
from tactemu.base.loop import Loop
from tactemu.transports import create
from tactemu.transports.transport import Opened, Received
from tactemu.truth.entries import Passage
from tactemu.truth.recorder import Recorder
from tactemu.truth.recording import Recording
from tactemu.wire.wire import Wire

DEFAULT_BAUD = 115_200
"""Speed of a serial port whose speed is not given [bit/s]."""
_UARTS = ("ttyS", "ttyUSB", "ttyAMA", "ttyTHS", "ttymxc", "ttyO", "COM", "cu.usbserial", "tty.usbserial")
"""Names of ports with a UART on Linux, macOS and Windows."""


def connector_for(recording: Recording, baud: int | None = None) -> Connector:
    """Return the connector that a recording needs: CAN, a UART if its speed is known, else USB.

    The entries have the spacing of the recorded line: make the wire that replays them with ``pacing=False``.
    """
    if recording.kind == "can":
        return Can()
    baud = baud or recording.baud
    return Serial(baud=baud or DEFAULT_BAUD, usb=baud is None)


class Replay(Loop):
    """A loop that sends the frames of a recording to a driver through a wire.

    Args:
        recording: the recording to play.
        wire: the wire to the driver.
        clock: real or virtual.
        speed: 2 is twice as fast. Infinity sends all at once; use :meth:`send_next` to send one frame at a time.
        loop: start again at the end.
    """

    def __init__(self, recording: Recording, wire: Wire, *, clock: Clock, speed: float = 1.0, loop: bool = False):
        if not speed > 0:
            raise TactemuError(f"speed: expected more than 0, got {speed}")
        super().__init__(clock, [wire])
        self.wire, self.speed, self.loop = wire, speed, loop
        wire.is_real_time = not clock.virtual
        self.entries = recording.towards_driver()
        if not self.entries:
            raise TactemuError("the recording has nothing that goes to a driver")
        self.position = 0
        """Index of the next entry."""
        self._start_ns: int | None = None

    @property
    def is_done(self) -> bool:
        """True once everything has been sent."""
        return self.position >= len(self.entries)

    @property
    def is_finished(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """True once everything has been sent and has left the line."""
        return self.is_done and self.wire.next_due_ns() is None

    def run(self, seconds: float | None = None) -> None:
        """Play until the end, for ``seconds``, or until :meth:`stop`, also if that was called before.

        Time starts when the driver opens the port.
        """
        self._calls.open()
        try:
            super().run(seconds)
        finally:
            self._calls.close()

    def step(self, end_ns: int | None = None) -> None:
        """Run one turn, and wait until the next one."""
        now = self.now_ns = self.clock.now_ns()
        self.turn(now)
        self._calls.run(now)
        self._wait([self._due_ns(), self.wire.next_due_ns(), end_ns])

    def turn(self, now_ns: int) -> None:
        """Receive port events, send the entries that are due, and write them to the port."""
        for event in self.wire.receive(now_ns):
            if isinstance(event, Opened):
                self._restart(now_ns)
        if self._start_ns is None and self.wire.transport.has_reader:
            self._restart(now_ns)  # a bus reports no opening of its port
        for _ in self.entries:  # at most one round, also in an endless loop at infinite speed
            due = self._due_ns()
            if due is None or due > now_ns:
                break
            self.send_next(due)
            self.wire.flush(now_ns)  # after each entry: a late loop has many, and the queue of a line is limited
        self.wire.flush(now_ns)

    def send_next(self, now_ns: int) -> Passage | None:
        """Send the next frame, whatever its time, and return its entry; ``None`` at the end."""
        if self.is_done:
            return None
        entry = self.entries[self.position]
        self.wire.send([entry.frame], now_ns, entry.device)
        self.position += 1
        if self.is_done and self.loop:
            self._restart(now_ns)
        return entry

    def _restart(self, now_ns: int) -> None:
        self._start_ns, self.position = now_ns, 0

    def _due_ns(self) -> int | None:
        if self._start_ns is None or self.is_done:
            return None
        return self._start_ns + round(self.entries[self.position].t_ns / self.speed)


def line_note(source: str, baud: int | None) -> str:
    """Return the line in the header of a recording: its speed, ``usb`` if it has none, an empty text for CAN.

    Network connections and USB's serial class have no speed, whatever a program sets. A port of unknown hardware (a
    pty) counts as one of them, unless the caller gives ``baud``.
    """
    if source.startswith("can:"):
        return ""
    name = os.path.basename(os.path.realpath(source))
    if baud is None and not name.startswith(_UARTS):
        return "usb"
    return f"baud {baud or DEFAULT_BAUD}"


def record(
    source: str, recorder: Recorder, *, clock: Clock, stop: Callable[[int], bool], baud: int = DEFAULT_BAUD
) -> None:
    """Record a sensor's bytes or frames until ``stop(number of entries)`` returns True; it is called at least every
    100 ms.

    Args:
        source: a serial port or URL of pyserial (``/dev/ttyUSB0``, ``socket://...``), or ``can:INTERFACE:CHANNEL``.
        recorder: the open file.
        clock: the clock of the entries' times.
        stop: returns True when the recording is to end.
        baud: speed to set on a serial port [bit/s].

    Raises:
        TransportError: the source cannot be opened, or was lost.
        TactemuError: the file can no longer be written.
    """
    take = _from_can if source.startswith("can:") else _from_serial
    take(source, recorder, clock, stop, baud)


def _from_can(source: str, recorder: Recorder, clock: Clock, stop: Callable[[int], bool], baud: int) -> None:
    with create(source) as port:
        recorder.start(clock.origin_ns)
        while not stop(recorder.count):
            clock.wait(clock.now_ns() + 100_000_000, port.filenos(), poll=not port.filenos())
            now = clock.now_ns()
            for event in port.poll():
                if isinstance(event, Received):
                    recorder.add(Passage(now, "", "tx", event.data))


def _from_serial(source: str, recorder: Recorder, clock: Clock, stop: Callable[[int], bool], baud: int) -> None:
    import serial

    try:
        with serial.serial_for_url(source, baudrate=baud, timeout=0.1) as port:
            recorder.start(clock.origin_ns)
            while not stop(recorder.count):
                if hasattr(port, "fileno") and not select.select([port], [], [], 0.1)[0]:
                    continue
                data = port.read(max(1, port.in_waiting))
                if data:
                    recorder.add(Passage(clock.now_ns(), "", "tx", data))
    except (OSError, ValueError) as error:  # pyserial's own error is an OSError
        raise TransportError(
            f"cannot record from {source}: {reason_of(error)}; check its name and your permission to read it"
        ) from None
