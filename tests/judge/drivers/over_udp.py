"""``over_udp.py VARIANT PORT [asked]``: drivers of ati_net_ft, which streams records or sends each on request."""

import contextlib
import select
import socket
import struct
import sys
import time

from planted_defects import Defect, hand_out, say

NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")
START, ONE = bytes.fromhex("1234000200000000"), bytes.fromhex("1234000200000001")
IN_UNITS = ("ten", "thousand", "kilogram", "percent", "units")
SIZE = 36


class Driver:
    """A driver that reads records, and discards those that come twice or late."""

    def __init__(self, variant, port, asked=""):
        host, _, number = port.rpartition("//")[2].rpartition(":")
        self.asks, self.variant = bool(asked), variant
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.connect((host, int(number)))
        self.line.settimeout({"spins": 0.0, "blocks": None}.get(self.variant, 0.3))
        self.defect = Defect(self.variant, bits=32, kept_bits=24, limit=2_000_000, exchange=(3, 4))
        self.last = self.last_sample = self.old = None
        self.outages, self.is_quiet = 0, False
        self.line.send(ONE if self.asks else START)

    def nothing(self):
        """Report that no record comes, and ask again, as the box may have restarted."""
        if self.variant in ("stale", "timeout") and self.old:
            hand_out(**self.old)
        else:
            say("nothing comes")
        self.outages += not self.is_quiet
        self.is_quiet = True
        if self.variant != "deaf" and not (self.variant == "second" and self.outages > 1):
            self.last = self.last_sample = None
            self.line.send(ONE if self.asks else START)

    def is_new(self, number, sample):
        """Return False for a record that came before; several defects are planted here."""
        variant, last = self.variant, self.last
        if variant in ("old", "reordered"):
            return variant == "old" or number != last
        if variant == "samplewrap":
            return self.last_sample is None or sample > self.last_sample
        if self.asks or last is None:
            return True
        if variant == "wrap":
            return number > last
        ahead = (number - last) & 0xFFFFFFFF
        if variant == "dies" and ahead != 1:
            raise RuntimeError(f"record {number} follows {last}")
        return 0 < ahead < 1 << 31 or (variant == "doubled" and ahead == 0)

    def read(self):
        """Decode one datagram."""
        try:
            record = self.line.recv(2048)
        except BlockingIOError:
            return
        except (TimeoutError, ConnectionError):
            self.nothing()
            return
        if len(record) != SIZE and self.variant not in ("short", "diesshort"):
            say("a record of another size")
        else:
            self.take(record.ljust(SIZE, b"\0")[:SIZE] if self.variant == "short" else record)
        if self.asks:
            time.sleep(0.008)
            self.discard()
            self.line.send(ONE)

    def discard(self):
        """Discard datagrams beside the answer, such as its second copy, before the next question."""
        with contextlib.suppress(ConnectionError):
            while select.select([self.line], [], [], 0)[0]:
                self.line.recv(2048)

    def take(self, record):
        """Hand out a record."""
        self.is_quiet = False
        number, sample, status, *counts = struct.unpack(">3I6i", record)
        if not self.is_new(number, sample):
            say(f"record {number} is old")
            return
        self.last, self.last_sample = number, sample
        values = self.defect.values(counts)
        if self.variant in IN_UNITS:
            values = [self.defect.in_unit(value, 1e6) for value in values]
        self.old = {"n": number, "status": status, **dict(zip(NAMES, values))}
        self.defect.hand_out(**self.old)


if __name__ == "__main__":
    driver = Driver(*sys.argv[1:])
    while True:
        driver.read()
