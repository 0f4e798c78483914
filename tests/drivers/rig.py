"""A device on a bare pty or TCP port, and drivers in processes of their own.

The rig is the smallest runner of a device: one thread, ``select``, absolute deadlines. It has no simulation, wire or
faults of its own, so that a driver test which fails here has found an error of the device file.
"""

import contextlib
import fcntl
import importlib.util
import json
import os
import pty
import select
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from firmware_protocols import Delayed, Device, Reading
from tests.drivers.can_link import open_can

DRIVERS = Path(__file__).parent / "scripts"


class Rig:
    """Runs ``device`` on ``kind`` (serial, tcp, can) in a thread; ``truth`` lists the counts of every sample."""

    def __init__(self, device: Device, *, kind: str = "serial", seed: int = 0, peak: float = 3.0):
        self.device, self.kind, self.peak = device, kind, peak
        self.truth: list[np.ndarray] = []
        self.sampled_ns: list[int] = []
        self.error: BaseException | None = None
        self._random = np.random.default_rng(seed)
        self._stop = threading.Event()
        self._pending: list[tuple[int, bytes]] = []
        self._open = {"serial": _open_pty, "tcp": _open_tcp, "can": open_can}[kind]

    def reading(self, t_ns: int) -> Reading:
        """Every sample another random push on every taxel, so that a reading names its sample."""
        push = self._random.uniform(0.0, self.peak, len(self.device.layout))
        return Reading(t_ns=t_ns, values=-push[:, None] * self.device.layout.normals)

    def __enter__(self):
        self.device.plug(self.kind)
        self.device.power_on(0)
        self.port, self._link = self._open()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join(5)
        self._link.close()
        if self.error is not None:
            raise self.error

    def _run(self):
        try:
            self._loop()
        except BaseException as error:
            self.error = error

    def _loop(self):
        start, due = time.monotonic_ns(), 0
        while not self._stop.is_set():
            wait = min([due, *(when for when, _ in self._pending)]) - (time.monotonic_ns() - start)
            ready, _, _ = select.select(self._link.filenos(), [], [], min(max(wait / 1e9, 0.0), 0.05))
            now = time.monotonic_ns() - start
            if ready:
                for data in self._link.read(self.device, now):
                    self._queue(self.device.receive(data, now), now)
            if now >= due:
                self._queue(self.device.sample(self.reading(now), now), now)
                self.truth.append(self.device.counts.copy())
                self.sampled_ns.append(now)
                due = max(due + self.device.period_ns, now - self.device.period_ns)
            self._send(now)

    def _queue(self, outgoing, now):
        for item in outgoing:
            delay, frame = (item.delay_ns, item.frame) if isinstance(item, Delayed) else (0, item)
            self._pending.append((now + delay, frame))

    def _send(self, now):
        late = [frame for when, frame in self._pending if when <= now]
        self._pending = [(when, frame) for when, frame in self._pending if when > now]
        for frame in late:
            self._link.write(frame)


class _Pty:
    def __init__(self):
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)

    def filenos(self):
        return [self.master]

    def read(self, _device, _now):
        with contextlib.suppress(BlockingIOError):
            return [os.read(self.master, 4096)]
        return []

    def write(self, frame):
        """Nothing is written while 3900 bytes wait to be read: a frame goes whole or not at all."""
        if struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, b"\0" * 4))[0] < 3900:
            assert os.write(self.master, frame) == len(frame)

    def close(self):
        os.close(self.master)
        os.close(self.slave)


class _Tcp:
    def __init__(self):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.client: socket.socket | None = None

    def filenos(self):
        return [self.server, *([self.client] if self.client else [])]

    def read(self, device, now):
        if self.client is None:
            self.client, _ = self.server.accept()
            device.opened(now)
            return []
        with contextlib.suppress(BlockingIOError):
            if data := self.client.recv(4096, socket.MSG_DONTWAIT):
                return [data]
            self.client.close()
            self.client = None
            device.closed(now)
        return []

    def write(self, frame):
        if self.client:
            self.client.sendall(frame)

    def close(self):
        if self.client:
            self.client.close()
        self.server.close()


def _open_pty():
    link = _Pty()
    return os.ttyname(link.slave), link


def _open_tcp():
    link = _Tcp()
    return f"127.0.0.1:{link.server.getsockname()[1]}", link


def run_driver(package: str, script: str, *arguments, cwd=None, seconds: float = 60.0):
    """Run ``tests/drivers/scripts/<script>`` in its own process; the JSON of its last line of output.

    Skips where ``package`` is not installed.
    """
    if importlib.util.find_spec(package) is None:  # not imported: drivers leave files and loggers behind
        pytest.skip(f"{package} is not installed")
    command = [sys.executable, str(DRIVERS / script), *map(str, arguments)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=seconds, cwd=cwd)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def assert_consecutive(readings, truth, *, decode=lambda counts: counts, count=200):
    """Every reading equals one sample of the truth log, ``count`` of them, in the order of sampling.

    ``decode`` turns the logged counts into what the driver must report.
    """
    sampled: dict[bytes, list[int]] = {}
    for index, counts in enumerate(truth):
        sampled.setdefault(np.asarray(decode(counts), float).tobytes(), []).append(index)
    places = []
    for k, reading in enumerate(readings):
        at = sampled.get(np.asarray(reading, float).tobytes())
        assert at, f"reading {k} of {len(readings)} is in no sample: {reading}"
        later = [index for index in at if not places or index >= places[-1]]
        assert later, f"reading {k} of {len(readings)} is older than the one before"
        places.append(later[0])
    assert len(places) >= count
    return places
