"""Drivers on a wire that goes wrong: what they count is what was injected, and what they hand over was sent."""

import struct
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import serial

import tactemu
from tests.drivers import fault_matrix
from tests.drivers.rig import run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]


def driver_of(name):
    return next(driver for driver in fault_matrix.ALL if name in driver.name)


def serve(driver, tmp_path, **options):
    scene = tmp_path / "scene.toml"
    scene.write_text(fault_matrix.SCENE.format(device=driver.device, bias=driver.bias, noise=driver.noise))
    return tactemu.serve(scene, driver.port, **options)


def byte_sum_is_right(frame):
    """OptoForce: 16-bit sum of all bytes before it, big endian."""
    return sum(frame[:-2]) & 0xFFFF == struct.unpack(">H", frame[-2:])[0]


@pytest.mark.parametrize("fault", ["checksum 10%", "checksum every 7", "checksum 10% bytes 2"])
def test_a_driver_rejects_as_many_frames_as_were_damaged(fault, tmp_path):
    """optoforce says of every packet whether its sum was right; the packets' counter aligns it with the truth."""
    driver = driver_of("optoforce")
    with serve(driver, tmp_path, faults=[fault], seed=3) as dev:
        packets = run_driver("optoforce", driver.script, *driver.arguments(dev.port))
        frames = [frame for _, _, frame in dev.truth.frames if len(frame) == 16]
        truth = [sample.counts for sample in dev.truth.samples]
        injected = dev.truth.injected["checksum"]
    sent = [struct.unpack(">H", frame[4:6])[0] for frame in frames]
    first, last = (sent.index(packets[k]["count"]) for k in (0, -1))
    damaged = [not byte_sum_is_right(frame) for frame in frames]
    assert sum(damaged) == injected
    assert [not packet["valid_checksum"] for packet in packets] == damaged[first : last + 1]
    assert sum(damaged[first : last + 1]) > 5
    values = {np.asarray(driver.expected(counts), float).tobytes() for counts in truth}
    assert all(np.asarray(reading, float).tobytes() in values for reading in driver.readings(packets))


@pytest.mark.parametrize("fault", ["drop 10%", "duplicate 10%", "late 10% by 30ms", "merge 20%", "latency 16ms"])
def test_nothing_wrong_is_handed_over_where_no_byte_is_wrong(fault):
    outcome = fault_matrix.run(driver_of("optoforce"), fault)
    assert outcome.injected > 5 and outcome.readings == 200
    assert (outcome.wrong, outcome.rejected, outcome.error) == (0, 0, "")


@pytest.mark.parametrize("name", ["pymodbus", "flexitac"])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_at_the_wrong_speed_a_driver_decodes_nothing(name, factor, tmp_path):
    driver = driver_of(name)
    with serve(driver, tmp_path) as dev:
        (wire,) = dev.emulator.wires
        wire.spec = replace(wire.spec, baud=round(wire.spec.baud * factor))  # the driver keeps to the usual speed
        with pytest.raises(AssertionError, match=r"assert answer|not answer.isError|ModbusIOException|TimeoutError"):
            run_driver(name, driver.script, *driver.arguments(dev.port), seconds=40)
        assert wire.counters["misheard"] > 0


def test_unplugged_pyserial_raises_at_once_and_reconnected_it_reads_within_a_period(tmp_path):
    seen = {}

    def driver(port):
        link = serial.Serial(port, timeout=5)
        try:
            while True:
                assert link.read(82)
        except serial.SerialException:
            seen["raised"] = time.monotonic()
        while not Path(port).is_symlink():
            time.sleep(0.0005)
        seen["back"] = time.monotonic()
        with serial.Serial(port, timeout=5) as link:
            seen["frame"] = link.read(82)
            seen["read"] = time.monotonic()

    with tactemu.serve("anyskin", rate_hz=50, faults=["unplug at 500ms for 500ms"]) as dev:
        thread = threading.Thread(target=driver, args=(dev.port,))
        thread.start()
        thread.join(30)
        frames = {frame for _, _, frame in dev.truth.frames}
        assert dev.truth.injected["unplug"] == 1
    assert seen["back"] - seen["raised"] == pytest.approx(0.5, abs=0.2), "raised when it was unplugged"
    assert seen["read"] - seen["back"] < 0.02 + 0.05
    assert seen["frame"] in frames
