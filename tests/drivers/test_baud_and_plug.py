"""The line's speed and the plug, seen by unmodified drivers and by pyserial."""

import json
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from tests.cli.command import environment
from tests.drivers.matrix.bout import Judge, Process, Ring, served, until
from tests.drivers.matrix.drivers import DRIVERS

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(120)]


@pytest.mark.parametrize("name", [name for name, driver in DRIVERS.items() if driver.wrong_baud])
def test_nothing_at_the_wrong_baud_and_everything_at_the_right_one(name, tmp_path):
    driver = DRIVERS[name]
    if not driver.installed:
        pytest.skip(f"{driver.package} is not installed")
    with Ring(name, driver, tmp_path) as ring:
        wire = ring.dev.emulator.channels[0].wire
        lost = Process(name, ring.dev.port, tmp_path, driver.wrong_baud)
        try:
            heard = until(lambda: wire.counters["misheard"] >= 10, 30)
            time.sleep(0.5)
            readings = [line for line in lost.lines if "parts" in line]
            assert heard, "bytes went over the line, and came out as noise"
            assert not any(ring.judge.right(line) for line in readings)
            if name != "flexitac":  # it has no checksum: whatever follows AA 55 is an image
                assert not readings
        finally:
            lost.kill()
        assert ring.restart(), "ten right readings in a row"
        lines, misheard, known = ring.process.lines, wire.counters["misheard"], len(ring.process.lines)
        ring.dev.wait(0.5)
        assert wire.counters["misheard"] == misheard
        assert len(lines) > known and all(ring.judge.right(line) for line in list(lines)[known:])


def test_usb_does_not_care_for_the_baud(tmp_path):
    driver = DRIVERS["anyskin"]
    if not driver.installed:
        pytest.skip(f"{driver.package} is not installed")
    with Ring("anyskin", driver, tmp_path) as ring:
        process = Process("anyskin", ring.dev.port, tmp_path, 9600)
        try:
            judge = Judge(ring.dev, driver)
            assert until(lambda: judge.recovered(process.lines, 0) is not None, 30)
        finally:
            process.kill()


READER = """
import json, sys, time
import serial

def say(**line):
    print(json.dumps({"t": time.monotonic_ns(), **line}), flush=True)

port = serial.Serial(sys.argv[1], 115200)
say(what="open")
try:
    while True:
        port.read(82)
except OSError as error:
    say(what="raised", error=type(error).__name__)
port.close()
while True:
    try:
        port = serial.Serial(sys.argv[1], 115200, timeout=2)
        break
    except OSError:
        time.sleep(0.001)
say(what="open again")
frame = port.read(82)
say(what="frame", data=frame.hex())
"""


def test_pyserial_raises_at_once_and_a_reader_that_reconnects_gets_the_next_frame(tmp_path):
    rate_hz = 20
    with served(replace(DRIVERS["anyskin"], rate_hz=rate_hz), tmp_path) as dev:
        reader = subprocess.Popen(
            [sys.executable, "-c", READER, dev.port], stdout=subprocess.PIPE, text=True, env=environment()
        )
        try:
            assert json.loads(reader.stdout.readline())["what"] == "open"
            dev.wait_for_driver()
            dev.wait(0.2)
            wire, times = dev.emulator.channels[0].wire, {}

            def pull():
                times["pulled"] = time.monotonic_ns()
                times["fault"] = wire.add_fault("unplug")

            def plug():
                wire.remove_fault(times["fault"])

            dev.emulator.call(pull)
            raised = json.loads(reader.stdout.readline())
            dev.wait(0.3)
            dev.emulator.call(plug)
            again, frame = (json.loads(reader.stdout.readline()) for _ in range(2))
            offset = time.monotonic_ns() - dev.emulator.clock.now_ns()
        finally:
            reader.kill()
            reader.wait(10)
    assert raised["what"] == "raised" and raised["error"] == "SerialException"
    assert (raised["t"] - times["pulled"]) / 1e9 < 1 / rate_hz, "not when the next frame is due, but at once"

    (sample,) = (s for s in dev.truth.samples if s.counts.astype("<f4").tobytes().hex() + "0d0a" == frame["data"])
    assert (sample.t_ns + offset - again["t"]) / 1e9 <= 1 / rate_hz, "a whole frame, of a sample within one period"
