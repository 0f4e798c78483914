"""A gripper with fingers on links of their own, touch on one port and motors on another, and a sound of its own.

Wire: "touch" is USB, one frame a conversion: A5, 2 fingers x 4 taxels of uint8, sum. "motors" is RS-485 at 115200: the
byte 00..FF is the opening that both fingers go to; it answers with where they are. DTR off and on restarts the touch
board. Frames of "sound" begin with 5A and hold 8 pressures of int16.

Try it: ``tactemu run tests/devices/gripper.py:Gripper``.
"""

import numpy as np

from firmware_protocols import Convert, Device, Restart, Rs485, Sense, Sent, Serial, Stream, grid_layout, points
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import place, stack
from firmware_protocols.motors import Motors
from firmware_protocols.tables import Frame

TOUCH = Frame("""
    touch, left finger first, row by row
    0     A5              start
    1     u1 x taxels     push
    last  sum8            check
""")
SOUND = Frame("""
    sound
    0     5A              start
    1     <i2 x 8         pressure
    last  sum8            check
""")
STROKE = 0.04


class Gripper(Device):
    name, title = "gripper", "Gripper with two ports"
    ports = (Serial(name="touch", baud=115200, usb=True), Rs485(name="motors", baud=115200))
    streams = {"touch": Stream(100, ("force",)), "sound": Stream(50, ("vibration",))}
    evidence, sources = ("assumed",), ("tests",)
    boot_s = 0.1

    def __init__(self):
        pads = [
            place(grid_layout(2, 2, 0.004, name=side, link=side), (x, 0, 0))
            for side, x in (("left", -0.03), ("right", 0.03))
        ]
        self.layout = stack(*pads)
        self.senses = ("force", Sense("vibration", at=points({"chip": (0, 0, 0)}), burst=8))
        self.table = TOUCH.bind(wire_order=self.layout.wire_order)
        self.motors = Motors([255.0, 255.0], low=0, high=255, time_constant_s=0.05)
        self.dtr = False

    def measure(self, reading, t_ns):
        if reading.stream == "touch":
            self.counts = quantize(self.layout.push(reading["force"]), 100.0, 0, 255)
            return {"force": self.counts}
        self.sound = quantize(reading["vibration"], 0.1, -0x8000, 0x7FFF)
        return {"vibration": self.sound}

    def stream(self, t_ns, name):
        if name == "touch":
            return [Sent(self.table.pack(push=self.counts), port="touch")]
        return [Sent(SOUND.pack(pressure=self.sound[0]), port="touch")]

    def boot(self, t_ns):
        return [Sent(b"ready\n", port="touch")]

    def lines(self, dtr, rts, t_ns, port):
        rises = port == "touch" and dtr and not self.dtr
        self.dtr = dtr
        return [Restart()] if rises and t_ns > 1_000_000_000 else ()

    def receive(self, data, t_ns, port):
        if port == "touch":
            self.counters["asked"] += 1
            return [Convert("touch", delay_ns=3_000_000)]
        self.motors.go(float(data[-1]), t_ns)
        return [bytes(np.rint(self.motors.positions(t_ns)).astype(np.uint8))]

    def joints(self, t_ns):
        left, right = self.motors.positions(t_ns) / 255 * STROKE
        return {"left": -float(left), "right": float(right)}
