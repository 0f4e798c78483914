r"""eFlesh, the board with a binary stream: five MLX90393 on SPI below a printed magnetic skin, an ESP32.

Wire: 921600 8N1 through a CP2102 bridge (10C4:EA60). Device to host only: there is no command. One ``FRAME`` per
measurement, 184.6 a second. Opening the port restarts the board through DTR: it sends garbage for seconds, and hosts
wait 2.5 s.

Sensors in wire order: 1 lower right, 2 lower left, 3 upper right, 4 upper left, 5 centre. The magnet over sensor 4 is
built in upside down: its Bz is negative. Steps are 1.2 uT (x, y) and 1.9 uT (z), full scale 39.4 and 63.4 mT
(RES_19). With RES_16 steps and full scale are an eighth, and larger values wrap: a press jumps by 15.86 mT. A
sensor that does not answer sends 0.0 three times. With an oversampling that takes longer than a period, two frames of
three are all zero.

Other eFlesh boards send the stream of ``anyskin``; this board's other firmware sends text.

Try it: ``tactemu run eflesh_binary``, then ``skin_reader(port, 921600, ...)`` of eflesh_calib/skin_stream.py.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Counts, Device, FieldGains, Frame, Layout, LinearMagnet, Option, Patch, Quantity, Reading, Restart, Rollover,
    Sees, Serial, Transmissions, fact_table, xyz,
)  # fmt: skip

FRAME = Frame("""
    frame
    0     AA 55              start
    2     u1                 sequence
    3     <f4 x taxels x 3   field      Bx, By, Bz [uT]
    last  xor8 from 2        check
""")
SOURCE = "Jnkdog-debug/eflesh-touch@8bbca5c"
CHIP_PLACES_IN_PITCHES = ((1, -1), (-1, -1), (1, 1), (-1, 1), (0, 0))
PITCH_M = 0.007
REST_UT = (7800.0, 6200.0, 6000.0, -3700.0, 4400.0)
"""Bz of the untouched skin at each chip."""
STEP_UT = np.array([0.150, 0.150, 0.242])
"""The steps of x, y and z with RES_16; RES_19 drops three bits."""


class EfleshBinary(Device):
    """Five three-axis magnetometers that share one frame."""

    name = "eflesh_binary"
    kind = "fingertip"
    title = "eFlesh, 5 magnetometers, binary stream"
    ports = (Serial(baud=921_600, usb=USB(0x10C4, 0xEA60, node="ttyUSB")),)
    rate_hz = 184.6
    boot_s = 2.0
    rollovers = (Rollover(name="sequence", bits=8, state="sequence"),)
    evidence = ("firmware", "driver")
    sources = (
        f"{SOURCE} the .ino; docs/2026-08-20-hardware-layout.md",
        f"{SOURCE} eflesh_calib/eflesh_calib/skin_stream.py; eflesh-upper/logger.py",
    )
    judge = SOURCE
    facts = fact_table(f"""
        stated identity: a CP2102, 10C4:EA60; /dev/ttyUSB0 @ {SOURCE} eflash_binary.ino l.9-10; logger.py l.19
        stated touch: the places, the polarity, and Bz at rest of each chip @ {SOURCE}
            docs/2026-08-20-hardware-layout.md
        stated touch: the steps and full scales of RES_16 and RES_19; a value beyond the range of RES_16 wraps @
            {SOURCE} the .ino l.81-88
        stated touch: a chip that does not answer reads 0.0 on all three axes @ {SOURCE} the .ino l.118-122
        stated timing: 184.6 frames a second; after DTR is set the board sends garbage, so wait 2.5 s @ {SOURCE}
            docs/2026-08-20-hardware-layout.md
        stated timing: an oversampling that is too slow makes two of three frames invalid @ {SOURCE} the .ino l.20-24,
            90-92
        assumed touch: the chips form a square of 14 mm; axes are those of the link; Bx and By are 0 at rest @ {SOURCE}
            docs/, README, live_probe.py
        assumed touch: 500 uT/N in the plane and 1000 uT/N along the normal; a push raises the field @ {SOURCE} docs/,
            README
        assumed timing: the board is silent for 2 s after power-up, and after each change of the modem lines that leaves
            DTR set @ {SOURCE} docs/, .ino
        assumed timing: with `zero_frames` every third conversion is complete, beginning with the first @ {SOURCE} the
            .ino
    """)

    def __init__(
        self,
        *,
        resolution: Annotated[Literal[16, 19], Option("RES of the chips; with 16 a press wraps around")] = 19,
        missing: Annotated[tuple[int, ...], Option("sensors that do not answer", low=1, high=5)] = (),
        zero_frames: Annotated[bool, Option("the oversampling is too slow: two frames of three are zero")] = False,
        gains: FieldGains = (500.0, 500.0, -1000.0),
        sees: Sees = "force",
    ):
        self.sees: Quantity = sees
        self.senses = (self.sees,)
        self.layout = Layout(
            positions=PITCH_M * np.array([(x, y, 0.0) for x, y in CHIP_PLACES_IN_PITCHES]),
            normals=np.array([0.0, 0.0, 1.0]),
            patches=(Patch(name="skin", start=0, rows=0, cols=5, pitch=PITCH_M),),
        )
        self.step, self.wraps = STEP_UT * 2.0 ** (resolution - 16), resolution == 16
        self.columns = xyz("Bx By Bz", unit="uT", counts_per_unit=1.0, low=-0x8000 * self.step, high=0x7FFF * self.step)
        rest = np.array([(0.0, 0.0, z) for z in REST_UT])
        self.magnet = LinearMagnet(gain=np.sign(rest[:, 2:]) * gains, offset=rest)
        self.answering = ~np.isin(np.arange(1, 6), missing)[:, None]
        self.zero_frames, self.conversions = zero_frames, 0
        self.frame, self.sequence = FRAME.bind(wire_order=self.layout.wire_order), 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the field [uT] as it is sent, float32 ``(5, 3)``: Bx, By, Bz."""
        local = self.layout.to_taxel_frame(reading[self.sees])
        raw = np.rint((self.magnet(local) if self.sees == "force" else 1e6 * local) / self.step)
        raw = (raw + 0x8000) % 0x10000 - 0x8000 if self.wraps else np.clip(raw, -0x8000, 0x7FFF)
        ready = self.answering & (not self.zero_frames or self.conversions % 3 == 0)
        self.conversions += 1
        self.counts = np.where(ready, raw.astype(int) * self.step, 0.0).astype(np.float32)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame."""
        frame = self.frame.pack(sequence=self.sequence, field=self.counts)
        self.sequence = self.sequence + 1 & 0xFF
        return [frame]

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Restart the board when DTR of an opened port is set."""
        return [Restart()] if dtr else ()
