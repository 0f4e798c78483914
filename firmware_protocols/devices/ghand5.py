"""GLI GHand 5: a hand with three-axis taxels in five fingertips, in Modbus registers.

Wire: USB serial (vendor 3562), Modbus RTU; unit 0x31 is a right hand, 0x32 a left one. What is felt is read with
function 04, a register two bytes, high byte first:

    1000  8 registers    name
    1080  1              bits 8 to 12: thumb .. little finger are valid; low byte: error
    1081  3 a finger     resultant Fx, Fy (signed), Fz, each in the high byte
    1090  57, then 4x47  taxels of the thumb (38), index .. little finger (31 each): bytes Fx, Fy (signed), Fz, row by
                         row; a byte 00 fills up the last register of a finger

All in 0.1 N. The hand also speaks CAN-FD and EtherCAT, and has 13 motors from 1023 on, three registers each; they are
not in this model.

Try it: ``tactemu run ghand5``, then send 31 04 10 80 00 10 F1 1E.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Column, Command, Counts, Device, Option, Outs, Reading, Serial
from firmware_protocols.adc import quantize
from firmware_protocols.device import Axis
from firmware_protocols.layouts import filled, place, stack
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns
from firmware_protocols.registers import RegisterMap, Registers

MAP = RegisterMap("""
    8192  >u2 x 8   name       r
    8448  u1        state      r  = 31   bit k: finger k is valid
    8449  u1        error      r
    8450  u1 x 30   resultant  r         Fx 00 Fy 00 Fz 00 of each finger
    8480  u1 x 490  taxels     r         row by row
""")
"""By byte: two for each register."""
BAUD = 115200
UNITS = {"right": 0x31, "left": 0x32}
TAXELS = {"thumb": 38, "index": 31, "middle": 31, "ring": 31, "little": 31}
PAD = (0.012, 0.018)
BETWEEN_FINGERS = 0.025
COUNTS_PER_NEWTON = 10.0
LOW, HIGH = np.array([-128, -128, 0]), np.array([127, 127, 255])
AXES: tuple[Axis, ...] = ("x", "y", "z")


class GHand5(Device):
    """Five fingertips, asked for by register."""

    name = "ghand5"
    kind = "hand"
    title = "GLI GHand 5, five three-axis fingertips"
    ports = (Serial(baud=BAUD, usb=True),)
    columns = tuple(
        Column(name=f"F{axis}", axis=axis, unit="N", counts_per_unit=COUNTS_PER_NEWTON, low=low, high=high,
               push=1 if axis == "z" else 0)
        for axis, low, high in zip(AXES, LOW.tolist(), HIGH.tolist())
    )  # fmt: skip
    evidence = ("driver",)
    sources = ("gli-sdk/GHand-Python-SDK@3ebbadf (the vendor's own)",)
    judge = "pymodbus 3.11 and modbus_tk 1.1.5, which know no hand; own second reader"
    assumed = (
        "places of the taxels: even rows on a pad of 12 x 18 mm, fingertips 25 mm apart",
        "taxels in 0.1 N as the resultants, which are the sum of what the taxels feel; a push is positive",
        "115200 8N1; functions other than 04 are unknown; registers of no known meaning read 0",
        "100 conversions per second; every finger is valid, no error",
    )

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("which hand; sets the unit")] = "right",
        model: Annotated[str, Option("in register 1000; at most 16 characters of ASCII")] = "GHand5",
    ):
        self.unit = UNITS[side]
        pads = [filled(count, *PAD, name=name, link=name) for name, count in TAXELS.items()]
        self.layout = stack(*(place(pad, (k * BETWEEN_FINGERS, 0.0, 0.0)) for k, pad in enumerate(pads)))
        self.registers = Registers(MAP)
        self.registers["name"] = np.frombuffer(model.encode("ascii")[:16].ljust(16, b"\0"), ">u2")
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(BAUD))

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Fx, Fy, Fz of each taxel [0.1 N], a push positive, shape ``(162, 3)``."""
        forces = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        counts = _counts(forces)
        fingers = [patch.taxels for patch in self.layout.patches]
        sums = _counts(np.array([forces[taxels].sum(axis=0) for taxels in fingers]))
        self.registers["resultant"] = np.stack([sums & 0xFF, 0 * sums], axis=-1).ravel()
        sent = self.layout.on_wire(counts & 0xFF)
        self.registers["taxels"] = np.concatenate([_whole(sent[taxels].ravel()) for taxels in fingers])
        return counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Modbus requests in chunks of any size."""
        return self.rtu.answers(data, t_ns, {self.unit: Banks(inputs=self.registers, functions=(4,))})

    @property
    def commands(self) -> tuple[Command, ...]:
        """What is felt by a right hand."""
        if self.unit != UNITS["right"]:
            return ()
        origin = f"{self.sources[0]}; CRC by a second program"
        return tuple(
            Command(name=name, request=f"31 04 {request}", reply=f"31 04 {reply} ..{{2}}", origin=origin)
            for name, request, reply in (
                ("state and resultants", "10 80 00 10 F1 1E", "20 1F 00 ..{30}"),
                ("taxels of the thumb", "10 90 00 39 31 05", "72 ..{114}"),
                ("taxels of the index finger", "10 C9 00 2F 60 D8", "5E ..{94}"),
                ("taxels of the middle finger", "10 F8 00 2F 31 17", "5E ..{94}"),
                ("taxels of the ring finger", "11 27 00 2F 01 11", "5E ..{94}"),
                ("taxels of the little finger", "11 56 00 2F 51 0A", "5E ..{94}"),
                ("name", "10 00 00 08 F0 FC", "10 ..{16}"),
            )
        )


def _counts(forces: np.ndarray) -> np.ndarray:
    """Of forces [N], shape ``(n, 3)``."""
    return np.clip(quantize(forces, COUNTS_PER_NEWTON, LOW.min(), HIGH.max()), LOW, HIGH)


def _whole(data: np.ndarray) -> np.ndarray:
    """Bytes that fill whole registers."""
    return np.append(data, [0] * (len(data) % 2))
