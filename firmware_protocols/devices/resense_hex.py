"""Resense (Wittenstein) HEX: force-torque sensors of a fingertip's size, with their electronics on USB.

Wire: a serial port of USB, which the library opens at 2000000 8N1, without effect. Device to host only: one ``SAMPLE``
after another from power-up, without a head, a counter or a sum: a reader that loses a byte reads all that follows at
the wrong places.

Evidence: the maker's library.

Try it: ``tactemu run resense_hex``, then ``HEXSensor(PORT)``, ``connect()``, ``record_sample()``.
"""

from typing import Annotated, Literal

from firmware_protocols import (
    Column, Device, Frame, Option, Sense, Serial, Tool, Transmissions, fact_table, points, wrench,
)  # fmt: skip

SAMPLE = Frame("""
    sample
    0     <f4 x 6    wrench         Fx Fy Fz [N], Tx Ty Tz [Nm]
    24    <f4        temperature    [degC]
""")
RATED = {"HEX12": (90.0, 0.5), "HEX21": (500.0, 5.0)}
"""The largest force [N] and torque [Nm] of a model."""
LIBRARY = "resense-gmbh/Resense.py@72deabe"
ORIGIN = points({"origin": (0.0, 0.0, 0.0)})


class ResenseHex(Device):
    """A sensor that streams."""

    name = "resense_hex"
    title = "Resense HEX force-torque sensor"
    kind = "force-torque sensor"
    ports = (Serial(baud=2_000_000, usb=True),)
    senses = (Sense("wrench", at=ORIGIN), Sense("temperature", at=ORIGIN))
    evidence = ("driver",)
    sources = (f"{LIBRARY} src/resense/sensor.py, importer.py",)
    judge = LIBRARY
    facts = fact_table(f"""
        stated touch: a frame has 28 bytes; the first 24 are six floats of force and torque @ {LIBRARY}
            src/resense/sensor.py:101
        stated touch: units are N and Nm if a switch of the electronics selects them @ {LIBRARY}
            src/resense/sensor.py:83-88
        assumed touch: low byte first; the seventh float is the temperature, as in the maker's recordings
            (importer.py:48); forces act on the tool, which is touched off the axis; z points out; loads reach 90 N and
            0.5 Nm, or 500 N and 5 Nm @ {LIBRARY}, all files
        stated configuration: an electronics box on USB, opened at 2000000 baud @ {LIBRARY} README.md:24, src/resense/
            sensor.py:6
        assumed configuration: the device ignores all bytes that it receives @ {LIBRARY}, all files
        assumed timing: the switches set the sample rate; it is 1000 a second in the example @ {LIBRARY}
            src/example_connect_sensor.py:13
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.01, 0.005, 0.02),
        model: Annotated[Literal["HEX12", "HEX21"], Option("diameter in mm; sets the ranges")] = "HEX21",
        samples_per_s: Annotated[Literal[1000, 500, 100], Option("as the switches are set", unit="Hz")] = 1000,
    ):
        self.layout = points({"tool": tool})
        force, torque = RATED[model]
        most = [force] * 3 + [torque] * 3
        self.columns = (
            *wrench(
                "Fx Fy Fz Tx Ty Tz", per_unit=(1.0, 1.0), is_float=True, low=[-each for each in most], high=most
            ),
            Column(
                name="T", sense="temperature", unit="degC", counts_per_unit=1.0, is_float=True, low=-1e3, high=1e3,
                rest=25.0,
            ),
        )  # fmt: skip
        self.rate_hz = float(samples_per_s)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a sample."""
        return [SAMPLE.pack(wrench=self.counts["wrench"][0], temperature=self.counts["temperature"][0])]
