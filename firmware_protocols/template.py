"""Vendor Model: what it is in one line. (Copy this file, rename the class, and replace every line that says "yours".)

Wire: USB-CDC, opened at 115200 8N1; the speed matters on a true UART only. (Say the direction, who speaks first, and
give the frame table. Whoever reads this docstring should be able to write the driver.)

    offset  bytes  field
    0       1      A5, start
    1       2 n    n taxels, uint16 big-endian, raw counts, row by row
    2n+1    1      checksum: low byte of the sum of all bytes before it

    request  answer
    3F       one frame as above, at once
    others   silence

Evidence: where the table comes from, and what is only assumed. (Captured, vendor document, firmware, driver: best
first. Every source once more in ``sources``; every guess in ``assumed``.)

Try it: ``tactemu run path/to/this_file.py:VendorModel``, then a line that makes the real driver read.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_protocols.device import Command, Device, Outgoing, Reading, SerialWire, grid_layout

START, REQUEST = 0xA5, 0x3F
ROWS, COLUMNS = 4, 4


class VendorModel(Device):
    """A 4 x 4 pad that streams, and answers one request.

    Args:
        counts_per_newton: scale of the converter. (Options are keyword-only and have defaults; a scene file sets them
            in ``device_options``.)
    """

    # The datasheet: `tactemu devices NAME` prints it, and the contract test wants it whole.
    name = "template"  # yours: the name in the registry, lower case with underscores
    title = "Template, a 4x4 pad"
    wires = (SerialWire(baud=115200, usb=True),)  # or CanWire, TcpWire; several if it has several connectors
    senses = "force"  # what the transducers see: force, pressure, depth, displacement or touch
    rate_hz = 100.0
    evidence = ("assumed",)
    sources = ("no sensor: this file shows how one is written",)
    judge = "none"  # the unmodified driver that has read this device
    assumed = ("everything",)
    # scene = a TOML text; without one, a ball presses the middle of each patch of the layout.

    def __init__(self, *, counts_per_newton: float = 1000.0):
        super().__init__()
        self.counts_per_newton = counts_per_newton
        self.layout = grid_layout(ROWS, COLUMNS, pitch=0.004)  # metres, link frame, normals out of the skin
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """All state of the firmware is set here, so that a restart is complete; return the boot banner, if any."""
        self.counts = np.zeros(len(self.layout), np.uint16)
        return ()

    def digitize(self, reading: Reading) -> np.ndarray:
        """The ADC: SI in, counts out, saturated as the converter saturates; taxels in layout order."""
        push = self.layout.push(reading.values)
        return np.clip(np.rint(push * self.counts_per_newton), 0, 0xFFFF).astype(np.uint16)

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """What leaves at every sample, unasked. Each frame is written in one piece."""
        return (self._frame(),)

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Bytes come in chunks of any size. What is no request is counted and answered as the firmware would."""
        requests = data.count(REQUEST)
        self.counters["requests"] += requests
        self.counters["unknown_command"] += len(data) - requests
        return (self._frame(),) * requests

    def _frame(self) -> bytes:
        body = bytes([START]) + self.counts[self.layout.wire_order].astype(">u2").tobytes()
        return body + bytes([sum(body) & 0xFF])

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every documented command: the contract test sends each, damages it, and sends it again."""
        return (Command(name="read", request=bytes([REQUEST]), reply=_is_reading),)


def _is_reading(frames: list) -> bool:
    return [len(frame) for frame in frames] == [2 + 2 * ROWS * COLUMNS]
