"""The time of a frame between device and port, stage by stage, on one core: `tactemu bench wire`.

Each stage is timed alone on the same frames; a figure is the median of several runs. ``whole`` is all stages together
at full speed on one CPU, with exact pacing on a virtual clock: the processor is measured, not the bus. Real Linux CAN
is measured if the machine has a ``vcan0`` (``scripts/vcan-run -- tactemu bench wire``).
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median

from firmware_protocols import Can, CanFrame, Connector, Serial, WireFrame
from tactemu.base.errors import TransportUnavailable
from tactemu.transports import create
from tactemu.transports.transport import Transport
from tactemu.tune.timing import Report
from tactemu.wire.can_bits import frame_bits
from tactemu.wire.wire import Wire

FRAMES = 2000
"""Number of frames in each timed run."""
BYTES = bytes(range(82))
CAN = tuple(
    CanFrame(arbitration_id=0x100 + k, data=bytes([k, 0x55, 0xAA, 7 * k & 255, 0, 255, 1, k])) for k in range(16)
)


def per_frame_us(run: Callable[[int], None], *, repeats: int = 7) -> float:
    """Return the median time of one of the ``FRAMES`` frames that ``run(FRAMES)`` handles [µs]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter_ns()
        run(FRAMES)
        times.append((time.perf_counter_ns() - start) / FRAMES / 1e3)
    return median(times)


def count_bits(n: int) -> None:
    """Compute the exact length of ``n`` CAN frames."""
    for k in range(n):
        frame_bits(CAN[k % 16])


def through_wire(wire: Wire, frames: tuple[WireFrame, ...], read: Callable[[], object]) -> Callable[[int], None]:
    """Return a callable that sends ``n`` frames through a wire: queued, paced on a virtual clock, written and read."""
    now = [0]

    def run(n: int) -> None:
        for _ in range(0, n, len(frames)):
            wire.send(frames, now[0])
            wire.flush(now[0])
            while (due := wire.next_due_ns()) is not None:
                now[0] = max(due, now[0])
                wire.flush(now[0])
            wire.receive(now[0])
            read()

    return run


@contextmanager
def opened(address: str, connector: Connector, **options) -> Iterator[Wire]:
    """Yield a wire on an open port that has a reader."""
    transport = create(address)
    wire = Wire(transport, connector, **options)
    wire.open()
    wire.receive(0)
    try:
        yield wire
    finally:
        wire.close()


@contextmanager
def _pty_reader(transport: Transport) -> Iterator[Callable[[], object]]:
    """Open the pty as a driver does, and yield a callable that drains it."""
    reader = os.open(transport.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    transport.poll()

    def drain() -> None:
        try:
            while os.read(reader, 65_536):
                pass
        except BlockingIOError:
            pass

    try:
        yield drain
    finally:
        os.close(reader)


def run(report: Report, *, repeats: int = 7) -> dict[str, float]:
    """Measure every stage, report one line per figure, and return the figures by name."""
    figures: dict[str, float] = {}

    def note(name: str, figure: float, unit: str, about: str) -> None:
        figures[name] = figure
        report(f"{name:34} {figure:10,.1f} {unit:9} {about}")

    with _one_core():
        note("can bits", per_frame_us(count_bits, repeats=repeats), "µs/frame", "exact length of a CAN frame")
        _wires(note, repeats)
        _ports(note, repeats)
    return figures


def _wires(note: Callable[..., None], repeats: int) -> None:
    cases: dict[str, tuple[Connector, tuple[WireFrame, ...], tuple[str, ...]]] = {
        "wire serial": (Serial(baud=115_200), (BYTES,), ()),
        "wire can": (Can(), CAN, ()),
        "wire can, a fault that never hits": (Can(), CAN, ("drop 0%",)),
        "wire can, flip 50%": (Can(), CAN, ("flip 50%",)),
    }
    for name, (connector, frames, faults) in cases.items():
        with opened("memory:", connector, faults=faults) as wire:
            transport = wire.transport
            cost = per_frame_us(through_wire(wire, frames, transport.driver.read), repeats=repeats)  # type: ignore[attr-defined]
            note(name, cost, "µs/frame", "queue, arbitrate, pace, log, hand to the port")


def _ports(note: Callable[..., None], repeats: int) -> None:
    with opened("pty:", Serial(baud=115_200, usb=True)) as wire, _pty_reader(wire.transport) as drain:

        def write_pty(n: int) -> None:
            for _ in range(n):
                wire.transport.write(BYTES)
                drain()

        note("pty write and read", per_frame_us(write_pty, repeats=repeats), "µs/frame", "82 bytes")
        total_us = per_frame_us(through_wire(wire, (BYTES,), drain), repeats=repeats)
        note("whole serial on a pty", 1e6 / total_us, "frames/s", "one core, its reader included")
    for name, address in (("udp multicast", "can:udp_multicast:239.74.163.77"), ("vcan", "can:socketcan:vcan0")):
        try:
            _bus(note, name, address, repeats)
        except TransportUnavailable:
            pass  # this machine has no such bus


def _bus(note: Callable[..., None], name: str, address: str, repeats: int) -> None:
    with opened(address, Can()) as wire:

        def write_can(n: int) -> None:
            for k in range(n):
                wire.transport.write(CAN[k % 16])

        note(f"{name} write", per_frame_us(write_can, repeats=repeats), "µs/frame", "8 bytes")
        wire.transport.poll()
        total_us = per_frame_us(through_wire(wire, CAN, lambda: None), repeats=repeats)
        note(f"whole can on {name}", 1e6 / total_us, "frames/s", "one core; a full 1 Mbit/s bus carries 8 700")


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep this process on one CPU, as an emulator would share a small machine with its driver."""
    if threading.active_count() > 1 or not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
