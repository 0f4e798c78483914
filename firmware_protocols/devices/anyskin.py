r"""AnySkin: five magnetometers under a magnetised skin, on USB. ReSkin (and eFlesh, WowSkin) send the same stream.

Wire: USB-CDC, opened at 115200 8N1; the speed has no effect. Device to host only: there is no command.
One frame per firmware loop, N = 5 chips, 16 N + 2 = 82 bytes, float32 little-endian:

    offset   bytes  field
    16 k     4      temperature of chip k [deg C]
    16 k+4   12     Bx, By, Bz of chip k [uT], in the chip's own axes
    16 N     2      0D 0A; no start byte, no checksum

Chips in wire order: centre, left, right, up, down. Chip axes are turned in the plane by -90, -90, 180, 90, 0 degrees
as the vendor's viewer draws them (screen y points down, so drawn right-handed axes have z into the skin).

Evidence: firmware (arduino/5X_binary_burst_stream.ino: ``sizeof(data)`` per chip, then println) and both published
drivers, which decode it. ADC: MLX90393, int16, steps as measured on boards of a LEAP hand: 0.300 uT (x, y) and 0.484 uT
(z). The library at 5505644 sets gain 6, resolution 0, steps of 0.200 and 0.323 uT (``step_scale=1.3333``); a driver
cannot tell which one a board was flashed with. Temperature 25 + (raw - 46244) / 45.2 deg C, uint16.

A driver takes a frame only when *more* than 82 bytes wait, so it reads a frame when the next one has begun. It has no
time-out: on a silent port it blocks.

Try it: ``tactemu run anyskin``, then ``AnySkinBase(num_mags=5, port=..., burst_mode=True).get_sample()``.
"""

from typing import Annotated

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, Device, FieldGains, Layout, LinearMagnet, Option, Patch, Quantity, Reading, Sees, Serial,
    Transmissions, fact_table, quantize, xyz,
)  # fmt: skip

ANYSKIN = "raunaqbhirangi/anyskin@cb13b5b"
LIBRARY = "tesshellebrekers/arduino-MLX90393@5505644 MLX90393.cpp"
BOARDS = "adafruit/ArduinoCore-samd@04849ba"
PITCH_M = 0.007
CHIP_PLACES_IN_PITCHES = ((0, 0), (-1, 0), (1, 0), (0, 1), (0, -1))
DRAWN_TURNS_DEG = (-90, -90, 180, 90, 0)

FIELD_LSB_UT = np.array([0.150, 0.150, 0.242])
TEMPERATURE_COUNTS_AT_25_DEG = 46244
TEMPERATURE_COUNTS_PER_DEG = 45.2

CHIP_UT_PER_TAXEL_T = np.array([1e6, -1e6, -1e6])
"""Factors from a taxel's frame [T] to the chip's [uT], which is rotated by 180 degrees about x."""

GAIN_UT_PER_N = (60.0, -60.0, -90.0)
"""Factors from a force in a taxel's frame (z out of the skin) to a field in the chip's frame (z into it)."""

REST_FIELD_UT = (
    (-38.0, 21.0, 412.0),
    (55.0, -12.0, 371.0),
    (-19.0, -47.0, 398.0),
    (8.0, 33.0, 445.0),
    (-61.0, 5.0, 356.0),
)
"""The field of the unloaded skin at each chip, as large as that of a magnetised skin 2 mm away."""


class AnySkin(Device):
    """Five 3-axis magnetometers that stream 82-byte frames unasked."""

    name = "anyskin"
    title = "AnySkin, 5 magnetometers (ReSkin: same stream)"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=USB(0x239A, 0x80CB, "Adafruit", "QT Py M0")),)
    senses = ("force", "temperature")
    evidence = ("firmware", "driver")
    sources = (
        f"{ANYSKIN} arduino/5X_binary_burst_stream.ino",
        f"{ANYSKIN} anyskin/sensor.py l.51-126; visualizations/anyskin_viz.py l.38-47",
        "reskin_sensor@b82de2a reskin_sensor/sensor.py",
        f"{LIBRARY} begin, convertRaw",
        "Melexis MLX90393 data sheet (sensitivity, temperature)",
    )
    judge = "anyskin 1.0.0, reskin-sensor 2.0.2"
    facts = fact_table(f"""
        stated identity: an Adafruit QT Py M0, 239A:80CB; /dev/ttyACM0 @ {ANYSKIN} README; {BOARDS} boards.txt
        stated touch: the order of the chips, the rotations of their axes, and their places @ {ANYSKIN} anyskin_viz.py
            l.38-47
        stated touch: temperature 25 + (raw - 46244) / 45.2; gain 6, resolution 0 @ {LIBRARY} l.46-65, 412
        measured touch: values come in steps of 0.300 and 0.484 uT @ sissihrx/anyskin-leaphand@89bbd0fd (five
            recordings)
        stated configuration: the board streams as soon as the port is open @ {ANYSKIN} 5X_binary_burst_stream.ino
            l.27-30
        assumed touch: the chips are 7 mm apart (the source has only pixels); a chip's z axis points into the skin @
            {ANYSKIN} README, anyskin_viz.py
        assumed touch: 60 uT/N in the plane and 90 uT/N along the normal; a push raises Bz; the field at rest @
            {ANYSKIN} whole
        assumed touch: the gain and resolution that AnySkin's own boards are flashed with @ {ANYSKIN} (its submodule
            db58ef7)
        assumed timing: 100 Hz (the firmware runs as fast as its loop) @ {ANYSKIN} .ino, README; {LIBRARY}
    """)

    def __init__(
        self,
        *,
        gains: FieldGains = GAIN_UT_PER_N,
        sees: Sees = "force",
        step_scale: Annotated[
            float,
            Option("gain and resolution registers: steps over 0.150/0.242 uT (4/3, 2, 4, 16 ...)", low=1.0, high=40.0),
        ] = 2.0,
    ):
        self.sees: Quantity = sees
        self.senses = (self.sees, "temperature")
        self.step = FIELD_LSB_UT * step_scale
        self.columns = (
            Column(name="T", unit="degC", counts_per_unit=1.0, low=-998.1, high=451.8, rest=25.0),
            *xyz("Bx By Bz", unit="uT", counts_per_unit=1.0, low=-0x8000 * self.step, high=0x7FFF * self.step),
        )
        turns = -np.radians(DRAWN_TURNS_DEG)
        self.layout = Layout(
            positions=PITCH_M * np.array([(x, y, 0.0) for x, y in CHIP_PLACES_IN_PITCHES]),
            normals=np.array([0.0, 0.0, 1.0]),
            x_axes=np.stack([np.cos(turns), np.sin(turns), np.zeros(5)], axis=-1),
            patches=(Patch(name="skin", start=0, rows=0, cols=5, pitch=PITCH_M),),
        )
        self.magnet = LinearMagnet(gain=gains, offset=np.array(REST_FIELD_UT))

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return temperature [deg C] and field [uT] as the driver decodes them, float32 ``(5, 4)``: T, Bx, By, Bz."""
        field = self.field(reading)
        raw_t = quantize(
            reading["temperature"] - 25.0, TEMPERATURE_COUNTS_PER_DEG, 0, 0xFFFF, rest=TEMPERATURE_COUNTS_AT_25_DEG
        )
        values = np.empty((5, 4), np.float32)
        values[:, 0] = 25.0 + (raw_t - TEMPERATURE_COUNTS_AT_25_DEG) / TEMPERATURE_COUNTS_PER_DEG
        values[:, 1:] = quantize(field / self.step, 1.0, -0x8000, 0x7FFF) * self.step
        self.counts = values
        return values

    def field(self, reading: Reading) -> np.ndarray:
        """Return the field at each chip in its own axes [uT]; z of a chip points into the skin."""
        if self.sees == "force":
            return self.magnet(self.layout.to_taxel_frame(reading["force"]))
        return self.layout.to_taxel_frame(reading["field"]) * CHIP_UT_PER_TAXEL_T

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one 82-byte frame."""
        return [self.layout.on_wire(self.counts).astype("<f4").tobytes() + b"\r\n"]
