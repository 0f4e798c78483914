"""Defects that can be planted in any driver, in values that it has received correctly.

The drivers beside this file are scripts, ``over_NAME.py VARIANT PORT ...``. The variant ``clean`` has no defect. Each
driver prints one JSON line per reading on stdout, and error messages on stderr.
"""

import json
import sys
import time
from collections import deque

ROWS_BEHIND = 20
"""Number of readings in the queue of a driver that never catches up."""


def hand_out(**row):
    """Print a reading."""
    print(json.dumps(row), flush=True)


def say(text):
    """Print an error message."""
    print(text, file=sys.stderr, flush=True)


def swapped_bytes(value, bits):
    """Return an integer with its bytes in reverse order."""
    signed = value < 0
    turned = int.from_bytes((value & (1 << bits) - 1).to_bytes(bits // 8, "big"), "little")
    return turned - (1 << bits) if signed and turned >> bits - 1 else turned


class Defect:
    """The defect of a variant, applied to each reading.

    Args:
        variant: name of the defect; the driver itself handles names that are not known here.
        bits: width of a value on the wire.
        kept_bits: width that is left by the variant ``mask``.
        limit: largest magnitude that the variant ``clip`` lets pass.
        exchange: places of two values that the variant ``exchanged`` exchanges.
    """

    def __init__(self, variant, bits=16, kept_bits=11, limit=1600, exchange=(0, 1)):
        self.variant, self.bits, self.kept_bits, self.limit = variant, bits, kept_bits, limit
        self.exchange = exchange
        self.first = self.before = None
        self.queue, self.kept, self.count = deque(), [], 0

    def values(self, counts):
        """Return the numbers that the defective driver decodes from the counts on the wire."""
        counts, variant = list(counts), self.variant
        self.first = self.first or counts
        if variant == "mask":
            return [value & (1 << self.kept_bits) - 1 for value in counts]
        if variant == "clip":
            return [max(-self.limit, min(self.limit, value)) for value in counts]
        if variant == "unsigned":
            return [value & (1 << self.bits) - 1 for value in counts]
        if variant == "magnitude":
            return [abs(value) for value in counts]
        if variant == "missing":
            return counts[:-1]
        if variant == "halfmissing":
            return counts[: len(counts) // 2]
        last = {
            "zero": 0,
            "twice": counts[-2],
            "frozen": self.first[-1],
            "flip": -counts[-1],
            "endian": swapped_bytes(counts[-1], self.bits) if variant == "endian" else 0,
        }
        if variant in last:
            counts[-1] = last[variant]
        if variant == "exchanged":
            one, other = self.exchange
            counts[one], counts[other] = counts[other], counts[one]
        if variant == "leak":
            self.kept.append(b"x" * 100_000)
        return counts

    def in_unit(self, value, per_unit):
        """Return counts in the unit that the device declares, or in a wrong unit by the variant."""
        wrong = {"ten": 10.0, "thousand": 1000.0, "kilogram": 1 / 9.81, "percent": 1.03}
        return round(value / per_unit * wrong.get(self.variant, 1.0), 6)

    def hand_out(self, **row):
        """Print a reading, with the delay, loss or repetition of the variant."""
        self.count += 1
        if self.variant == "hundredth" and self.count % 100 == 0:
            return
        if self.variant == "slow":
            time.sleep(0.02)
        if self.variant == "behind":
            self.queue.append(row)
            if len(self.queue) <= ROWS_BEHIND:
                return
            row = self.queue.popleft()
        if self.variant == "before":
            row, self.before = self.before or row, row
        hand_out(**row)
