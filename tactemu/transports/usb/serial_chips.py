"""USB-serial chips: CDC-ACM, FT232R, FT2232C, CP2102, CH340.

Each is as its Linux driver and its published descriptors show it. Requests and divisors are those of Linux 6.1,
``drivers/usb/class/cdc-acm.c`` and ``drivers/usb/serial/{ftdi_sio,cp210x,ch341}.c``; descriptors are ``lsusb -v`` of
real chips: FT232RL (ksksue.hatenadiary.org, 2012-02-12), FT2232C (community.sparkfun.com topic 5031; a board's EEPROM
sets its current), CP2102 (mvp/uhubctl issue 526), CH340 (memtest86plus pull request 387).
"""

from __future__ import annotations

import struct

from firmware_protocols import USB
from tactemu.transports.usb.chip import CLASS, DONE, TO_HOST, VENDOR, Chip, Setup
from tactemu.transports.usb.descriptors import ASSOCIATION, Descriptors, Endpoint, Interface, descriptor

_PARITY = "NOEMS"
_STOP_BITS = (1, 1.5, 2)
_VENDOR_SPECIFIC = 0xFF


class CdcAcm(Chip):
    """A board with USB of its own: ``/dev/ttyACM0`` (USB CDC 1.2, subclass PSTN)."""

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self._coding = struct.pack("<IBBB", 9600, 0, 0, 8)

    def descriptors(self) -> Descriptors:
        """Return the descriptors: an association of a communication and a data interface."""
        vid, pid = self.ids(0x1209, 0x0001)
        call, data = 0, 1
        functional = (b"\x00\x10\x01", bytes((1, 0, data)), b"\x02\x06", bytes((6, call, data)))
        extra = b"".join(descriptor(0x24, each) for each in functional)
        interfaces = (
            Interface((2, 2, 1), (Endpoint(0x83, "interrupt", 8, 16),), extra=extra),
            Interface((10, 0, 0), (Endpoint(0x81, "bulk", 64), Endpoint(0x02, "bulk", 64))),
        )
        head = descriptor(ASSOCIATION, bytes((call, 2, 2, 2, 1, 0)))
        return Descriptors(vid, pid, 0x0100, interfaces, self.named("", ""), code=(0xEF, 2, 1), head=head)

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out SET/GET_LINE_CODING, SET_CONTROL_LINE_STATE, SEND_BREAK."""
        if setup.type != CLASS:
            return None
        match setup.request:
            case 0x20 if len(data) >= 7:
                self._coding = data[:7]
                baud, stop, parity, bits = struct.unpack("<IBBB", self._coding)
                self.set(baud=baud, bytesize=bits, parity=_PARITY[parity % 5], stopbits=_STOP_BITS[stop % 3])
                return DONE
            case 0x21:
                return self._coding
            case 0x22:
                self.set_lines(setup.value)
                return DONE
            case 0x23:
                self.note("break" if setup.value else "break ends")
                return DONE
        return None


class Ft232R(Chip):
    """An FT232R: each packet of 64 bytes to the host begins with two bytes of status."""

    clock_hz = 3_000_000
    """The speed of divisor 1 [bit/s]."""
    _EIGHTHS = (0, 4, 2, 1, 3, 5, 6, 7)
    """Eighths of the divisor by their code."""

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self.latency_ms = 16
        """The time for which the chip gathers bytes, as the driver has set it."""
        self.modem = 0x31
        """The modem status: CTS and DSR are up."""
        self.line_errors = 0
        """The error bits of the line status: 2 overrun, 4 parity, 8 framing, 16 break."""
        self.is_transmitter_empty = True

    def descriptors(self) -> Descriptors:
        """Return the descriptors of an FT232RL."""
        vid, pid = self.ids(0x0403, 0x6001)
        ends = (Endpoint(0x81, "bulk", 64), Endpoint(0x02, "bulk", 64))
        code = (_VENDOR_SPECIFIC, _VENDOR_SPECIFIC, _VENDOR_SPECIFIC)
        return Descriptors(
            vid, pid, 0x0600, (Interface(code, ends, string=2),), self.named("FTDI", "FT232R USB UART"),
            control_bytes=8, attributes=0x20, power_ma=90,
        )  # fmt: skip

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out the vendor's requests: reset, modem lines, speed, format, latency timer, status, EEPROM."""
        if setup.type != VENDOR:
            return None
        if setup.kind & TO_HOST:
            return {5: self.status, 10: bytes((self.latency_ms,)), 0x90: b"\xff\xff"}.get(setup.request)
        match setup.request:
            case 1:
                self.set_lines(setup.value, setup.value >> 8)
            case 3:
                self.set(baud=self.made_baud(setup.value | setup.target << 16))
            case 4:
                bits, parity, stop = setup.value & 0xFF, setup.value >> 8 & 7, setup.value >> 11 & 3
                self.set(bytesize=bits, parity=_PARITY[parity % 5], stopbits=_STOP_BITS[stop % 3])
                if setup.value & 0x4000:
                    self.note("break")
            case 9:
                self.latency_ms = setup.value & 0xFF
                self.note(f"latency timer {self.latency_ms} ms")
        return DONE

    def made_baud(self, divisor: int) -> int:
        """Return the speed that the chip makes of a divisor: 14 bits, and its eighths in three bits above them."""
        eighths = (divisor & 0x3FFF) * 8 + self._EIGHTHS[divisor >> 14 & 7]
        if eighths in (0, 8):  # two exceptions: 3 and 2 Mbit/s
            return 3_000_000 if eighths == 0 else 2_000_000
        return round(self.clock_hz * 8 / eighths)

    @property
    def status(self) -> bytes:
        """The two bytes of modem and line status."""
        return bytes((self.modem, (0x60 if self.is_transmitter_empty else 0) | self.line_errors))

    def packets_to_host(self, data: bytearray, length: int) -> bytes:
        """Return a transfer of packets, each with its status; without data one packet of status alone."""
        packets = bytearray()
        while len(packets) + 3 <= length and (data or not packets):
            room = min(62, length - len(packets) - 2)
            packets += self.status + data[:room]
            del data[:room]
        return bytes(packets)


class Ft2232(Chip):
    """An FT2232C or FT2232D: two UARTs, channels A and B, each with an interface and a node of its own."""

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self.channels = Ft232R(identity), Ft232R(identity)
        for number, each in enumerate(self.channels):
            each.data_in, each.data_out = 0x81 + 2 * number, 0x02 + 2 * number

    def descriptors(self) -> Descriptors:
        """Return the descriptors of an FT2232C."""
        vid, pid = self.ids(0x0403, 0x6010)
        code = (_VENDOR_SPECIFIC, _VENDOR_SPECIFIC, _VENDOR_SPECIFIC)
        interfaces = [
            Interface(code, (Endpoint(each.data_in, "bulk", 64), Endpoint(each.data_out, "bulk", 64)), string=2)
            for each in self.channels
        ]
        return Descriptors(vid, pid, 0x0500, interfaces, self.named("FTDI", "Dual RS232"), control_bytes=8)

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out a request of the channel that the low byte of ``wIndex`` names: 1 is A, 2 is B."""
        number = min(max(setup.target & 0xFF, 1), 2) - 1
        return self.channels[number].control(setup._replace(target=setup.target >> 8), data)


class Cp2102(Chip):
    """A CP2102: the vendor's requests to its interface."""

    data_out = 0x01

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self._baud, self._format, self._flow = 9600, 0x0800, bytes(16)

    def descriptors(self) -> Descriptors:
        """Return the descriptors of a CP2102."""
        vid, pid = self.ids(0x10C4, 0xEA60)
        ends = (Endpoint(0x81, "bulk", 64), Endpoint(0x01, "bulk", 64))
        strings = self.named("Silicon Labs", "CP2102 USB to UART Bridge Controller", "0001")
        return Descriptors(
            vid, pid, 0x0100, (Interface((_VENDOR_SPECIFIC, 0, 0), ends, string=2),), strings, usb=0x0110
        )

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out the vendor's requests (application note 571)."""
        if setup.type != VENDOR:
            return None
        if setup.kind & TO_HOST:
            if setup.request == 0xFF:
                return {0x370B: b"\x02", 0x370C: None}.get(setup.value)  # the part number of a CP2102
            return {
                0x1D: struct.pack("<I", self._baud), 0x04: struct.pack("<H", self._format), 0x08: b"\x33",
                0x14: self._flow, 0x10: bytes(19), 0x0F: bytes(64),
            }.get(setup.request)  # fmt: skip
        match setup.request:
            case 0x1E if len(data) >= 4:
                self._baud = struct.unpack("<I", data[:4])[0]  # the driver asks for speeds that a CP2102 has
                self.set(baud=self._baud)
            case 0x03:
                self._format = setup.value
                bits, parity, stop = setup.value >> 8, setup.value >> 4 & 15, setup.value & 15
                self.set(bytesize=bits, parity=_PARITY[parity % 5], stopbits=_STOP_BITS[stop % 3])
            case 0x05:
                self.note("break" if setup.value else "break ends")
            case 0x07:
                self.set_lines(setup.value, setup.value >> 8)
            case 0x13:
                self._flow = data
        return DONE


class Ch340(Chip):
    """A CH340: speed and format are registers of the chip."""

    data_in, data_out = 0x82, 0x02
    clock_hz = 48_000_000

    def __init__(self, identity: USB | None = None):
        super().__init__(identity)
        self._registers: dict[int, int] = {}

    def descriptors(self) -> Descriptors:
        """Return the descriptors of a CH340."""
        vid, pid = self.ids(0x1A86, 0x7523)
        ends = (Endpoint(0x82, "bulk", 32), Endpoint(0x02, "bulk", 32), Endpoint(0x81, "interrupt", 8, 1))
        return Descriptors(
            vid, pid, 0x0262, (Interface((_VENDOR_SPECIFIC, 1, 2), ends),), self.named("", "USB2.0-Serial"),
            code=(_VENDOR_SPECIFIC, 0, 0), usb=0x0110, control_bytes=8, power_ma=98,
        )  # fmt: skip

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out the vendor's requests: version, modem control, and pairs of registers read and written."""
        if setup.type != VENDOR:
            return None
        if setup.kind & TO_HOST:
            if setup.request == 0x5F:  # version 3.0
                return b"\x30\x00"
            if setup.request == 0x95:
                return bytes(self._read(register) for register in (setup.value & 0xFF, setup.value >> 8))
            return None
        match setup.request:
            case 0x9A:
                for register, value in zip(
                    (setup.value & 0xFF, setup.value >> 8), (setup.target & 0xFF, setup.target >> 8)
                ):
                    self._registers[register] = value
                self._apply(setup.value)
            case 0xA1:  # initialisation: the same two pairs in one request
                self._registers[0x18] = setup.value >> 8
                self._registers[0x12], self._registers[0x13] = setup.target & 0xFF, setup.target >> 8
                self._apply(0x1312)
                self._apply(0x2518)
            case 0xA4:
                self.set_lines((~setup.value >> 5 & 1) | (~setup.value >> 6 & 1) << 1)
        return DONE

    def _read(self, register: int) -> int:
        """Return a register: 6 is the modem status, active low: CTS, DSR and DCD are up."""
        return 0xF4 if register == 0x06 else self._registers.get(register, 0)

    def _apply(self, pair: int) -> None:
        prescaler, divisor = self._registers.get(0x12, 0), self._registers.get(0x13, 0)
        if pair == 0x1312 and divisor:
            scale = 1 << (12 - 3 * (prescaler & 3) - (prescaler >> 2 & 1))
            self.set(baud=round(self.clock_hz / scale / (256 - divisor)))
        elif pair == 0x1805:
            self.note("break ends" if self._registers[0x05] & 1 else "break")
        elif pair in (0x2518, 0x1818):
            line = self._registers.get(0x18, 0)
            parity = "N" if not line & 0x08 else "OEMS"[line >> 4 & 3]
            self.set(bytesize=5 + (line & 3), parity=parity, stopbits=2 if line & 4 else 1)


CHIPS: dict[str, type[Chip]] = {"cdc": CdcAcm, "ftdi": Ft232R, "ft2232": Ft2232, "cp210x": Cp2102, "ch341": Ch340}
"""The chips by the name of their driver in Linux; FTDI's second one by its own."""
_VENDORS = {0x0403: "ftdi", 0x10C4: "cp210x", 0x1A86: "ch341"}
_PRODUCTS = {(0x0403, 0x6010): "ft2232"}


def chip_of(usb: bool | USB) -> type[Chip]:
    """Return the chip of a connector: CDC-ACM where its node is ttyACM, else that of the vendor, else an FT232R."""
    if usb is True or (isinstance(usb, USB) and usb.node == "ttyACM"):
        return CdcAcm
    if not isinstance(usb, USB):
        return Ft232R
    return CHIPS[_PRODUCTS.get((usb.vid, usb.pid)) or _VENDORS.get(usb.vid, "ftdi")]
