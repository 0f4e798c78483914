"""Two USB-serial adapters and a null-modem cable between them, by USB/IP: a bench for ``serial:`` without hardware.

Bytes take their time at the sender's speed. A receiver that is set otherwise receives noise, and the status of an
FT232R says framing or parity error. Modem lines and breaks cross over. A chip with a full buffer takes no more of its
host.
"""

import select
import threading
import time
from collections import Counter

from firmware_protocols import USB, Serial
from tactemu.transports.transport import LinesChanged, Noted, Received, SerialSetting, SettingChanged
from tactemu.transports.usb.serial_chips import Ft232R
from tactemu.transports.usbip import UsbIpTransport
from tactemu.wire.uart import agree, as_received

BUFFER_BYTES, PACKET_BYTES = 256, 62
CTS, DSR_AND_CD, ALWAYS = 0x10, 0xA0, 0x01
"""Bits of the modem status of an FT232R."""
BREAK, FRAMING, PARITY = 0x10, 0x08, 0x04
"""Bits of its line status."""


class End:
    """One adapter, and what leaves it."""

    def __init__(self, address: str, name: str, chip: str):
        self.port = UsbIpTransport(f"{chip}@{address}")
        self.port.set_connector(Serial(baud=9600, usb=USB(0x0403, 0x6001, serial=name, node="ttyUSB")))
        self.port.open()
        self.other = self
        self.setting = SerialSetting(9600, 8, "N", 1)
        self.counts = Counter()
        self._leaving, self._free_s = bytearray(), 0.0
        self._arrived, self._since_s = bytearray(), 0.0
        self.chip = self.port._chip if isinstance(self.port._chip, Ft232R) else Ft232R()
        """The chip; of another one than an FT232R the state has no effect."""
        self.chip.modem = ALWAYS

    @property
    def is_busy(self) -> bool:
        return bool(self._leaving or self._arrived)

    def turn(self, now_s: float) -> None:
        """Take what the host sends, as far as there is room, and send on what has had its time on the line."""
        for event in self.port.poll(reading=len(self._leaving) < BUFFER_BYTES):
            match event:
                case Received(data):
                    if not self._leaving:
                        self._free_s = now_s
                    self._leaving += data
                case SettingChanged(made):
                    self.setting = SerialSetting(
                        made.baud or 9600, made.bytesize or 8, made.parity or "N", made.stopbits or 1
                    )
                case LinesChanged(dtr, rts):
                    self.other.chip.modem = ALWAYS | CTS * rts | DSR_AND_CD * dtr
                case Noted("break"):
                    self.other.deliver()
                    self.other.hear(b"\0", BREAK, now_s)
                    self.other.deliver()
        s = self.setting
        byte_s = (1 + s.bytesize + (s.parity != "N") + s.stopbits) / s.baud
        if count := min(len(self._leaving), int((now_s - self._free_s) / byte_s)):
            data = bytes(self._leaving[:count])
            del self._leaving[:count]
            self._free_s += count * byte_s
            self.counts["sent"] += count
            self.other.receive(data, self.setting, now_s)
        self.chip.is_transmitter_empty = not self._leaving
        if self._arrived and now_s - self._since_s >= self.chip.latency_ms / 1000:
            self.deliver()

    def receive(self, data: bytes, sent: SerialSetting, now_s: float) -> None:
        if agree(sent, self.setting):
            self.hear(data, 0, now_s)
            return
        self.deliver()
        self.hear(as_received(data, sent, self.setting), FRAMING if self.setting.parity == "N" else PARITY, now_s)
        self.deliver()

    def hear(self, data: bytes, errors: int, now_s: float) -> None:
        if not self._arrived:
            self._since_s = now_s
        self._arrived += data
        self.chip.line_errors = errors
        if len(self._arrived) >= PACKET_BYTES:
            self.deliver()

    def deliver(self) -> None:
        """Hand what has arrived to the host."""
        if self._arrived and not self.port.write(bytes(self._arrived)):
            self.counts["lost"] += len(self._arrived)
        self._arrived.clear()
        self.chip.line_errors = 0


class NullModem:
    """The two ends, moved by a thread; ``pull`` takes the adapter of one end away and brings it back."""

    def __init__(self, number: int = 0, near: str = "ftdi"):
        first = End(str(number), "NEAR", near)
        self.number = int(first.port.address.split("--tcp-port ")[1].split()[0])
        self.ends = (first, End(str(self.number), "FAR", "ftdi"))
        first.other, self.ends[1].other = self.ends[1], first
        self._pulls: list[tuple[End, float]] = []
        self._thread = threading.Thread(target=self._run)
        self._is_over = False

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._is_over = True
        self._thread.join()
        for end in self.ends:
            end.port.close()

    def pull(self, which: int, seconds: float) -> None:
        """Pull the adapter of an end out for a while; returns when it is back."""
        done_s = time.monotonic() + seconds
        self._pulls.append((self.ends[which], done_s))
        while self._pulls:
            time.sleep(0.01)

    def _run(self) -> None:
        while not self._is_over:
            busy = any(end.is_busy for end in self.ends)
            files = [each for end in self.ends for each in end.port.filenos()]
            select.select(files, [], [], 0.0005 if busy else 0.05)
            now_s = time.monotonic()
            for end, back_s in self._pulls:
                if now_s < back_s:
                    end.port.close()
                else:
                    end.port.open()
            self._pulls = [each for each in self._pulls if now_s < each[1]]
            for end in self.ends:
                end.turn(now_s)
