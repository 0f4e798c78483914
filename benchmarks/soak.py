"""A long run that finds leaks and lost frames: `python -m benchmarks soak`.

A device streams at 1 kHz through five faults of 1 % each to another process that reads everything. At each interval
memory, file descriptors and lateness are measured. At the end every frame must be accounted for, and the reader must
have received the bytes of the truth log.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import zlib
from typing import Any

import numpy as np

from firmware_protocols import WireFrame
from tactemu.base.clock import RealClock
from tactemu.base.statistics import Lateness
from tactemu.emulator.assembly import assemble
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.truth import Truth
from tactemu.tune.timing import Report

FAULTS = ("drop 1%", "flip 1%", "truncate 1%", "duplicate 1%", "garbage 1%")
KEPT = "1MB"
"""The memory of the truth log: it is full after a second, so that later growth is a leak."""

READER = """
import os, sys, tty, zlib
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
print("ready", flush=True)
size = check = 0
try:
    while data := os.read(port, 65536):
        size, check = size + len(data), zlib.crc32(data, check)
except OSError:
    pass
print(size, check)
"""
"""The program of the reader: it counts all bytes and computes their CRC until the port is gone."""


class Tally(Truth):
    """A truth log that also counts the written bytes and computes their CRC."""

    def __init__(self):
        super().__init__(keep=KEPT)
        self.size = self.check = 0

    def wrote(self, t_ns: int, device: str, frame: WireFrame, sample: int | None = None, late_ns: int = 0) -> None:
        """Log a frame sent to the driver."""
        super().wrote(t_ns, device, frame, sample, late_ns)
        assert isinstance(frame, bytes)
        self.size, self.check = self.size + len(frame), zlib.crc32(frame, self.check)


def run(
    report: Report, *, minutes: float = 30.0, interval_s: float = 60.0, rate_hz: float = 1000.0, seed: int = 0
) -> dict[str, Any]:
    """Run the soak test, report a line per interval, and return intervals, counters and unexplained differences.

    ``unaccounted_frames`` and ``unaccounted_bytes`` must be 0 and ``same_bytes`` true; you judge the growth yourself.
    """
    truth = Tally()
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
        run_options = AssemblyOptions(port=f"pty:{folder}/port", rate_hz=rate_hz, faults=FAULTS, seed=seed)
        emulator = assemble(file.load("anyskin"), run_options, truth=truth).emulator
        emulator.clock = RealClock()
        emulator.open()
        reader = subprocess.Popen([sys.executable, "-c", READER, f"{folder}/port"], stdout=subprocess.PIPE, text=True)
        try:
            assert reader.stdout is not None and reader.stdout.readline()
            rows = _intervals(report, emulator, minutes * 60, interval_s)
            time.sleep(0.5)  # the reader takes what is left
        finally:
            emulator.close()
            output, _ = reader.communicate(timeout=10)
    channel = emulator.channels[0]
    size, check = map(int, output.split())
    figures = {
        "intervals": rows,
        "samples": channel.statistics.samples,
        "missed": channel.statistics.missed,
        "counters": dict(channel.wire.counters),
        "injected": dict(truth.injected),
        "unaccounted_frames": unaccounted(channel, truth),
        "unaccounted_bytes": truth.size - size,
        "same_bytes": truth.check == check,
        "rss_growth_kib_per_hour": _slope([(row["t_s"], row["rss_kib"]) for row in rows[1:]]) * 3600,
        "fds_growth": rows[-1]["fds"] - rows[0]["fds"],
        "lateness_p50_growth_us_per_hour": _slope([(row["t_s"], row["p50_us"]) for row in rows[1:]]) * 3600,
    }
    for line in _verdict(figures):
        report(line)
    return figures


def unaccounted(channel: Channel, truth: Truth) -> int:
    """Return the number of frames that no counter explains, for a device with one frame per sample.

    The samples, plus the frames that faults added, minus those that they removed, must equal the frames that were sent,
    lost or unheard.
    """
    wire, injected = channel.wire.counters, truth.injected
    made = channel.statistics.samples + injected["duplicate"] + injected["garbage"] - injected["drop"]
    gone = wire["sent"] + wire["dropped_frames"] + wire["dropped_unread"] + wire["unheard"]
    return made - gone


def _intervals(report: Report, emulator: Emulator, seconds: float, interval_s: float) -> list[dict[str, float]]:
    """Run the emulator, and measure the process after every interval."""
    statistics = emulator.channels[0].statistics
    rows: list[dict[str, float]] = []
    report("    time      RSS   fds   lateness p50    p99      max   samples   missed")
    for k in range(1, max(1, round(seconds / interval_s)) + 1):
        statistics.lateness = Lateness()
        emulator.run(k * interval_s - emulator.clock.now_ns() / 1e9)
        late = statistics.lateness
        row = {
            "t_s": k * interval_s,
            "rss_kib": _rss_kib(),
            "fds": len(os.listdir("/proc/self/fd")),
            "p50_us": late.percentile_ns(50) / 1e3,
            "p99_us": late.percentile_ns(99) / 1e3,
            "max_us": late.max_ns / 1e3,
            "samples": statistics.samples,
            "missed": statistics.missed,
        }
        rows.append(row)
        report(
            f"{row['t_s']:6.0f} s {row['rss_kib'] / 1024:5.1f} MiB {row['fds']:3.0f}   {row['p50_us']:8.0f} µs "
            f"{row['p99_us']:6.0f} {row['max_us']:8.0f} {row['samples']:9.0f} {row['missed']:8.0f}"
        )
    return rows


def _verdict(figures: dict[str, Any]) -> list[str]:
    return [
        f"injected: {', '.join(f'{name} {count}' for name, count in sorted(figures['injected'].items()))}",
        f"counters: {', '.join(f'{name} {count}' for name, count in sorted(figures['counters'].items()))}",
        f"frames that no counter explains: {figures['unaccounted_frames']}",
        f"bytes written that the reader did not get: {figures['unaccounted_bytes']}, "
        f"the others {'the same' if figures['same_bytes'] else 'NOT THE SAME'}",
        f"growth: {figures['rss_growth_kib_per_hour']:+.0f} KiB/h, {figures['fds_growth']:+.0f} file descriptors, "
        f"median lateness {figures['lateness_p50_growth_us_per_hour']:+.1f} µs/h",
    ]


def _rss_kib() -> float:
    """Return the resident memory of this process [KiB]."""
    with open("/proc/self/statm", encoding="ascii") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 1024


def _slope(points: list[tuple[float, float]]) -> float:
    """Return the least-squares slope, or 0 with fewer than two points."""
    if len(points) < 2:
        return 0.0
    x, y = np.array(points).T
    return float(np.polyfit(x, y, 1)[0])
