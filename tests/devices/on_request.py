"""A pad that converts when it is asked to, and at no other time."""

from firmware_protocols import Column, Command, Convert, Device, Serial, grid_layout
from firmware_protocols.adc import int16, quantize


class OnRequest(Device):
    name, title = "on_request", "Pad that converts on request"
    ports = (Serial(baud=115200),)
    rate_hz = 0.0
    columns = (Column(name="push", unit="N", counts_per_unit=1e4, low=-0x8000, high=0x7FFF, push=1),)
    evidence, sources = ("assumed",), ("tests",)
    commands = tuple(Command(name=f"ask {k}", request="3F") for k in range(20))

    def __init__(self):
        self.layout = grid_layout(2, 2, 0.004)

    def measure(self, reading, t_ns):
        self.counts = quantize(self.layout.push(reading["force"]), 1e4, -0x8000, 0x7FFF)
        return self.counts

    def stream(self, t_ns, name):
        return [int16(self.counts)]

    def receive(self, data, t_ns, port):
        return [Convert(delay_ns=1_700_000)]
