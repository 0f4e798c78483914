"""``over_polled.py VARIANT PORT``: drivers of weiss_wts, polled by messages with an id, a length and a CRC."""

import struct
import sys
import termios
import time

import serial
from planted_defects import Defect, hand_out, say

GONE = (OSError, termios.error)
"""Exceptions that pyserial raises for a lost port."""


def quiet(line, wait=True):
    """Drop the data that still arrive: they belong to the failed question."""
    while wait and line.read(1):
        line.reset_input_buffer()


def table_of(byte):
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


TABLE = [table_of(byte) for byte in range(256)]


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc


def open_again(port):
    """Return the port once it can be opened again."""
    while True:
        try:
            return serial.Serial(port, 115200, timeout=0.15)
        except serial.SerialException:
            time.sleep(0.02)


class Driver:
    """A driver that asks for frames in a loop."""

    def __init__(self, variant, port):
        self.variant, self.port, self.line = variant, port, serial.Serial(port, 115200, timeout=0.15)
        self.defect = Defect(variant)
        self.old, self.last_ms, self.unplugged = None, -1, 0

    def ask(self):
        """Return the payload of a good answer, or None."""
        variant, line = self.variant, self.line
        if variant not in ("late", "deaf", "noresync"):
            line.reset_input_buffer()
        line.write(bytes.fromhex("aaaaaa200100008f83"))
        asked = time.monotonic()
        if variant == "noresync":
            answer = line.read(6 + 2 + 5 + 168 + 2)
            sound = len(answer) == 183 and answer[:3] == b"\xaa\xaa\xaa"
            return answer[6:-2] if sound and crc16(answer[:-2]) == int.from_bytes(answer[-2:], "little") else None
        head = line.read(6)
        while variant == "deaf" and len(head) < 6:
            head += line.read(6 - len(head))  # it waits for the answer forever
        if len(head) < 6:
            return None
        size = int.from_bytes(head[4:6], "little")
        if head[:3] != b"\xaa\xaa\xaa" or size > 1024:
            return None
        rest = line.read(size + 2)
        payload = rest[:-2]
        sound = len(rest) == size + 2 and crc16(head + payload) == int.from_bytes(rest[-2:], "little")
        if not sound and variant != "nocrc":
            return None
        if variant != "anyreply" and (head[3] != 0x20 or payload[:2] != b"\0\0"):
            return None
        if variant not in ("late", "deaf", "anyreply") and time.monotonic() - asked < 0.0005:
            return None  # no controller answers so soon: this answer was sent before the question
        return payload

    def failed(self):
        """Report that there was no good answer, and drop what still arrives."""
        variant = self.variant
        if variant in ("late", "deaf", "timeout"):
            time.sleep(0.005)
        if variant == "dies":
            raise RuntimeError("no good answer")
        if variant == "timeout" and self.old is not None:
            hand_out(**self.old)
        else:
            say("no good answer")
            quiet(self.line, variant not in ("late", "deaf", "noresync"))

    def read(self):
        """Ask once, and hand out the answer."""
        payload = self.ask()
        if payload is None:
            return self.failed()
        now_ms = int.from_bytes(payload[2:6], "little")
        if self.variant == "wrap" and now_ms < self.last_ms:
            return None  # "an old frame"
        self.last_ms = now_ms
        counts = struct.unpack("<84H", payload[7 : 7 + 168].ljust(168, b"\0"))
        self.old = {"v": self.defect.values(counts)}
        self.defect.hand_out(**self.old)
        time.sleep(0.008)
        return None


def main(variant, port):
    driver = Driver(variant, port)
    while True:
        try:
            driver.read()
        except GONE as error:
            driver.unplugged += 1
            if variant != "second":
                say(f"port lost: {error}")
                sys.exit(1)
            if driver.unplugged == 1:
                say("port lost, opening it again")
                driver.line = open_again(port)
            else:
                sys.exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
