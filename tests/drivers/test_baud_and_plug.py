"""The line's speed and the plug, seen by unmodified drivers and by pyserial."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.cli.command import environment
from tests.drivers.live import Live, served, until
from tests.drivers.test_ability_hand import documented_force
from tests.drivers.test_inspire_rh56dftp import INDEX_TOP, PALM
from tests.judge.cards import CARDS

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]

FORCE = np.array([documented_force(count) for count in range(4096)])
READS = {
    # by driver, whose line has a speed: the noise that makes its readings differ, and what it reports of a sample
    "flexitac": (0.1, np.ravel),
    "ability-hand": (1.0, lambda counts: FORCE[counts].ravel()),
    "pymodbus": (0.5, lambda counts: counts[PALM].ravel()),
    "modbus_tk": (0.5, lambda counts: counts[INDEX_TOP].ravel()),
}


@pytest.mark.parametrize("name", [*list(READS)[:-1], pytest.param("modbus_tk", marks=pytest.mark.nightly)])
def test_nothing_at_the_wrong_baud_and_everything_at_the_right_one(name, tmp_path):
    noise, of = READS[name]
    with served(tmp_path, CARDS[name].device, noise=noise) as dev:
        wire = dev.emulator.channels[0].wire
        with Live(name, dev.port, dev, of, CARDS[name].wrong_baud) as lost:
            assert until(lambda: wire.counters["misheard"] >= 10, 30), "bytes went over the line, and came out as noise"
            time.sleep(0.5)
            assert not any(lost.place(said) for said in lost.rows)
            if name != "flexitac":  # it has no checksum: whatever follows AA 55 is an image
                assert not lost.rows
        with Live(name, dev.port, dev, of) as live:
            assert live.settles()
            misheard, since = wire.counters["misheard"], len(live.rows)
            dev.wait(0.5)
            assert wire.counters["misheard"] == misheard
            assert len(live.rows) > since and "wrong" not in live.story(since)


def test_usb_does_not_care_for_the_baud(tmp_path):
    with served(tmp_path, "anyskin") as dev, Live("anyskin", dev.port, dev, baud=9600) as live:
        assert live.settles()


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
    with served(tmp_path, "anyskin", rate_hz=rate_hz) as dev:
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
