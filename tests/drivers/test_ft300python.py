"""ft300python 1.0.2, unmodified, reads the stream and the registers of an FT 300-S, with a pymodbus of its own time."""

import numpy as np
import pytest

import firmware_protocols as fp
import tactemu
from firmware_protocols.check.readings import reading_of
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("robotiq_ft300", driver="ft300python", environment="ft300python", carrier="RS-485, Modbus"),
    pytest.mark.driver,
    pytest.mark.timeout(180),
]

SCALE = (100, 100, 100, 1000, 1000, 1000)
"""The driver's own constants."""


class Pulled(Rig):
    """Every sample another force, torque and acceleration, along all axes; none is 20 4E on the wire."""

    def reading(self, stream):
        wrench = self._random.uniform(-1, 1, 6) * [90, 90, 90, 9, 9, 9]
        return reading_of(self.device, 0.0, stream, wrench=wrench, acceleration=self._random.uniform(-30, 30, 3))


def test_200_frames_and_200_answers():
    with Pulled(fp.create("robotiq_ft300", serial_number=0x12345678, year=2022), paced_by_driver=True) as rig:
        got = run_driver("ft300python", "ft300_read.py", rig.port, 200, seconds=90, environment="ft300python")
    assert got["about"] == [2022, [0x4654, 0x5300, 0x5678, 0x1234]]
    for name in ("streamed", "asked"):
        places = assert_consecutive(
            got[name], rig.truth, decode=lambda counts: [n / c for n, c in zip(counts.item()["wrench"][0], SCALE)]
        )
        assert name == "asked" or np.diff(places).max() == 1, "no frame is lost"
    assert_consecutive(got["accelerations"], rig.truth, decode=lambda counts: counts.item()["acceleration"][0] / 1000)
    assert not rig.device.streaming and rig.device.counters["requests"] == 1 + 1 + 200 + 200 + 2


def test_a_press_reaches_the_driver_at_19200_baud():
    """Simulation, device and a line on which bytes take their time."""
    with tactemu.serve("robotiq_ft300") as dev:
        dev.press(depth=5e-4)
        got = run_driver("ft300python", "ft300_read.py", dev.port, 50, seconds=60, environment="ft300python")
        truth = {
            tuple(n / c for n, c in zip(sample.counts[0].tolist(), SCALE))
            for sample in dev.truth.samples
            if sample.sense == "wrench"
        }
    readings = {tuple(reading) for name in ("streamed", "asked") for reading in got[name]}
    assert readings <= truth and min(reading[2] for reading in readings) < -0.1, "the push is felt"
