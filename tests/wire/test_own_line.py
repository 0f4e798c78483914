"""A kind of line that a device's own file defines: ports, time, faults and messages follow from its two classes."""

import pytest

import firmware_protocols as fp
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError
from tactemu.emulator.assembly import AssemblyOptions, assemble
from tactemu.scene.file import load
from tactemu.wire.faults import possible_faults
from tactemu.wire.line import LINE_MODELS
from tactemu.wire.line_models import kinds_with, line_model_for, network_schemes

FILE = '''
"""A pad on a line that only it has."""
import dataclasses
from typing import Annotated
from firmware_protocols import Column, Connector, Counts, Device, Option, Reading, points, quantize
from tactemu.wire.line_models import LineModel

@dataclasses.dataclass(frozen=True, kw_only=True)
class Lamp(Connector):
    """A lamp that blinks bytes."""
    is_framed = True
    blinks_hz: int = 800

class LampLine(LineModel, connector=Lamp):
    """A line of light: eight blinks a byte."""
    kind = "lamp"
    schemes = ("udp", "memory")
    faults = ("garbage",)
    is_network = True

    def duration_ns(self, frame):
        return round(len(frame) * 8e9 / self.connector.blinks_hz) if self.pacing else 0

    def describe(self):
        return f"lamp {self.connector.blinks_hz} Hz"

class Pad(Device):
    """A pad."""
    name, title, kind = "lamp_pad", "Pad with a lamp", "fingertip"
    ports = (Lamp(),)
    senses, rate_hz = ("force",), 10.0
    columns = (Column(name="push", low=0, high=255, push=1),)
    evidence, sources, judge = ("assumed",), ("no sensor",), "none"

    def __init__(self):
        self.layout = points({"pad": (0.0, 0.0, 0.0)}, pitch=0.01)

    def measure(self, reading, t_ns):
        return quantize(self.layout.push(reading["force"]), 10.0, 0, 255)

    def stream(self, t_ns, stream):
        return [bytes([0x5A, 0])]
'''


@pytest.fixture
def target(tmp_path):
    (tmp_path / "lamp.py").write_text(FILE)
    yield f"{tmp_path / 'lamp.py'}:Pad"
    for connector in [each for each in LINE_MODELS if each.__name__ == "Lamp"]:
        del LINE_MODELS[connector]


def test_a_line_of_the_devices_own_file(target):
    line = line_model_for(fp.create(target).ports[0])
    assert line.describe() == "lamp 800 Hz" and line.usual_port("pad").startswith("udp:")
    assert "lamp" in kinds_with("garbage") and "split" not in possible_faults(line) and "udp" in network_schemes()
    emulator = assemble(load(target), AssemblyOptions(port="memory:"), clock=VirtualClock()).emulator
    wire = emulator.wires[0]
    wire.add_fault("garbage hex=ff")
    with emulator:
        emulator.run(1.0)
    sent = b"".join(wire.transport.driver.read())
    assert sent.startswith(b"\xff\x5a\0\xff\x5a\0") and wire.counters["garbage"] >= 9
    with pytest.raises(SceneError, match="a lamp wire cannot have it"):
        wire.add_fault("split")
