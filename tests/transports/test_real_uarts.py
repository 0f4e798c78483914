"""``serial:`` on UARTs of a real kernel, read by unmodified drivers; run in ``scripts/kernel-guest -n``."""

import struct
import time

import numpy as np
import pytest
import serial

import firmware_protocols as fp
from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import Closed, Opened, Received
from tactemu.truth import Truth
from tactemu.wire.wire import Wire
from tests.drivers.rig import run_driver
from tests.transports.played import Played

pytestmark = [pytest.mark.guest, pytest.mark.timeout(120)]
NEAR, FAR = "/dev/ttyS1", "/dev/ttyS2"
"""The two ends of the null-modem cable of ``scripts/kernel-guest -n``; 16550A, three wires."""


@pytest.fixture(autouse=True)
def empty_cable():
    """Take out what an earlier test has left in the cable, which keeps bytes as a real one does not."""
    with serial.Serial(NEAR, 115_200, timeout=0.2) as near, serial.Serial(FAR, 115_200, timeout=0.2) as far:
        while near.read(10_000) or far.read(10_000):
            pass


def opened(connector=None, path=NEAR):
    port = transports.create(f"serial:{path}")
    port.set_connector(connector or fp.Serial(baud=115_200))
    port.open()
    return port


def received(port, count, seconds=5.0):
    data, deadline = b"", time.monotonic() + seconds
    while len(data) < count and time.monotonic() < deadline:
        data += b"".join(event.data for event in port.poll() if isinstance(event, Received))
        time.sleep(0.001)
    return data


def test_every_reading_of_anyskins_own_driver_is_a_sample():
    with Played("anyskin", f"serial:{NEAR}") as played:
        got = run_driver("anyskin", "anyskin_read.py", "anyskin", FAR, 100, seconds=60)
    samples = played.samples()
    readings = [np.array(reading).tobytes() for reading in got["readings"]]
    assert sum(reading in samples for reading in readings) == len(readings) == 100
    assert not played.wire.counters["dropped_readings"]


@pytest.mark.parametrize("baud", [9_600, 57_600, 115_200])
def test_all_bytes_pass_both_ways(baud):
    data = bytes(range(256)) + b"\xff\xff\x00"
    with opened(fp.Serial(baud=baud)) as port, serial.Serial(FAR, baud, timeout=5) as driver:
        port.poll()
        assert port.write(data) and driver.read(len(data)) == data
        driver.write(data)
        assert received(port, len(data)) == data


def test_a_speed_that_the_uart_cannot_make_is_refused_with_both_numbers():
    """A 16550A with a clock of 1.8432 MHz makes 115200 of 250000, and reports no error."""
    with pytest.raises(TransportError, match="makes 115200 bit/s of 250000"):
        opened(fp.Serial(baud=250_000))


def test_a_second_program_is_refused():
    with opened(), pytest.raises((serial.SerialException, OSError)):
        serial.Serial(NEAR, 115_200, exclusive=True)


def test_a_node_without_a_uart_says_so():
    with pytest.raises(TransportError, match="no UART behind it"):
        opened(path="/dev/ttyS3")


def test_closing_never_waits_for_bytes_that_nobody_takes():
    port = opened()
    port.poll()
    for _ in range(100):
        port.write(bytes(200))
    began = time.monotonic()
    port.close()
    assert time.monotonic() - began < 2


def test_a_port_is_opened_again_after_it_was_closed():
    port = opened()
    assert Opened() in port.poll()
    port.close()
    assert Closed() not in port.poll()
    port.open()
    assert Opened() in port.poll()
    port.close()


def test_frames_fill_the_line_and_never_overfill_it():
    """The wire hands over the next frame when the last bit of the one before goes, as by the line's own time."""
    frame, count, baud, few = struct.pack("<I", 7) * 25, 100, 115_200, 5
    truth = Truth()
    wire = Wire(transports.create(f"serial:{NEAR}"), fp.Serial(baud=baud), truth=truth, backlog_ns=10**10)
    with serial.Serial(FAR, baud, timeout=0.5) as driver:
        wire.open()
        start = time.monotonic_ns()
        wire.receive(0)
        for _ in range(count):
            wire.send([frame], 0, "skin")
        data, lost = b"", 0
        while len(data) < (count - lost) * len(frame) and (now := time.monotonic_ns() - start) < 3 * 10**10:
            wire.flush(now)
            data += driver.read(driver.in_waiting)
            lost = wire.counters["dropped_unread"]  # where a busy machine makes the UART slower than its line
        wire.close()
    assert data == (count - lost) * frame
    ends = np.array([t_ns for t_ns, _, _ in truth.frames])
    frame_ns = len(frame) * 10 * 10**9 / baud
    assert ends[-1] >= 0.999 * len(ends) * frame_ns, "never more than the line carries"
    shares = few * frame_ns / (ends[few:] - ends[:-few])
    print(f"{baud} bit/s is filled to {len(ends) * frame_ns / ends[-1]:.2%}, {lost} of {count} frames were dropped")
    assert shares.max() >= 0.99, "without a gap, unless the machine is busy all the time"
