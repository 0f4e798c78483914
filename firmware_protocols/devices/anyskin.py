r"""AnySkin: five magnetometers under a magnetised skin, on USB. ReSkin (and eFlesh, WowSkin) speak the same stream.

Wire: USB-CDC, opened at 115200 8N1, nothing depends on the speed. Device to host only: there is no command.
One frame per firmware loop, N = 5 chips, 16 N + 2 = 82 bytes, float32 little-endian:

    offset   bytes  field
    16 k     4      temperature of chip k [deg C]
    16 k+4   12     Bx, By, Bz of chip k [uT], in the chip's own axes
    16 N     2      0D 0A; no start byte, no checksum

Chips in wire order: centre, left, right, up, down. Chip axes are turned in the plane by -90, -90, 180, 90, 0 degrees
as the vendor's viewer draws them (screen y points down, so drawn right-handed axes have z into the skin).

Evidence: firmware (arduino/5X_binary_burst_stream.ino: ``sizeof(data)`` per chip, then println) and both published
drivers, which decode it. ADC: MLX90393 at gain 7, resolution 0: 0.150 uT (x, y) and 0.242 uT (z) per count, int16;
temperature 25 + (raw - 46244) / 45.2 deg C, uint16.

A driver takes a frame only when *more* than 82 bytes wait, so a frame is seen when the next one has begun. It has no
time-out: on a silent port it waits for ever.

Try it: ``tactemu run anyskin``, then ``AnySkinBase(num_mags=5, port=..., burst_mode=True).get_sample()``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Column, Counts, Device, Layout, Option, Outs, Patch, Reading, Serial
from firmware_protocols.adc import quantize
from firmware_protocols.device import Axis, Quantity
from firmware_protocols.magnetic import LinearMagnet

PITCH = 0.007
PLACES = ((0, 0), (-1, 0), (1, 0), (0, 1), (0, -1))
DRAWN_TURNS_DEG = (-90, -90, 180, 90, 0)

AXES: tuple[Axis, ...] = ("x", "y", "z")
FIELD_LSB_UT = np.array([0.150, 0.150, 0.242])
TEMPERATURE_ZERO, TEMPERATURE_PER_DEG = 46244, 45.2

CHIP_UT_PER_T = np.array([1e6, -1e6, -1e6])
"""From a taxel's frame to the chip's, which is turned by half about x."""

GAIN_UT_PER_N = (60.0, -60.0, -90.0)
"""From a taxel's frame (z out of the skin) to the chip's (z into it)."""

REST_FIELD_UT = (
    (-38.0, 21.0, 412.0),
    (55.0, -12.0, 371.0),
    (-19.0, -47.0, 398.0),
    (8.0, 33.0, 445.0),
    (-61.0, 5.0, 356.0),
)
"""Field of the unloaded skin at each chip: of the size that a magnetised skin 2 mm away makes."""


class AnySkin(Device):
    """Five 3-axis magnetometers that stream 82-byte frames unasked."""

    name = "anyskin"
    title = "AnySkin, 5 magnetometers (ReSkin: same stream)"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=True),)
    senses = ("force", "temperature")
    columns = (
        Column(name="T", unit="degC", counts_per_unit=1.0, low=-998.1, high=451.8, rest=25.0),
        *(
            Column(name=f"B{axis}", axis=axis, unit="uT", counts_per_unit=1.0, low=-0x8000 * lsb, high=0x7FFF * lsb)
            for axis, lsb in zip(AXES, FIELD_LSB_UT)
        ),
    )
    evidence = ("firmware", "driver")
    sources = (
        "raunaqbhirangi/anyskin@cb13b5b arduino/5X_binary_burst_stream.ino",
        "raunaqbhirangi/anyskin@cb13b5b anyskin/sensor.py l.51-126; visualizations/anyskin_viz.py l.38-47",
        "reskin_sensor@b82de2a reskin_sensor/sensor.py",
        "tesshellebrekers/arduino-MLX90393@5505644 MLX90393.cpp convertRaw",
        "Melexis MLX90393 data sheet (sensitivity, temperature)",
    )
    judge = "anyskin 1.0.0, reskin-sensor 2.0.2"
    assumed = (
        "pitch of the chips 7 mm (the sources have pixels only)",
        "chip z into the skin, so that axes are right-handed as the viewer draws them; gain 7, "
        "resolution 0 (boards on a LEAP hand: `step_scale=2`, sissihrx/anyskin-leaphand@89bbd0fd)",
        "60 uT/N in the plane, 90 uT/N along the normal: a push raises Bz; field at rest",
        "100 Hz (the firmware runs as fast as its loop)",
    )

    def __init__(
        self,
        *,
        gains: Annotated[
            tuple[float, float, float],
            Option("of the force along x, y and z of a chip, z out of the skin", unit="uT/N"),
        ] = GAIN_UT_PER_N,
        sees: Annotated[
            Literal["force", "field"],
            Option("force through `gains`, or the field that a transducer of the scene makes"),
        ] = "force",
        step_scale: Annotated[
            Literal[1, 2, 4, 8, 16], Option("gain and resolution registers: steps of 0.150/0.242 uT ... 2.4/3.872 uT")
        ] = 1,
    ):
        self.sees: Quantity = sees
        self.senses = (self.sees, "temperature")
        self.step = FIELD_LSB_UT * step_scale
        if step_scale > 1:
            self.columns = (self.columns[0], *(
                replace(column, low=-0x8000 * step, high=0x7FFF * step)
                for column, step in zip(self.columns[1:], self.step.tolist())
            ))  # fmt: skip
        turns = -np.radians(DRAWN_TURNS_DEG)
        self.layout = Layout(
            positions=PITCH * np.array([(x, y, 0.0) for x, y in PLACES]),
            normals=np.array([0.0, 0.0, 1.0]),
            x_axes=np.stack([np.cos(turns), np.sin(turns), np.zeros(5)], axis=-1),
            patches=(Patch(name="skin", start=0, rows=0, cols=5, pitch=PITCH),),
        )
        self.magnet = LinearMagnet(gain=gains, offset=np.array(REST_FIELD_UT))

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Temperature [deg C] and field [uT] as the driver decodes them, float32 ``(5, 4)``: T, Bx, By, Bz."""
        field = self.field(reading)
        raw_t = quantize(reading["temperature"] - 25.0, TEMPERATURE_PER_DEG, 0, 0xFFFF, rest=TEMPERATURE_ZERO)
        values = np.empty((5, 4), np.float32)
        values[:, 0] = 25.0 + (raw_t - TEMPERATURE_ZERO) / TEMPERATURE_PER_DEG
        values[:, 1:] = quantize(field / self.step, 1.0, -0x8000, 0x7FFF) * self.step
        self.counts = values
        return values

    def field(self, reading: Reading) -> np.ndarray:
        """Field at each chip in its own axes [uT]; z of a chip is into the skin."""
        if self.sees == "force":
            return self.magnet(self.layout.to_taxel_frame(reading["force"]))
        return self.layout.to_taxel_frame(reading["field"]) * CHIP_UT_PER_T

    def stream(self, t_ns: int, name: str) -> Outs:
        """One 82-byte frame."""
        return [self.layout.on_wire(self.counts).astype("<f4").tobytes() + b"\r\n"]
