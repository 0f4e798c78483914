"""The reader of `python -m benchmarks bus`: it starts every board, reads every frame, and prints their lateness."""

from __future__ import annotations

import ctypes
import json
import socket
import sys
import time
import zlib
from typing import Any

import numpy as np

from firmware_protocols.can_frames import CAN_FRAME, CanFrames
from tactemu.wire.can_bits import run_ns

BUFFER_BYTES = 4 << 20
"""The requested receive buffer of each bus; the kernel gives at most net.core.rmem_max."""
_SET_UP = ("4D0014F000000000", "5000060201002200", "07000000")
_STOP = "07010000"
_AT_ONCE = 64
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
_MESSAGE = np.dtype(
    [
        ("name", "u8"), ("name_length", "u8"), ("vector", "u8"), ("count", "u8"), ("control", "u8"),
        ("control_length", "u8"), ("flags", "u8"), ("length", "u8"),
    ]
)  # fmt: skip
_BESIDE = np.dtype([("size", "u8"), ("level", "i4"), ("kind", "i4"), ("s", "i8"), ("ns", "i8"), ("rest", "u4", 8)])
_PAUSE_S = 0.004
_recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg


class Bus:
    """The socket of a bus, with the counts of the frames read from it."""

    def __init__(self, name: str, boards: int, start_ns: int, period_ns: int):
        self.boards, self.start_ns, self.period_ns = boards, start_ns, period_ns
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self.socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        self.socket.bind((name,))
        self.socket.setblocking(False)
        self.count = self.sum = self.overflows = 0
        self._frames = np.zeros(_AT_ONCE, CAN_FRAME)
        self._beside = np.zeros(_AT_ONCE, _BESIDE)
        vectors = np.zeros((_AT_ONCE, 2), np.uint64)
        vectors[:, 0] = self._frames.ctypes.data + np.arange(_AT_ONCE) * CAN_FRAME.itemsize
        vectors[:, 1] = CAN_FRAME.itemsize
        self._messages = np.zeros(_AT_ONCE, _MESSAGE)
        self._messages["vector"] = vectors.ctypes.data + np.arange(_AT_ONCE) * 16
        self._messages["count"] = 1
        self._messages["control"] = self._beside.ctypes.data + np.arange(_AT_ONCE) * _BESIDE.itemsize
        self._vectors = vectors

    def send_to_all(self, data: str) -> None:
        """Send a message to every board."""
        for board in range(1, self.boards + 1):
            payload = bytes.fromhex(data)
            self.socket.send(CanFrames.of([0x200 | board], np.frombuffer(payload, np.uint8)[None]).array.tobytes())
            time.sleep(0.0005)

    def read(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Read at most :data:`_AT_ONCE` frames, and return them with their times [ns]; None if there are none."""
        self._messages["control_length"] = _BESIDE.itemsize
        got = _recvmmsg(self.socket.fileno(), ctypes.c_void_p(self._messages.ctypes.data), _AT_ONCE, 0, None)
        if got <= 0:
            return None
        frames, beside = self._frames[:got].copy(), self._beside[:got]
        self.count += got
        self.sum = zlib.crc32(frames.tobytes(), self.sum)
        full = self._messages["control_length"][:got] > 32
        if full.any():
            self.overflows = max(self.overflows, int(beside["rest"][full][:, 4].max()))
        return frames, beside["s"] * 1_000_000_000 + beside["ns"]


class Lateness:
    """The lateness of a bus's frames relative to an exact bus on which the frames of every sample leave at once."""

    def __init__(self, bus: Bus):
        self._bus, self._frames, self._times = bus, [], []
        self.counts = np.zeros(200_000, np.int64)
        """The number of frames by lateness in units of 10 us."""
        self.busy_ns = 0
        self.first_ns = self.last_ns = 0

    def add(self, frames: np.ndarray, times: np.ndarray) -> None:
        """Add frames that were read; they are evaluated sample by sample."""
        self._frames.append(frames)
        self._times.append(times)
        if sum(map(len, self._frames)) > 4096:
            self.evaluate()

    def evaluate(self) -> None:
        """Evaluate all complete samples that were added."""
        if not self._frames:
            return
        frames, times = np.concatenate(self._frames), np.concatenate(self._times)
        a_sample = self._bus.boards * 14
        if not self.first_ns:  # the first head of the first board begins a sample
            begins = np.flatnonzero((frames["can_id"] == 0x410) & (frames["data"][:, 0] == 0x40))
            if not len(begins):
                return
            frames, times = frames[begins[0] :], times[begins[0] :]
            self.first_ns = int(times[0])
            self._number = (self.first_ns - self._bus.start_ns) // self._bus.period_ns
        n = len(frames) // a_sample
        complete = n * a_sample
        self._frames, self._times = [frames[complete:]], [times[complete:]]
        if not n:
            return
        took = np.array(run_ns(CanFrames(frames[:complete]), 1_000_000)).reshape(n, a_sample)
        due = self._bus.start_ns + (self._number + np.arange(n))[:, None] * self._bus.period_ns + took.cumsum(axis=1)
        late = (times[:complete].reshape(n, a_sample) - due) // 10_000
        np.add.at(self.counts, np.clip(late, 0, len(self.counts) - 1).ravel(), 1)
        self._number += n
        self.busy_ns += int(took.sum())
        self.last_ns = int(times[complete - 1])


def main(told: dict[str, list[int]], seconds: float) -> dict[str, Any]:
    """Read every bus for ``seconds``, and return the figures."""
    to_realtime = time.time_ns() - time.monotonic_ns()
    buses = {name: Bus(name, boards, start + to_realtime, period) for name, (boards, start, period) in told.items()}
    for message in _SET_UP:
        for bus in buses.values():
            bus.send_to_all(message)
    late = {name: Lateness(bus) for name, bus in buses.items()}
    begun = time.monotonic()
    settled, end, quiet = begun + 0.5, begun + 0.5 + seconds, 0.0
    stopped = False
    while not stopped or time.monotonic() < quiet:
        now = time.monotonic()
        if now > end and not stopped:
            for bus in buses.values():
                bus.send_to_all(_STOP)
            stopped, quiet = True, time.monotonic() + 0.3
        for name, bus in buses.items():
            while (got := bus.read()) is not None:
                if settled < now < end:
                    late[name].add(*got)
                if stopped:
                    quiet = time.monotonic() + 0.3
        time.sleep(_PAUSE_S)
    for each in late.values():
        each.evaluate()
    counts = np.sum([each.counts for each in late.values()], axis=0)
    upto = counts.cumsum()
    spans = [each.last_ns - each.first_ns for each in late.values()]
    return {
        "read": {name: [bus.count, bus.sum] for name, bus in buses.items()},
        "seconds": seconds,
        "frames_per_s": float(sum(each.counts.sum() / span * 1e9 for each, span in zip(late.values(), spans))),
        "load": max(each.busy_ns / span for each, span in zip(late.values(), spans)),
        "late_p50_ms": float(np.searchsorted(upto, upto[-1] * 0.50)) / 100,
        "late_p99_ms": float(np.searchsorted(upto, upto[-1] * 0.99)) / 100,
        "late_max_ms": float(np.flatnonzero(counts)[-1]) / 100,
        "receive_buffer": next(iter(buses.values())).socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF),
        "overflows": sum(bus.overflows for bus in buses.values()),
        "reader_cpu": time.process_time() / (time.monotonic() - begun),
    }


if __name__ == "__main__":
    print(json.dumps(main(json.loads(sys.argv[1]), float(sys.argv[2]))))
