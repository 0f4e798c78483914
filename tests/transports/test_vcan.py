"""Tests on real Linux CAN, judged by the kernel and can-utils: arrivals, their order, and the load of the bus."""

import os
import re
import select
import socket
import struct
import subprocess
import time

import can
import numpy as np
import pytest

from firmware_protocols import Can, CanFrame
from tactemu.base.clock import RealClock
from tactemu.base.errors import TransportError
from tactemu.transports import create
from tactemu.transports.can_link import CanLink
from tactemu.transports.transport import Closed, Opened, Received
from tactemu.wire.can_bits import frame_bits
from tactemu.wire.line import MAX_CATCH_UP_NS
from tactemu.wire.wire import ReceivedData, Wire

pytestmark = pytest.mark.vcan
ETHERNET = os.environ.get("VCAN_GUEST") == "preload"
"""True in a view whose CAN interfaces are ends of veth pairs, from which the preload library makes CAN."""

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
    """Run a small loop: ``feed(now)`` queues what is due and returns the time of its next call."""
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


def test_an_error_frame_is_seen_as_one(port):
    """Receive the `error` fault's frames as SocketCAN reports errors of the bus."""
    with can.Bus(interface="socketcan", channel="vcan0") as driver:
        assert port.write(CanFrame(arbitration_id=0x28, data=bytes(8), is_error_frame=True))
        message = driver.recv(2)
    assert message is not None and message.is_error_frame and message.arbitration_id == 0x8


def test_error_frames_of_a_real_controller_are_counted_and_frames_still_come(monkeypatch):
    """The kernel hands out error frames of a controller as it does those that a program sends on vcan."""
    link = CanLink("can", 1_000_000, state="ERROR-ACTIVE", queue_length=1000)
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: link)
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as controller:
        controller.bind(("vcan0",))
        port = create("can:socketcan:vcan0")
        device = Can(filters=((0x123, 0x7FF),))
        wire = Wire(port, device)
        wire.attach("skin", device)
        wire.open()
        assert port.is_paced
        for identifier, details in ((0x02, b""), (0x24, b"\0\x20"), (0x02, b"")):
            controller.send(struct.pack("=IB3x8s", 1 << 29 | identifier, 8, details))
        controller.send(struct.pack("=IB3x8s", 0x123, 1, b"x"))
        frames, end = [], time.monotonic() + 2
        while not frames and time.monotonic() < end:
            frames = [event for event in wire.receive(0) if isinstance(event, ReceivedData)]
            wire.flush(0)
        wire.close()
    assert [frame.data.data for frame in frames] == [b"x"]
    assert {name: wire.counters[name] for name in ("arbitration_lost", "error_passive", "unacknowledged")} == {
        "arbitration_lost": 2, "error_passive": 1, "unacknowledged": 1,
    }  # fmt: skip


def test_two_emulators_and_another_node_hear_each_other_on_one_real_bus(monkeypatch):
    """A bus that paces itself: neither emulator waits for the frames of the other, which the bus has done."""
    link = CanLink("can", 1_000_000, state="ERROR-ACTIVE", queue_length=1000)
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: link)
    wires, heard = [Wire(create("can:socketcan:vcan0"), Can()) for _ in range(2)], [[], []]
    with can.Bus(interface="socketcan", channel="vcan0") as node:
        for k, wire in enumerate(wires):
            wire.open()
            wire.send([CanFrame(arbitration_id=0x100 + k, data=bytes([j])) for j in range(20)], 0, "skin")
        node.send(can.Message(arbitration_id=0x200, data=[7], is_extended_id=False))
        start, end = time.monotonic_ns(), time.monotonic() + 5
        while min(map(len, heard)) < 21 and time.monotonic() < end:
            for wire, frames in zip(wires, heard):
                now = time.monotonic_ns() - start
                frames += [event.data for event in wire.receive(now) if isinstance(event, ReceivedData)]
                wire.flush(now)
        got = [message for _ in range(40) if (message := node.recv(1))]
        for wire in wires:
            wire.close()
    for k, frames in enumerate(heard):
        peer = [frame.data[0] for frame in frames if frame.arbitration_id == 0x101 - k]
        assert peer == list(range(20)) and sum(frame.arbitration_id == 0x200 for frame in frames) == 1
    for k in range(2):
        assert [message.data[0] for message in got if message.arbitration_id == 0x100 + k] == list(range(20))


def test_candump_prints_what_was_sent(port):
    classic = FRAMES[:3]
    dump = subprocess.Popen(["candump", "-L", "-n", str(len(classic)), "vcan0"], stdout=subprocess.PIPE, text=True)
    time.sleep(0.3)
    for frame in classic:
        port.write(frame)
    out, _ = dump.communicate(timeout=10)
    assert [line.split()[2] for line in out.splitlines()] == [str(frame) for frame in classic]


@pytest.mark.parametrize(("asked", "bitrate"), [(0.5, 250_000), (1.5, 250_000), (0.5, 500_000)])
def test_canbusload_counts_the_same_bits_and_the_bus_is_never_overfull(port, asked, bitrate, tmp_path):
    """Let two nodes send random frames for ``asked`` times what the bus can carry, for four seconds."""
    rng = np.random.default_rng(7)
    wire, clock = Wire(port, Can(bitrate=bitrate)), RealClock()
    period = round(2 * 114.3e9 / bitrate / asked)
    due = [0]

    def feed(now):
        due[0] = max(due[0], now - 10 * period)  # what a busy machine has missed is not made up for
        while due[0] <= now:
            for node, base in (("low", 0x100), ("high", 0x300)):
                ident = base + int(rng.integers(0x100))
                wire.send([CanFrame(arbitration_id=ident, data=rng.bytes(8))], due[0], node)
            due[0] += period
        return due[0]

    with (tmp_path / "load").open("w+") as said, (tmp_path / "dump").open("w+") as dumped:
        judge = subprocess.Popen(["stdbuf", "-oL", "canbusload", "-e", f"vcan0@{bitrate}"], stdout=said)
        dump = subprocess.Popen(["candump", "-L", "vcan0"], stdout=dumped)
        time.sleep(0.5)
        play(wire, clock, 4.5, feed)
        for each in (judge, dump):
            each.terminate()
            each.wait(10)
        said.seek(0)
        dumped.seek(0)
        windows = [(int(m[1]), int(m[2])) for m in re.finditer(r"vcan0@\d+ +(\d+) +(\d+)", said.read())]
        times = np.array([float(line.split()[0][1:-1]) for line in dumped.read().splitlines()[:-1]])

    # Bits: canbusload's windows cut the sequence of frames into pieces; each piece must have its bits exactly. Its
    # alarm may come between the two counters of a frame, whose bits then belong to the next window.
    bits = np.array([frame_bits(frame)[0] for _, _, frame in wire.truth.frames])
    ends = np.cumsum([count for count, _ in windows])
    assert len(windows) >= 4 and ends[-1] > 500
    total = np.concatenate([[0], np.cumsum(bits)])
    for end, used in zip(ends, np.cumsum([used for _, used in windows])):
        assert used in (total[end - 1], total[end])

    # Pace: no stretch of 100 frames takes less time than its bits, but for what a stalled loop may catch up.
    busy = np.convolve(bits[: len(times)], np.ones(100), "valid")[1:] / bitrate
    assert (times[100:] - times[:-100] >= busy - MAX_CATCH_UP_NS / 1e9 - 0.005).all()
    load = np.mean([used for _, used in windows[1:4]]) / bitrate
    assert load <= min(asked, 1.0) * 1.02
    if asked > 1:
        assert wire.counters["dropped_readings"] > 0


def test_the_lowest_identifier_goes_first_and_nodes_keep_their_order(port):
    """Offer frames of three nodes at the same instant, highest identifier first."""
    wire, clock = Wire(port, Can(bitrate=250_000)), RealClock()
    readings = {
        ident: [CanFrame(arbitration_id=ident, data=bytes([k])) for k in range(4)] for ident in (0x500, 0x300, 0x40)
    }
    with can.Bus(interface="socketcan", channel="vcan0") as driver:
        start, wall = clock.now_ns() + 20_000_000, time.time() + 0.02
        for ident, frames in readings.items():
            wire.send(frames, start, f"node {ident:x}")
        play(wire, clock, 0.2, lambda now: now + 10**9)
        got = [message for _ in range(12) if (message := driver.recv(1))]
    assert [(m.arbitration_id, m.data[0]) for m in got] == [(i, k) for i in (0x40, 0x300, 0x500) for k in range(4)]
    arrived = np.array([message.timestamp for message in got]) - wall
    shortest = 55 / 250_000  # one byte of data, no stuff bits; a busy machine may be late, never early
    assert np.all(arrived > shortest * np.arange(1, 13) - 1e-4)


def test_an_fd_frame_on_a_classic_interface_is_dropped_not_fatal(port):
    subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
    try:
        assert not port.write(FRAMES[0]), "interface down"
        assert port.poll() == []
        with pytest.raises(TransportError, match="ip link set vcan0 up"):
            create("can:socketcan:vcan0").open()
        subprocess.run(["ip", "link", "set", "vcan0", "mtu", "68" if ETHERNET else "16"], check=True)
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        assert port.write(FRAMES[0]) and not port.write(FRAMES[3])
        with pytest.raises(TransportError, match=r"vcan0 carries no CAN-FD .* mtu 72 up"):
            other = create("can:socketcan:vcan0")
            other.set_connector(Can(data_bitrate=5_000_000))
            other.open()
    finally:
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        subprocess.run(["ip", "link", "set", "vcan0", "mtu", "72", "up"], check=True)


def test_an_interface_that_is_deleted_and_made_again():
    def link(*words):
        subprocess.run(["ip", "link", *words], check=True)

    def make():
        if ETHERNET:
            link("add", "vcan7", "type", "veth", "peer", "name", "far.vcan7")
            link("set", "far.vcan7", "up")
        else:
            link("add", "dev", "vcan7", "type", "vcan")
        link("set", "vcan7", "mtu", "72", "up")

    make()
    try:
        with create("can:socketcan:vcan7") as port:
            link("del", "vcan7")
            assert poll_until(port, Closed()) and not port.write(FRAMES[0])
            make()
            assert poll_until(port, Opened())
            with can.Bus(interface="socketcan", channel="vcan7") as driver:
                assert port.write(FRAMES[0])
                assert driver.recv(2).arbitration_id == FRAMES[0].arbitration_id
    finally:
        subprocess.run(["ip", "link", "del", "vcan7"], check=False)


def poll_until(port, event):
    end = time.monotonic() + 2
    while time.monotonic() < end:
        if event in port.poll():
            return True
        time.sleep(0.001)
    return False
