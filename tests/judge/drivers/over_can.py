"""``over_can.py VARIANT PORT``: drivers of xela_uskin, sixteen frames a scan."""

import struct
import sys

import can
from planted_defects import Defect, hand_out, say

START = can.Message(arbitration_id=0x201, data=[7, 0], is_extended_id=False)
CARELESS = ("mixed", "oldrow")
"""Variants that ignore the begin of a scan."""


class Driver:
    """A driver that collects the frames of a scan."""

    def __init__(self, variant, port):
        interface, _, channel = port.partition(":")
        self.variant, self.bus = variant, can.Bus(interface=interface, channel=channel)
        self.bus.send(START)
        self.defect = Defect(variant, kept_bits=12, limit=26_000)
        self.rows, self.got, self.begun, self.old, self.foreign = {}, 0, 0.0, None, []
        self.outages, self.is_quiet = 0, False

    def nothing(self):
        """Report that no frame comes, and start the board again, as it may have restarted."""
        variant = self.variant
        if variant == "stale" and self.old:
            hand_out(**self.old)
        elif variant not in ("spins", "blocks"):
            say("nothing comes")
        self.outages += not self.is_quiet
        self.is_quiet = True
        if variant != "deaf" and not (variant == "second" and self.outages > 1):
            self.bus.send(START)

    def hears(self, message):
        """Return True for a taxel's frame that can be used."""
        variant, ident = self.variant, message.arbitration_id
        if variant == "dies" and message.is_error_frame:
            raise RuntimeError("an error frame")
        if message.is_error_frame or message.is_extended_id or (ident & 0x7F0 != 0x710 and variant != "foreign"):
            if variant == "leakforeign":
                self.foreign.append(b"x" * 400_000)
            return False
        if len(message.data) != 8 and variant != "short":
            say("a short frame")
            self.rows, self.got = {}, 0
            return False
        return True

    def take(self, message):
        """Put a frame into the scan, and hand out the scan once it is complete."""
        variant, taxel = self.variant, message.arbitration_id & 0x0F
        careful = variant not in CARELESS
        if taxel == 0 and careful:
            if self.rows and len(self.rows) < 16:
                say("a scan is not whole")
            self.rows, self.begun = {}, message.timestamp
        if careful and message.timestamp - self.begun > 0.006:
            return  # rows have no number, but those of the next scan come a period later
        values = struct.unpack(">3H", bytes(message.data).ljust(8, b"\0")[1:7])
        if variant == "bytes" and taxel == 5:
            values = (values[0], (values[1] & 0xFF) << 8 | values[1] >> 8, values[2])
        if careful and variant != "foreign" and self.rows.get(taxel, values) != values:
            say("two of one taxel in a scan")
            self.begun = 0.0  # the frames cannot be told apart: wait for the next scan
        self.rows[taxel] = values
        self.got += 1
        whole = len(self.rows) == 16 and taxel == 15 and self.begun > 0
        if variant == "mixed":
            whole = self.got == 16
        if variant == "oldrow":
            whole = taxel == 15 and len(self.rows) == 16
        if whole:
            self.give()

    def give(self):
        """Hand out a scan: a table of taxels, or one for each axis."""
        variant, defect = self.variant, self.defect
        scan = [value for k in range(16) for value in self.rows.get(k, (0, 0, 0))]
        if variant == "exchanged":
            self.old = {"y": scan[0::3], "x": scan[1::3], "z": scan[2::3]}
        else:
            values = defect.values(scan)
            self.old = {f"t{k}": values[3 * k : 3 * k + 3] for k in range(16)}
        defect.hand_out(**self.old)
        self.got = 0
        if variant != "oldrow":
            self.rows = {}

    def run(self):
        wait = {"spins": 0.0, "blocks": 0.5}.get(self.variant, 0.5)
        while True:
            message = self.bus.recv(wait)
            if message is not None:
                self.is_quiet = False
                if self.hears(message):
                    self.take(message)
            elif self.variant != "spins":
                self.nothing()


if __name__ == "__main__":
    Driver(*sys.argv[1:]).run()
