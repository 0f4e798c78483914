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
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from firmware_protocols import Can, Convert, Device, Reading, Restart, Sent, Serial, Tcp
from firmware_protocols.check.readings import reading_of
from tests.drivers.can_link import open_can
from tests.drivers.environments import python_with
from tests.drivers.usb_link import open_usb

USB_CHIP = os.environ.get("TACTEMU_RIG_CHIP")
"""The chip of a USB device, in place of a pty: ``test_usb_matrix.py`` runs the tests of drivers on each, in a guest."""
DRIVERS = Path(__file__).parent / "scripts"
EQUAL: list[int] = []
"""How many readings equalled the truth, in each comparison of the test that runs."""


class Rig:
    """Runs ``device`` on ``kind`` (serial, tcp, can) in a thread; ``truth`` lists the counts of every sample.

    With ``paced_by_driver``, on a serial port, a stream makes no sample while bytes wait to be read: a driver that a
    busy machine keeps from reading throws away what has gathered, or has no room for it.
    """

    def __init__(
        self, device: Device, *, kind: str = "serial", seed: int = 0, peak: float = 3.0, paced_by_driver: bool = False
    ):
        self.device, self.kind, self.peak, self.paced_by_driver = device, kind, peak, paced_by_driver
        self.truth: list[np.ndarray] = []
        self.sampled_ns: list[int] = []
        self.error: BaseException | None = None
        self._random = np.random.default_rng(seed)
        self._stop = threading.Event()
        self._pending: list[tuple[int, bytes]] = []
        connector, self._open = {"serial": (Serial, _open_pty), "tcp": (Tcp, _open_tcp), "can": (Can, open_can)}[kind]
        port = next(port for port in device.ports if isinstance(port, connector))
        self._connector = port.name
        if kind == "serial" and USB_CHIP:
            self._open = partial(open_usb, USB_CHIP, port)

    def reading(self, stream: str) -> Reading:
        """Every sample another random push on every taxel, so that a reading names its sample."""
        return reading_of(self.device, self._random.uniform(0.0, self.peak, len(self.device.layout)), stream)

    def __enter__(self):
        self._boot(0)
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

    def _boot(self, now):
        """Each stream converts once, which sends nothing; then the firmware speaks, and periods begin."""
        for stream in self.device.periods:
            self._feel(stream, now)
        self._queue(self.device.boot(now), now)
        self._due = dict.fromkeys(self.device.periods, now)

    def _feel(self, stream, now):
        self.truth.append(np.copy(self.device.measure(self.reading(stream), now)))
        self.sampled_ns.append(now)

    def _loop(self):
        start = time.monotonic_ns()
        while not self._stop.is_set():
            held = self.paced_by_driver and self._link.unread() > 0
            running = [due for stream, due in self._due.items() if self.device.periods[stream] and not held]
            alarm = [] if self.device.wake_ns is None else [self.device.wake_ns]
            next_ns = min([*running, *alarm, *(when for when, _ in self._pending)], default=start + 10**9)
            wait = next_ns - (time.monotonic_ns() - start)
            longest_s = 0.002 if held else 0.05
            ready, _, _ = select.select(self._link.filenos(), [], [], min(max(wait / 1e9, 0.0), longest_s))
            now = time.monotonic_ns() - start
            if ready:
                for event in self._link.read():
                    self._hear(event, now)
            if self.device.wake_ns is not None and now >= self.device.wake_ns:
                self.device.wake_ns = None
                self._queue(self.device.wake(now), now)
            for stream, period in self.device.periods.items():
                if period and now >= self._due[stream] and not held:
                    self._convert(stream, now)
                    self._due[stream] = max(self._due[stream] + period, now - period)
            self._send(now)

    def _hear(self, event, now):
        """Data, or ``True`` or ``False`` where a driver connects or leaves."""
        if isinstance(event, bool):
            outs = self.device.lines(event, event, now, self._connector)
        else:
            outs = self.device.receive(event, now, self._connector)
        self._queue(outs, now)

    def _convert(self, stream, now):
        self._feel(stream, now)
        self._queue(self.device.stream(now, stream), now)

    def _queue(self, outs, now):
        for out in outs:
            if isinstance(out, Restart):
                self.device.power_cycle()
                self._boot(now)
            elif isinstance(out, Convert):
                self._convert(out.stream, now)
            else:
                delay, frame = (out.delay_ns, out.frame) if isinstance(out, Sent) else (0, out)
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

    def read(self):
        with contextlib.suppress(BlockingIOError):
            return [os.read(self.master, 4096)]
        return []

    def unread(self):
        return struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, b"\0" * 4))[0]

    def write(self, frame):
        """Write a frame whole, or nothing of it while 3900 bytes wait to be read.

        A busy kernel has more on the way than it counts, and takes a part; it takes the rest when it has moved that.
        """
        if self.unread() < 3900:
            while frame:
                assert select.select([], [self.master], [], 10)[1], "the driver does not read"
                frame = frame[os.write(self.master, frame) :]

    def close(self):
        os.close(self.master)
        os.close(self.slave)


class _Tcp:
    def __init__(self):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.client: socket.socket | None = None

    def filenos(self):
        return [self.server, *([self.client] if self.client else [])]

    def read(self):
        if self.client is None:
            self.client, _ = self.server.accept()
            return [True]
        with contextlib.suppress(BlockingIOError):
            if data := self.client.recv(4096, socket.MSG_DONTWAIT):
                return [data]
            self.client.close()
            self.client = None
            return [False]
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


def run_driver(package: str, script: str, *arguments, cwd=None, seconds: float = 60.0, environment=""):
    """Run ``tests/drivers/scripts/<script>`` in its own process; the JSON of its last line of output.

    ``environment`` is one of :mod:`tests.drivers.environments`, default ours. Skips where ``package`` is not installed.
    """
    python = python_with(environment) if environment else sys.executable
    # not imported: drivers leave files and loggers behind
    if not environment and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    command = [python, str(DRIVERS / script), *map(str, arguments)]
    seconds *= 10 if USB_CHIP else 1  # a guest is slow
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
    EQUAL.append(len(places))
    return places
