"""A robot's complete skin on CAN: `python -m benchmarks bus`.

The skin has iCub boards of 7 triangles (70 taxels), 6 on a bus of 1 Mbit/s, at 50 Hz; the buses are those of `tactemu
exec`, so that a kernel without CAN is enough. A reader in a process of its own (:mod:`benchmarks.bus_reader`) reads
every frame with the kernel's timestamp. If allowed, the loop has real-time priority. The lateness of a frame is that
relative to an exact bus that starts at the sample; all boards sample at once here, which is the hardest case.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols import CanFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.base.priority import can_enable_realtime_priority, enable_realtime_priority
from tactemu.exec.environment import exec_environment
from tactemu.session.serving import serve
from tactemu.tune.timing import Report

BOARDS_PER_BUS = 6
TRIANGLES = 7
"""Number of triangles of a board."""
RATE_HZ = 50
MAX_LATE_P99_MS = 5.0
"""Maximum 99th percentile of the frames' lateness."""


def scene(boards: int) -> str:
    """Return the scene file of a robot with so many boards: a bus and a pressing ball for every six."""
    parts = ["[scene]\ndt = 0.02\n"]
    for bus, first in enumerate(range(0, boards, BOARDS_PER_BUS)):
        n = min(BOARDS_PER_BUS, boards - first)
        parts.append(f"""
[[body]]
name = "part {bus}"
shape = "box"
size = [0.4, 0.4, 0.02]
position = [{bus}, 0, 0]
fixed = true

[[body]]
name = "ball {bus}"
shape = "sphere"
radius = 0.03
position = [{bus}, 0, 0.045]
motion = {{ kind = "press", approach = 0.005, depth = 0.003 }}

[[skin]]
name = "bus {bus}"
device = "icub_skin"
device_options = {{ part = "torso", triangles = {n * TRIANGLES}, triangles_per_board = {TRIANGLES} }}
link = "part {bus}"
port = "can:socketcan:can{bus}"
rate_hz = {RATE_HZ}
model = "kinematic_taxel"
options = {{ radius = 0.002, normal_stiffness = 300.0, noise = 0.002 }}
""")
    return "".join(parts)


def robot(boards: int, seconds: float, way: str = "") -> dict[str, Any]:
    """Run a robot, and return the reader's figures, and whether it read what was sent.

    Raises:
        TactemuError: this machine has no CAN.
    """
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
        file = Path(folder) / "robot.toml"
        file.write_text(scene(boards), encoding="utf-8")
        dev = serve(file, keep="1MB")
        with exec_environment(dev, way=way) as env:
            if can_enable_realtime_priority():
                dev.emulator.call(enable_realtime_priority)  # only the loop, not the reader
            sent: dict[str, list[int]] = {}
            told: dict[str, list[int]] = {}
            origin = dev.emulator.clock.origin_ns or 0
            for channel in dev.emulator.channels:
                bus = env.nodes[channel.name]
                sent[bus] = _watched(channel.wire.transport)
                timer = next(iter(channel.timers.values()))
                told[bus] = [len(channel.timers), origin + timer.sampling.start_ns, timer.sampling.period_ns]
            reader = [sys.executable, "-m", "benchmarks.bus_reader", json.dumps(told), str(seconds)]
            begun = time.process_time(), time.monotonic()
            done = env.run(reader, stdout=subprocess.PIPE, text=True, check=True)
            busy = (time.process_time() - begun[0]) / (time.monotonic() - begun[1])
            figures = json.loads(done.stdout)
            statistics = [channel.statistics for channel in dev.emulator.channels]
            network = env.network
    return figures | {
        "boards": boards,
        "taxels": boards * TRIANGLES * 10,
        "buses": len(sent),
        "sent": sum(count for count, _ in sent.values()),
        "every_frame_in_order": {bus: list(each) for bus, each in sent.items()} == figures.pop("read"),
        "emulator_cpu": busy,
        "missed_samples": sum(each.missed for each in statistics),
        "way": network,
    }


def _watched(transport: Any) -> list[int]:
    """Return a list that from now on has the number of frames written to a port, and their CRC."""
    seen, write, write_all = [0, 0], transport.write, transport.write_all

    def count(frames: CanFrames) -> int:
        seen[0] += len(frames)
        seen[1] = zlib.crc32(frames.array.tobytes(), seen[1])
        return len(frames)

    def watched(frame: CanFrame) -> bool:
        data = np.frombuffer(frame.data, np.uint8)[None]
        return write(frame) and bool(count(CanFrames.of([frame.arbitration_id], data)))

    transport.write, transport.write_all = watched, lambda frames: count(frames[: write_all(frames)])
    return seen


def run(report: Report, *, boards: int | None = None, seconds: float = 10.0, way: str = "") -> dict[str, Any]:
    """Measure a robot of so many boards; without a number, larger and larger ones until too many frames are late."""
    if boards is not None:
        figures = robot(boards, seconds, way)
        report(figures["way"])
        _report(figures, report)
        return figures
    found: dict[str, Any] = {"steps": []}
    for count in range(12, 169, 12):
        figures = robot(count, seconds, way)
        found["steps"].append(figures)
        if count == 12:
            report(figures["way"])
        _report(figures, report)
        if figures["late_p99_ms"] > MAX_LATE_P99_MS or not figures["every_frame_in_order"] or figures["missed_samples"]:
            report(f"more than {MAX_LATE_P99_MS:g} ms late, or frames amiss, from {count} boards on")
            break
        found["boards"] = count
    return found


def _report(figures: dict[str, Any], report: Report) -> None:
    report(
        f"{figures['boards']:3} boards, {figures['taxels']} taxels, {figures['buses']} buses at "
        f"{figures['load']:.0%}: {figures['frames_per_s']:.0f} frames/s for {figures['seconds']:.0f} s, late p50 "
        f"{figures['late_p50_ms']:.2f} ms, p99 {figures['late_p99_ms']:.2f} ms, max {figures['late_max_ms']:.1f} ms; "
        f"every frame, in order: {'yes' if figures['every_frame_in_order'] else 'NO'}; missed samples "
        f"{figures['missed_samples']}; CPUs: emulator {figures['emulator_cpu']:.2f}, reader "
        f"{figures['reader_cpu']:.2f}; reader's buffer {figures['receive_buffer']} bytes a bus, overflows "
        f"{figures['overflows']}"
    )
