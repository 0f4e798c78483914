r"""FlexiTac and 3D-ViTac: piezoresistive matrices that an Arduino-class board scans.

Wire: UART at 2 000 000 8N1. Device to host only: there is no command; it streams from power-up.

FlexiTac, 12 x 32 taxels as a rule. One frame per scan:

    offset  bytes        field
    0       2            AA 55
    2       rows x cols  uint8 per taxel, row by row: the 10-bit ADC, shifted right by 2

No length, no checksum, no escape: a driver that first finds AA 55 inside an image that stands still never recovers.
Taxels below AA (a push of less than 1.7 N here) cannot do that. The driver zeroes, with the median of 30 frames.

3D-ViTac, its forerunner, 16 x 16 taxels: a scan is text, 16 lines of 16 decimal numbers of 8 bits, a space behind each,
row by row, each line ended by CR LF, and an empty line after them. A reader takes any line below ten characters for the
end.

Try it: ``tactemu run flexitac``, then ``FlexiTacSensor(port).read()``. The stock viewers want 16 x 32 taxels, as other
boards are flashed: ``tactemu run flexitac rows=16``. The text: ``tactemu run vitac_3d``.
"""

from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, HalfForce, Option, Reading, Serial, Transmissions, fact_table, grid_layout,
)  # fmt: skip

MARKER = b"\xaa\x55"
ADC_MAX = 1023
PITCH_M = 0.002
HARDWARE = "FlexiTac/FlexiTac_Hardware_Repo@9cf98bf"
VITAC = "binghao-huang/3D-ViTac_Tactile_Hardware@e151ea6"


class FlexiTac(Device):
    """A grid of force-sensitive resistors, each read through a voltage divider."""

    name = "flexitac"
    kind = "fingertip"
    ports = (Serial(baud=2_000_000),)
    evidence = ("firmware", "driver")
    sources = (
        "WT-MM/PyFlexiTac firmware/template.ino BAUD_RATE, loop()",
        "flexitac 0.3.1 sensor.py l.16-38, 82-112, 156-196",
        f"{HARDWARE} 32_16_fast.ino (16 x 32)",
    )
    judge = "flexitac 0.3.1, FlexiTac/FlexiTac_Hardware_Repo@9cf98bf"
    facts = fact_table(f"""
        stated identity: the port is a /dev/ttyUSB0 (the firmware runs on an Arduino Nano) @ flexitac 0.3.1 sensor.py;
            flash.py
        stated touch: the upper 8 of 10 bits are sent, row by row @ flexitac 0.3.1 firmware/template.ino; 32_16_fast.ino
            l.59-78
        stated touch: an untouched taxel reads 10 to 40 counts @ flexitac 0.3.1 sensor.py l.68
        assumed touch: the pitch is 2 mm; row 0 is at the largest y, column 0 at the smallest x @ {HARDWARE} whole
        assumed touch: ADC = rest + (1023 - rest) F / (F + 1 N), rest 80 @ flexitac 0.3.1; {HARDWARE}, both whole
        measured timing: a scan every 9.7 ms, plus or minus 1.6 to 1.9 ms @ jsheng45/ViTac-Tactile-Sensing@0889c972
    """)
    shift = 2
    """The number of ADC bits that the firmware drops."""

    def __init__(
        self,
        *,
        rows: Annotated[int, Option("rows, as in the firmware of the board", low=1, high=256)] = 12,
        cols: Annotated[int, Option("columns, as in the firmware of the board", low=1, high=256)] = 32,
        baseline: Annotated[int, Option("10-bit ADC value of an untouched taxel", low=0, high=ADC_MAX - 1)] = 80,
        half_force: HalfForce = 1.0,
    ):
        self.title = f"FlexiTac {rows} x {cols} tactile matrix"
        self.layout = grid_layout(rows, cols, PITCH_M, name="matrix")
        self.baseline, self.half_force = baseline, half_force
        low, high = baseline >> self.shift, ADC_MAX >> self.shift
        self.columns = (Column(name="touch", low=low, high=high, rest=low, push=1),)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return what the driver calls raw: 0..255, shape ``(rows * cols,)``."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        adc = self.baseline + (ADC_MAX - self.baseline) * push / (push + self.half_force)
        self.counts = adc.astype(np.int64) >> self.shift
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame."""
        return [MARKER + self.layout.on_wire(self.counts).astype(np.uint8).tobytes()]


class ViTac3d(FlexiTac):
    """A matrix of 16 x 16 taxels that sends text."""

    name = "vitac_3d"
    evidence = ("firmware", "driver")
    sources = (f"{VITAC} arduino_code/MatrixArray.ino loop()", f"{VITAC} python/multi_thread_contact.py")
    judge = VITAC
    facts = (
        *(fact for fact in FlexiTac.facts if fact.basis == "assumed"),
        *fact_table(f"""
        stated identity: the port is /dev/ttyUSB0 @ {VITAC} python/multi_thread_contact.py l.92
        stated touch: the upper 8 of 10 bits, with a space after each number @ {VITAC} MatrixArray.ino l.83-99
        assumed timing: 100 scans a second, as with FlexiTac @ {VITAC} MatrixArray.ino, readme (as fast as it can)
        """),
    )

    def __init__(
        self,
        *,
        baseline: Annotated[int, Option("10-bit ADC value of an untouched taxel", low=0, high=ADC_MAX - 1)] = 80,
        half_force: HalfForce = 1.0,
    ):
        super().__init__(rows=16, cols=16, baseline=baseline, half_force=half_force)
        self.title = "3D-ViTac 16 x 16 tactile matrix, text"

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one scan, as lines of text."""
        rows = self.layout.on_wire(self.counts).reshape(16, 16).tolist()
        return ["".join("".join(f"{value} " for value in row) + "\r\n" for row in [*rows, []]).encode("ascii")]
