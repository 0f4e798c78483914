"""Kunwei KWR75: a six-axis force-torque sensor that sends kilograms as floats.

Wire: RS-422, 460800 8N1. The host sends a ``REQUEST``; a ``READING`` begins with its command.

    command  answer
    48       a reading each millisecond, until 43
    49       a reading; the first 49 behind power-up starts the converter, and has none
    43       none

Evidence: the vendor's manual, which has a reading as bytes; a driver.

Try it: ``tactemu run kunwei_kwr75``, then send ``48 AA 0D 0A``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Device, Frame, Option, Packets, Request, Sense, Serial, Tool, Transmissions, command, fact_table, points,
    wrench,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     u1          command
    1     AA 0D 0A    fixed
""")
READING = Frame("""
    reading
    0     u1          command
    1     AA          fixed
    2     <f4 x 6     wrench     Fx Fy Fz [kg], Mx My Mz [kg m]
    26    0D 0A       end
""")
GRAVITY = 9.80665
ONCE, STREAM = 0x49, 0x48
RATED = {"A": (50, 50, 2), "B": (200, 200, 8), "C": (350, 500, 12), "D": (500, 700, 18), "E": (30, 30, 1.5),
         "F": (100, 100, 4)}  # fmt: skip
"""The rated Fx and Fy [N], Fz [N], and torques [Nm] of a model."""
OVERLOAD = 3.0
DRIVER = "ian-chuang/kwr75_force_sensor_ros2@a68e4d5"
MANUAL = f"Kunwei, KWR75 Series RS422 User Manual 21.6.75.11.4LA ({DRIVER} KWR75-RS422.pdf)"
BOTH = f"{MANUAL}, whole; {DRIVER} src, include; ian-chuang/KWR75-Force-Sensor-ROS@3ea821e scripts/kwr75_driver.py"


class KunweiKwr75(Device):
    """A sensor between flange and tool, asked or sending by itself."""

    name = "kunwei_kwr75"
    title = "Kunwei KWR75 six-axis force-torque sensor"
    kind = "force-torque sensor"
    ports = (Serial(baud=460800, usb=USB(0x0403, 0x6001, node="ttyUSB")),)
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    rate_hz = 1000.0
    evidence = ("vendor document", "driver")
    sources = (MANUAL, f"{DRIVER} src/hardware_interface.cpp")
    judge = DRIVER
    origin = f"{MANUAL}, 4.4"
    documented_with = None
    facts = fact_table(f"""
        stated touch: six floats, low byte first, in kg and kg m; the rated loads; overload at 300 % @ {MANUAL}, 4.1,
            4.3
        assumed touch: 1 kg is 9.80665 N (drivers use 9.81, or the raw number); forces act on the tool, which is touched
            50 mm above the origin and to the side of it; z points out; values saturate at the overload @ {BOTH}
        stated identity: 0403:6001, an FTDI bridge @ {DRIVER} README.md
        stated configuration: the three commands; the first 49 gets no answer @ {MANUAL}, 4.4
        assumed configuration: command 48 also starts the converter; other commands get no answer @ {BOTH}
        stated timing: 460800 baud; a reading every millisecond @ {MANUAL}, 4.3, 4.4
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.02, 0.01, 0.05),
        model: Annotated[Literal["A", "B", "C", "D", "E", "F"], Option("letter behind KWR75, sets the load")] = "B",
    ):
        self.layout = points({"tool": tool})
        across, along, torque = RATED[model]
        most = OVERLOAD / GRAVITY * np.array([across, across, along, torque, torque, torque])
        self.columns = wrench(
            "Fx Fy Fz Mx My Mz", per_unit=(1 / GRAVITY, 1 / GRAVITY), is_float=True, low=-most, high=most
        )
        self.packets = Packets(REQUEST, by="command", counters=self.counters)
        self.converting = self.streaming = False

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a reading, between 48 and 43."""
        return [self._reading(STREAM)] if self.streaming else ()

    def _reading(self, command: int) -> bytes:
        return READING.pack(command=command, wrench=self.counts[0])

    @command("48 AA 0D 0A")
    def start(self, request: Request) -> None:
        """Start the converter and the readings."""
        self.converting = self.streaming = True

    @command("43 AA 0D 0A")
    def stop(self, request: Request) -> None:
        """Stop the readings."""
        self.streaming = False

    @command("49 AA 0D 0A", "49 AA ..{24} 0D 0A", after=("49 AA 0D 0A",))
    def read(self, request: Request) -> bytes:
        """Return a reading; the first time, start the converter."""
        converting, self.converting = self.converting, True
        return self._reading(ONCE) if converting else b""
