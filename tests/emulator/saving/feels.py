"""A pad that senses whatever quantity it is told to, and says all of it."""

import numpy as np

from firmware_protocols import Device, Serial, grid_layout


class Feels(Device):
    name, title, ports, evidence, sources = "feels", "Pad", (Serial(baud=2_000_000),), ("assumed",), ("tests",)
    rate_hz = 200.0

    def __init__(self, *, quantity: str = "force"):
        self.senses = (quantity,)  # type: ignore[assignment]
        self.layout = grid_layout(8, 8, 0.0025)

    def measure(self, reading, t_ns):
        (sense,) = self.sensed
        self.values = np.asarray(reading[sense.key], np.float32)
        return self.values

    def stream(self, t_ns, name):
        return [self.values.tobytes()]
