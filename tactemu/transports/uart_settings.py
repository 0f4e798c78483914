"""Settings and counters of a real UART that termios does not name: true speed, error counters, latency.

Numbers are those of Linux on x86, ARM and RISC-V: ``asm-generic/ioctls.h``, ``asm-generic/termbits.h``,
``linux/serial.h``.
"""

from __future__ import annotations

import errno
import fcntl
import struct
import termios
from dataclasses import dataclass, fields
from pathlib import Path

from tactemu.transports.transport import SerialSetting

_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_TERMIOS2 = struct.Struct("4I20s2I")
_LINE_AND_CHARACTERS = bytes(7) + b"\x01" + bytes(12)
"""No line discipline; ``VMIN`` is 1, so that a read without data is an error, and one of 0 bytes the end."""
_BOTHER = 0o010000
"""The speed is a number in ``termios2`` instead of one of a list."""
_CRTSCTS = 0o20000000000
_PARITY_FLAGS = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}
_SIZE_FLAGS = {5: termios.CS5, 6: termios.CS6, 7: termios.CS7, 8: termios.CS8}
_FORMAT = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB

_TIOCGSERIAL, _TIOCSSERIAL = 0x541E, 0x541F
_SERIAL_STRUCT_BYTES, _FLAGS_AT = 72, 16
"""Size of ``struct serial_struct`` on 64-bit machines, and the offset of its ``flags`` [byte]."""
_ASYNC_LOW_LATENCY = 1 << 13
_TIOCGICOUNT, _ICOUNT = 0x545D, struct.Struct("11i36x")
_TIOCSRS485, _RS485 = 0x542F, struct.Struct("8I")
_RS485_ENABLED, _RS485_RTS_ON_SEND = 1, 2


@dataclass(frozen=True, slots=True)
class UartErrors:
    """Counts of what went wrong on the line, as the driver of the UART has counted it since the machine started."""

    framing: int = 0
    """Bytes without a stop bit: another speed or format."""
    uart_overrun: int = 0
    """Bytes that the UART lost because the kernel was too late."""
    parity: int = 0
    breaks: int = 0
    buffer_overrun: int = 0
    """Bytes that the kernel's buffer lost because the program was too late."""

    def since(self, before: UartErrors) -> dict[str, int]:
        """Return the counts that have grown since ``before``, and by how much."""
        grown = {field.name: getattr(self, field.name) - getattr(before, field.name) for field in fields(self)}
        return {name: count for name, count in grown.items() if count > 0}


@dataclass(frozen=True, slots=True)
class MadeSetting:
    """The setting that a UART made of the one that it was asked for."""

    baud: int
    """The speed as its driver reports it [bit/s]; of USB adapters mostly the speed that was asked for."""
    has_format: bool
    """True if byte size, parity and stop bits are as asked for."""


def apply(fd: int, setting: SerialSetting, *, hardware_flow: bool) -> MadeSetting:
    """Set a port raw at this setting, errors marked in the stream (``PARMRK``); return what the UART made of it.

    DTR and RTS, which are up while the port is open, drop when it is closed (``HUPCL``): the other end sees it.

    Raises:
        OSError: the port does not take it.
    """
    assert setting.baud and setting.bytesize and setting.parity
    control = termios.CLOCAL | termios.CREAD | termios.HUPCL | _BOTHER | _BOTHER << 16
    control |= _SIZE_FLAGS[setting.bytesize] | _PARITY_FLAGS[setting.parity]
    control |= termios.CSTOPB * (setting.stopbits == 2) | _CRTSCTS * hardware_flow
    inputs = termios.PARMRK | termios.INPCK * (setting.parity != "N")
    fcntl.ioctl(fd, _TCSETS2, _TERMIOS2.pack(inputs, 0, control, 0, _LINE_AND_CHARACTERS, setting.baud, setting.baud))
    made = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))
    return MadeSetting(made[-1], not (made[2] ^ control) & _FORMAT)


def errors(fd: int) -> UartErrors | None:
    """Return the counts of the UART's driver, or None if it keeps none."""
    try:
        counts = _ICOUNT.unpack(fcntl.ioctl(fd, _TIOCGICOUNT, bytes(_ICOUNT.size)))
    except OSError:
        return None
    return UartErrors(*counts[6:11])


def set_low_latency(fd: int) -> bool:
    """Ask the driver to pass received bytes on at once; return False if it has no such setting."""
    state = bytearray(_SERIAL_STRUCT_BYTES)
    try:
        fcntl.ioctl(fd, _TIOCGSERIAL, state)
        flags = struct.unpack_from("i", state, _FLAGS_AT)[0]
        struct.pack_into("i", state, _FLAGS_AT, flags | _ASYNC_LOW_LATENCY)
        fcntl.ioctl(fd, _TIOCSSERIAL, bytes(state))
    except OSError:
        return False
    return True


def latency_timer_ms(node: str) -> int | None:
    """Return the time for which a USB adapter gathers bytes [ms], or None if its driver has no such timer."""
    try:
        return int(Path("/sys/class/tty", node, "device/latency_timer").read_text())
    except (OSError, ValueError):
        return None


def set_rs485(fd: int) -> None:
    """Let the kernel raise RTS while it sends, and drop it after the last bit.

    Raises:
        OSError: the driver cannot.
    """
    fcntl.ioctl(fd, _TIOCSRS485, _RS485.pack(_RS485_ENABLED | _RS485_RTS_ON_SEND, *[0] * 7))


def unsent(fd: int) -> int:
    """Return the number of bytes in the kernel that the UART has not taken yet; 0 if its driver does not tell."""
    try:
        return struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, bytes(4)))[0]
    except OSError:
        return 0


def has_uart(fd: int) -> bool:
    """Return False if the node has no UART behind it: of a PC's ``ttyS`` nodes most have none."""
    try:
        fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size))
    except OSError as error:
        return error.errno != errno.EIO
    return True


class MarkedStream:
    """A decoder of the kernel's marks in the stream: FF FF is FF, FF 00 00 a break, FF 00 X a byte in error."""

    def __init__(self):
        self._pending = b""
        """The beginning of a mark whose end has not come yet."""

    def decode(self, data: bytes) -> tuple[bytes, int, int]:
        """Return the bytes, the number of breaks, and the number of bytes with a parity or framing error.

        A byte in error is handed over as it was received, as by the noise of :mod:`tactemu.wire.uart`.
        """
        data, self._pending = self._pending + data, b""
        out, at, breaks, bad = bytearray(), 0, 0, 0
        while (mark := data.find(b"\xff", at)) >= 0:
            out += data[at:mark]
            second = data[mark + 1 : mark + 2]
            length = 2 if second == b"\xff" else 3
            if len(data) - mark < length:
                self._pending = data[mark:]
                return bytes(out), breaks, bad
            if length == 2:
                out.append(0xFF)
            elif data[mark + 2]:
                out.append(data[mark + 2])
                bad += 1
            else:
                breaks += 1
            at = mark + length
        return bytes(out + data[at:]), breaks, bad
