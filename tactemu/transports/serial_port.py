"""``serial:/dev/ttyUSB0``: a real UART, RS-485 line or USB adapter, with real hardware at the other end of the cable.

``serial:by-id/NAME`` and ``serial:ttyAMA0`` are names in ``/dev/serial`` and ``/dev``. Options follow a ``?``, joined
by ``&``:

    rs485=adapter|kernel   the line is half duplex; the adapter switches its direction, or the kernel does by RTS
    echo=1                 the adapter receives what it sends; those bytes are taken out again
    reader=dsr|cts|cd      the modem line that says that a driver has the other end open; default: it always has
    rtscts=1               hardware flow control

A real line differs from a pseudo terminal:

* It has a speed. The wire hands a frame over when its first bit may leave (``is_paced``), and the UART takes the time.
* Its setting is ours: the device's. A driver with another setting receives noise, made by the line itself.
* The UART may make another speed of the one that it was asked for; it is read back. More than 1.5 % off is an error.
* Parity errors, framing errors, breaks and lost bytes are those of the line, counted by the kernel.
* Modem lines cross over in a null-modem cable: the other end's DTR and RTS are our DSR and CTS.
* An adapter can be pulled out. The port waits for it, by its name in ``/dev/serial/by-id`` if it has one.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import termios
from collections import deque
from pathlib import Path
from urllib.parse import parse_qsl

from firmware_protocols import Connector, Serial, WireFrame
from tactemu.base.errors import TransportError, nearest, reason_of
from tactemu.base.timer_fd import PeriodicTimer
from tactemu.transports import uart_settings
from tactemu.transports.byte_port import BytePort
from tactemu.transports.forks import close_in_children
from tactemu.transports.transport import (
    DROPPED,
    MAX_CHUNK_BYTES,
    RAISED,
    Closed,
    Counted,
    Event,
    LinesChanged,
    Noted,
    Opened,
    Received,
    SerialSetting,
)  # fmt: skip
from tactemu.transports.uart_settings import MarkedStream, UartErrors

MAX_BAUD_DEVIATION = 0.015
"""Largest deviation of a UART's speed from the device's; two ends that are each 2 % off receive noise."""
MAX_UNSENT_S = 0.02
"""Longest time on the line of bytes that wait in the kernel; a frame that would wait longer is dropped."""
MAX_ECHO_BYTES = 4096
"""Maximum number of own bytes that are waited for; an adapter that returns none has no echo."""
LOOK_PERIOD_NS = 20_000_000
"""Period at which counters and the name of a missing adapter are looked at: they wake no ``select``."""
LOOKS_PER_LINES = 10
"""Number of looks for one at the modem lines, where no ``reader`` depends on them: with a USB adapter it is a transfer,
for which the loop waits."""
_OPTIONS = {"rs485": ("adapter", "kernel"), "echo": ("0", "1"), "reader": ("dsr", "cts", "cd"), "rtscts": ("0", "1")}
_READER_LINES = {"dsr": termios.TIOCM_DSR, "cts": termios.TIOCM_CTS, "cd": termios.TIOCM_CD}
_HINTS = {
    errno.EACCES: "you may not open it: sudo usermod -aG dialout $USER, then log in again",
    errno.EBUSY: "another program has it: fuser -v {path}",
    errno.ENOENT: "it is not there: ls /dev/serial/by-id /dev/tty[UAS]*",
    errno.EIO: "there is no UART behind it",
}


class SerialPortTransport(BytePort):
    """The device's end of a real serial line.

    Args:
        location: a path or a name, and options behind a ``?``.

    Raises:
        TransportError: there is no path, or no such option.
    """

    scheme = "serial"
    is_paced = True

    def __init__(self, location: str):
        path, _, query = location.partition("?")
        if not path:
            raise TransportError("port 'serial:': which port? For example serial:/dev/ttyUSB0, or serial:by-id/NAME")
        self._options = _parsed_options(location, query)
        folder = "/dev/serial" if path.startswith(("by-id/", "by-path/")) else "/dev"
        self.address = os.path.join(folder, path)
        self._found_at = self.address
        """The name under which a missing adapter is waited for."""
        self._serial = Serial(baud=9600)
        self._fd = -1
        self._timer: PeriodicTimer | None = None
        self._stream = MarkedStream()
        self._lines: LinesChanged | None = None
        self._looks = 0
        """The number of looks since the port was opened."""
        self._errors: UartErrors | None = None
        self._echo = b""
        """Own bytes that the adapter has not received back yet."""
        self._has_reader = False
        self._is_missing = False
        """True while the adapter is pulled out."""
        self._events: deque[Event] = deque()

    def set_connector(self, connector: Connector) -> None:
        """Take the line's setting from the device.

        Raises:
            TransportError: the device has no UART.
        """
        if not isinstance(connector, Serial):
            raise TransportError(f"port 'serial:{self.address}': the device has no serial line")
        self._serial = connector

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open and lock the port, set it, and read the setting back.

        Raises:
            TransportError: there is no such port, it is in use, or it cannot be set so.
        """
        if self._fd >= 0:
            return
        close_in_children(self)
        try:
            self._open()
        except BaseException:
            self.close()
            raise
        self._timer = self._timer or PeriodicTimer(LOOK_PERIOD_NS)
        self._found_at = _stable_name(self.address)
        self._look()

    def _open(self) -> None:
        try:
            self._fd = os.open(self.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
            if not os.isatty(self._fd):
                raise TransportError(f"{self.address} is no serial port" + self._without_uart())
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # as pyserial's `exclusive`
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
            self._set()
        except BlockingIOError:
            raise TransportError(f"{self.address} is locked by another program: fuser -v {self.address}") from None
        except OSError as error:
            hint = _HINTS.get(error.errno or 0, "check the adapter and its cable").format(path=self.address)
            raise TransportError(f"cannot open {self.address}: {reason_of(error)}; {hint}") from None

    def _without_uart(self) -> str:
        return "" if uart_settings.has_uart(self._fd) else ": there is no UART behind it"

    def _set(self) -> None:
        line = self._serial
        setting = SerialSetting(line.baud, line.bytesize, line.parity, line.stopbits)
        made = uart_settings.apply(self._fd, setting, hardware_flow=self._options.get("rtscts") == "1")
        if not self._is_settingless:
            deviation = made.baud / line.baud - 1
            if abs(deviation) > MAX_BAUD_DEVIATION:
                raise TransportError(
                    f"{self.address} makes {made.baud} bit/s of {line.baud} ({deviation:+.1%}); use an adapter "
                    f"that has this speed"
                )
            if not made.has_format:
                raise TransportError(f"{self.address} cannot do {line.bytesize}{line.parity}{line.stopbits}")
            if made.baud != line.baud:
                self._events.append(Noted(f"{made.baud} bit/s of {line.baud} ({deviation:+.2%})"))
        termios.tcflush(self._fd, termios.TCIOFLUSH)
        if self._options.get("rs485") == "kernel":
            try:
                uart_settings.set_rs485(self._fd)
            except OSError as error:
                raise TransportError(
                    f"{self.address}: its driver cannot switch the direction of RS-485 ({reason_of(error)}); most USB "
                    f"adapters do so by themselves: rs485=adapter"
                ) from None
        low = uart_settings.set_low_latency(self._fd)
        timer = uart_settings.latency_timer_ms(Path(self.address).resolve().name)
        self._events.append(
            Noted(f"low latency {'on' if low else 'not offered'}{f', timer {timer} ms' if timer else ''}")
        )
        self._errors = uart_settings.errors(self._fd)

    @property
    def _is_settingless(self) -> bool:
        """True where no UART is between us and the driver: a pseudo terminal, or the port of a USB gadget."""
        return Path(self.address).resolve().name.startswith("ttyGS") or os.major(os.fstat(self._fd).st_rdev) in range(
            136, 144
        )

    def close(self) -> None:
        """Release the port; bytes that wait are dropped. Safe to call twice."""
        self._release()
        if self._timer is not None:
            self._timer.close()
            self._timer = None
        self._is_missing = False
        self._events.clear()

    def _release(self) -> None:
        if self._fd >= 0:
            with contextlib.suppress(termios.error):  # else the kernel waits for bytes that a dead line holds back
                termios.tcflush(self._fd, termios.TCOFLUSH)
            os.close(self._fd)
            self._fd = -1
        self._stream = MarkedStream()
        self._lines, self._looks, self._has_reader, self._echo, self._unsent = None, 0, False, b"", b""

    # -- events ----------------------------------------------------------------------------------------------------

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the port, and the timer that says when to look at what wakes no ``select``."""
        timer = [self._timer.fileno] if self._timer else []
        return [*timer, self._fd] if reading and self._fd >= 0 else timer

    def poll(self, reading: bool = True) -> list[Event]:
        """Return bytes, breaks and errors, changes of the modem lines, and an adapter that goes or comes back."""
        if self._timer is not None and self._timer.acknowledge():
            if self._is_missing:
                self._come_back()
            elif self._fd >= 0:
                self._look()
        if self._fd >= 0:
            self._finish(self._fd)
            if reading:
                self._read()
        events = list(self._events)
        self._events.clear()
        return events

    def _read(self) -> None:
        try:
            data = os.read(self._fd, MAX_CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error.strerror or "lost")
            return
        if not data:
            self._lose("hung up")
            return
        data, breaks, bad = self._stream.decode(data)
        if breaks or bad:
            self._look()  # the counters have grown
        if breaks and self._errors is None:
            self._events.append(Noted("break"))
        if data and self._echo:
            data = self._without_echo(data)
        if data:
            self._events.append(Received(data))

    def _without_echo(self, data: bytes) -> bytes:
        own = min(len(data), len(self._echo))
        while data[:own] != self._echo[:own]:
            own -= 1
        self._echo = self._echo[own:]
        if own < len(data) and self._echo:
            self._events.append(Noted("own bytes came back changed: two ends were sending"))
            self._echo = b""
        return data[own:]

    def _look(self) -> None:
        """Report changes of the modem lines and of the error counters."""
        if self._looks % (1 if self._options.get("reader") else LOOKS_PER_LINES) == 0:
            self._look_at_lines()
        self._looks += 1
        counts = uart_settings.errors(self._fd)
        if counts is not None and self._errors is not None:
            for name, count in counts.since(self._errors).items():
                self._events.append(Counted(name, count))
        self._errors = counts

    def _look_at_lines(self) -> None:
        try:
            bits = struct.unpack("I", fcntl.ioctl(self._fd, termios.TIOCMGET, bytes(4)))[0]
        except OSError:
            bits = None  # a pseudo terminal has no lines
        lines = RAISED if bits is None else LinesChanged(bool(bits & termios.TIOCM_DSR), bool(bits & termios.TIOCM_CTS))
        line = self._options.get("reader")
        has_reader = not line or bits is None or bool(bits & _READER_LINES[line])
        if has_reader and not self._has_reader:
            self._events.append(Opened())
        if lines != self._lines and (line or lines != DROPPED):  # with three wires, lines that are down say nothing
            self._events.append(lines)
        if self._has_reader and not has_reader:
            self._events.append(Closed())
        self._has_reader, self._lines = has_reader, lines

    def _lose(self, why: str) -> None:
        """Report that the adapter has gone."""
        if self._has_reader:
            self._events += (Closed(), DROPPED)
        self._release()
        self._is_missing = True
        self._events.append(Noted(f"{self.address} has gone: {why}"))

    def _come_back(self) -> None:
        if not os.path.exists(self._found_at):
            return
        self.address = self._found_at
        try:
            self._open()
        except TransportError:  # udev has not set its rights yet
            self._release()
            return
        self._is_missing = False
        self._events.append(Noted(f"{self.address} is back"))
        self._look()

    # -- bytes out -------------------------------------------------------------------------------------------------

    def write(self, frame: WireFrame) -> bool:
        """Write one frame; ``False`` without a reader, or where it would wait in the kernel for too long."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a serial port cannot carry the CAN frame {frame}")
        if self._fd < 0 or not self._has_reader or not self._finish(self._fd) or self._unsent_s() > MAX_UNSENT_S:
            return False
        is_sent = self._put(self._fd, frame)
        if is_sent and self._options.get("echo") == "1":
            self._echo += frame
            if len(self._echo) > MAX_ECHO_BYTES:
                self._events.append(Noted("no echo comes back: the adapter does not receive what it sends"))
                self._echo = b""
        return is_sent

    def _unsent_s(self) -> float:
        return uart_settings.unsent(self._fd) * self._serial.bits_per_byte / self._serial.baud

    @property
    def has_reader(self) -> bool:
        """True while a driver has the other end open, as far as a modem line says so."""
        return self._has_reader


def _parsed_options(location: str, query: str) -> dict[str, str]:
    options = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in options.items():
        if name not in _OPTIONS:
            known = ", ".join(_OPTIONS)
            raise TransportError(
                f"port 'serial:{location}': unknown option {name!r}{nearest(name, _OPTIONS)}; expected {known}"
            )
        if value not in _OPTIONS[name]:
            known = " or ".join(_OPTIONS[name])
            raise TransportError(f"port 'serial:{location}': {name}={value!r}; expected {known}")
    return options


def _stable_name(path: str) -> str:
    """Return the name of an adapter that it keeps in whichever socket it is plugged, or the path if it has none."""
    node = os.path.realpath(path)
    with contextlib.suppress(OSError):
        for link in sorted(Path("/dev/serial/by-id").iterdir()):
            if os.path.realpath(link) == node:
                return str(link)
    return path
