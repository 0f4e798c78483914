"""On real Linux CAN, the kernel and can-utils judge: what arrives, in which order, and how busy the bus is."""

import re
import select
import subprocess
import time

import can
import numpy as np
import pytest

from firmware_protocols import CanFrame, CanWire
from tactemu.clock import RealClock
from tactemu.transports import create
from tactemu.transports.transport import Received
from tactemu.wire import Wire

pytestmark = pytest.mark.vcan

FRAMES = [
    CanFrame(arbitration_id=0x123, data=b"\x01\x02"),
    CanFrame(arbitration_id=0x1ABCDEF0, data=b"12345678", is_extended_id=True),
    CanFrame(arbitration_id=0x7FF, is_remote_frame=True),
    CanFrame(arbitration_id=0x10, data=bytes(range(64)), is_fd=True, bitrate_switch=True),
    CanFrame(arbitration_id=0x11, data=bytes(12), is_fd=True),
]


@pytest.fixture
def port():
    with create("can:socketcan:vcan0") as port:
        yield port


def play(wire, clock, seconds, feed):
    """The loop in small: ``feed(now)`` queues what is due and returns when it wants to be asked next."""
    end = clock.now_ns() + round(seconds * 1e9)
    while (now := clock.now_ns()) < end:
        again = feed(now)
        wire.receive(now)
        wire.flush(now)
        due = wire.next_due_ns()
        clock.wait(min(end, again, end if due is None else due), wire.filenos())


@pytest.mark.parametrize("frame", FRAMES, ids=str)
def test_frames_cross_unchanged_and_do_not_come_back(port, frame):
    with can.Bus(interface="socketcan", channel="vcan0", fd=True) as driver:
        assert port.write(frame)
        message = driver.recv(2)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (frame.arbitration_id, frame.data)
        assert (message.is_fd, message.is_remote_frame) == (frame.is_fd, frame.is_remote_frame)
        assert (message.is_extended_id, message.bitrate_switch) == (frame.is_extended_id, frame.bitrate_switch)
        assert port.poll() == []
        message.arbitration_id ^= 1
        driver.send(message)
        select.select(port.filenos(), [], [], 2)
        (event,) = port.poll()
        assert isinstance(event, Received) and event.data.arbitration_id == frame.arbitration_id ^ 1
        assert event.data.data == frame.data


def test_candump_prints_what_was_sent(port):
    classic = FRAMES[:3]
    dump = subprocess.Popen(["candump", "-L", "-n", str(len(classic)), "vcan0"], stdout=subprocess.PIPE, text=True)
    time.sleep(0.3)
    for frame in classic:
        port.write(frame)
    out, _ = dump.communicate(timeout=10)
    assert [line.split()[2] for line in out.splitlines()] == [str(frame) for frame in classic]


@pytest.mark.parametrize(("asked", "bitrate"), [(0.5, 250_000), (1.5, 250_000), (0.5, 500_000)])
def test_canbusload_agrees_with_the_computed_load(port, asked, bitrate):
    """Two nodes send random frames for ``asked`` times what the bus can carry."""
    rng = np.random.default_rng(7)
    wire, clock = Wire(port, CanWire(bitrate=bitrate)), RealClock()
    period = round(2 * 114.3e9 / bitrate / asked)
    due = [0]

    def feed(now):
        while due[0] <= now:
            for node, base in (("low", 0x100), ("high", 0x300)):
                ident = base + int(rng.integers(0x100))
                wire.send([CanFrame(arbitration_id=ident, data=rng.bytes(8))], due[0], node)
            due[0] += period
        return due[0]

    judge = subprocess.Popen(
        ["stdbuf", "-oL", "canbusload", "-e", f"vcan0@{bitrate}"], stdout=subprocess.PIPE, text=True
    )
    play(wire, clock, 1.2, feed)
    before, busy = clock.now_ns(), wire.line.busy_ns
    play(wire, clock, 4.0, feed)
    computed = (wire.line.busy_ns - busy) / (clock.now_ns() - before)
    judge.terminate()
    out, _ = judge.communicate(timeout=10)
    bits = [int(match[2]) for match in re.finditer(r"vcan0@\d+ +(\d+) +(\d+)", out)][1:]  # the first second is not full
    assert len(bits) >= 3, out
    load = np.array(bits[:4]) / bitrate
    assert load.mean() == pytest.approx(computed, rel=0.01)
    assert load.mean() <= min(asked, 1.0) * 1.01  # less on a machine too busy to keep up
    assert load.mean() >= min(asked, 1.0) * 0.5
    if asked > 1:
        assert wire.counters["dropped_readings"] > 0


def test_the_lowest_identifier_goes_first_and_nodes_keep_their_order(port):
    """Three nodes offer their frames at the same instant, highest identifier first."""
    wire, clock = Wire(port, CanWire(bitrate=250_000)), RealClock()
    readings = {
        ident: [CanFrame(arbitration_id=ident, data=bytes([k])) for k in range(4)] for ident in (0x500, 0x300, 0x40)
    }
    with can.Bus(interface="socketcan", channel="vcan0") as driver:
        for ident, frames in readings.items():
            wire.send(frames, 0, f"node {ident:x}")
        play(wire, clock, 0.05, lambda now: now + 10**9)
        got = [driver.recv(1) for _ in range(12)]
    assert [(m.arbitration_id, m.data[0]) for m in got if m] == [(i, k) for i in (0x40, 0x300, 0x500) for k in range(4)]
    gaps = np.diff([m.timestamp for m in got if m])
    assert np.median(gaps) == pytest.approx(55 / 250_000, rel=0.5)


def test_an_fd_frame_on_a_classic_interface_is_dropped_not_fatal(port):
    subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
    try:
        assert not port.write(FRAMES[0]), "interface down"
        assert port.poll() == []
        subprocess.run(["ip", "link", "set", "vcan0", "mtu", "16"], check=True)
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        assert port.write(FRAMES[0]) and not port.write(FRAMES[3])
    finally:
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        subprocess.run(["ip", "link", "set", "vcan0", "mtu", "72", "up"], check=True)
