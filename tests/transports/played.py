"""A device on a port without a scene: another random push on every taxel at each sample."""

import threading

import numpy as np

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tactemu import transports
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.truth import Truth
from tactemu.wire.wire import Wire


class RandomPushes:
    """A source of readings that needs no physics, so that it is quick to start in a guest, too."""

    imperfections = None

    def __init__(self, device):
        self._device, self._random = device, np.random.default_rng(1)
        self._reading, self._at_ns = None, -1

    def read(self, senses, t_ns):
        if t_ns != self._at_ns:
            push = self._random.uniform(0.0, 3.0, len(self._device.layout))
            self._reading, self._at_ns = reading_of(self._device, push, ""), t_ns
        values = {sense.key: np.asarray(self._reading[sense.key]) for sense in senses}
        return values, values


class Played:
    """A device on a port, run in a thread, at its own rate or a slower one."""

    def __init__(self, name, port, faults=(), hz=None, **options):
        self.device = fp.create(name, **options)
        self.truth = Truth()
        self.wire = Wire(transports.create(port), self.device.ports[0], truth=self.truth, faults=faults)
        clock = SampleClock(period_ns=self.device.period_ns)
        wanted = {"": round(1e9 / hz)} if hz else {}
        wires = {self.device.ports[0].name: self.wire}
        channel = Channel(name, self.device, RandomPushes(self.device), wires, clock, wanted_periods=wanted)
        self.emulator = Emulator(None, [channel], truth=self.truth)
        self._thread = threading.Thread(target=self.emulator.run)

    def __enter__(self):
        self.emulator.open()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.emulator.stop()
        self._thread.join()
        self.emulator.close()

    def samples(self):
        """Return the counts of all samples, each as float64 bytes in the device's order."""
        return {np.ravel(sample.counts).astype(float).tobytes() for sample in self.truth.samples}
