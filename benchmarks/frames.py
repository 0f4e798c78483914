"""The processor time of a sample, and of a frame between device and port: `python -m benchmarks frames`.

* A sample: an AnySkin at 100 Hz with its ten steps of the physics, on a `memory:` port with the virtual clock; without
  imperfections, and with those of a real one. ``scripts/trace`` counts its calls.
* A frame: from :meth:`Wire.send` to the port, one frame after another, with the turns that its line needs; CAN frames
  one by one, many of one sample, and as an array.
* The same to a pseudo terminal that another process reads, with the calls of the system; the processor time of that
  process; and the frames a second that both keep up with on a core each: by the larger of the two times, and as they
  passed, which other programs slow down.

A figure is the least of several runs: other programs make it larger, never smaller.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

from firmware_protocols import Can, CanFrame, Connector, Serial
from firmware_protocols.can_frames import CanFrames
from tactemu.base.clock import VirtualClock
from tactemu.base.kernels import start_warp
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import default_scene
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.pty import PtyTransport
from tactemu.transports.transport import Transport
from tactemu.tune.timing import Report
from tactemu.wire.wire import Wire

FRAMES = 3000
"""Number of frames of a run."""
SECONDS = 4.0
"""Virtual time of a run of samples."""
_FRAME = bytes(range(82))
_DATA = np.arange(14 * 8, dtype=np.uint8).reshape(14, 8)
_CAN = [CanFrame(arbitration_id=0x410, data=row.tobytes()) for row in _DATA]
CASES: dict[str, tuple[Connector, Sequence[bytes] | Sequence[CanFrame]]] = {
    "82 bytes, USB": (Serial(baud=115_200, usb=True), [_FRAME]),
    "82 bytes, 1 Mbit/s": (Serial(baud=1_000_000), [_FRAME]),
    "a CAN frame": (Can(bitrate=1_000_000), _CAN[:1]),
    "14 CAN frames": (Can(bitrate=1_000_000), _CAN),
    "14 CAN frames, an array": (Can(bitrate=1_000_000), CanFrames.of([0x410] * 14, _DATA)),
}
"""The lines, and the frames that a device sends at once."""
_READER = """
import os, sys, time, tty
port, left = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY), int(sys.argv[2])
tty.setraw(port)
print("open", flush=True)
began = time.process_time()
while left > 0: left -= len(os.read(port, 65536))
print(time.process_time() - began)
"""


def frame_us(port: Transport, connector: Connector, frames: Sequence[bytes] | Sequence[CanFrame]) -> float:
    """Return the processor time of a frame on an open port, with that of its line [us]."""
    wire = Wire(port, connector)
    wire.attach("device", connector)
    wire.receive(0)
    t_ns, sent, began_ns = 1_000_000, 0, time.process_time_ns()
    while sent < FRAMES:
        wire.send(frames, t_ns, "device", sample=1)
        written = wire.flush(t_ns)
        while (due_ns := wire.next_due_ns()) is not None:
            t_ns = due_ns
            written += wire.flush(t_ns)
        sent += written
        if not written:  # the reader is slower
            time.sleep(1e-3)
    return (time.process_time_ns() - began_ns) / 1e3 / sent


def pty_figures(repeats: int) -> dict[str, float]:
    """Return the figures of a pseudo terminal with a reader by name; processor times [us] and rates [1/s]."""
    connector, frames = CASES["82 bytes, USB"]
    with PtyTransport() as port:
        total = str(repeats * FRAMES * len(_FRAME))
        command = [sys.executable, "-c", _READER, port.address, total]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as reader:
            assert reader.stdout is not None
            reader.stdout.readline()
            costs_us, took_s = [], []
            for _ in range(repeats):
                began = time.perf_counter()
                costs_us.append(frame_us(port, connector, frames))
                took_s.append(time.perf_counter() - began)
            while reader.poll() is None:  # the end of a frame that the kernel took in part
                port.poll()
                time.sleep(1e-3)
            reader_us = float(reader.stdout.read()) * 1e6 / FRAMES / repeats
    return {
        "82 bytes, a pty": min(costs_us),
        "its reader": reader_us,
        "a second, by these": 1e6 / max(min(costs_us), reader_us),
        "a second, as passed": FRAMES / min(took_s),
    }


def sample_us(repeats: int, *, measured: bool) -> float:
    """Return the processor time of a sample with its steps [us], the least of several runs."""
    times = []
    options = AssemblyOptions(port="memory:", device="cpu", measured=measured)
    with assemble(default_scene("anyskin"), options, clock=VirtualClock()).emulator as emulator:
        port, statistics = emulator.wires[0].transport, emulator.channels[0].statistics
        assert isinstance(port, MemoryTransport)
        for _ in range(repeats):
            port.driver.read()
            before, began_ns = statistics.samples, time.process_time_ns()
            emulator.run(SECONDS)
            times.append((time.process_time_ns() - began_ns) / 1e3 / (statistics.samples - before))
    return min(times)


def run(report: Report, *, repeats: int = 9) -> dict[str, float]:
    """Measure everything, report one line per figure, and return the figures by name [us, 1/s]."""
    start_warp()
    figures = {
        "a sample": sample_us(repeats, measured=False),
        "a sample, measured": sample_us(repeats, measured=True),
    }
    for name, (connector, frames) in CASES.items():
        with MemoryTransport() as port:
            times = []
            for _ in range(repeats):
                times.append(frame_us(port, connector, frames))
                port.driver.read()
            figures[name] = min(times)
    figures |= pty_figures(repeats)
    for name, value in figures.items():
        report(f"{name:24} {value:7.0f}" if "a second" in name else f"{name:24} {value:7.2f} µs")
    return figures
