"""Replay to a driver, and recording from one's port: the other side is pyserial or python-can, unmodified."""

import math
import os
import threading
import time
import tty

import can
import numpy as np
import pytest
import serial

from firmware_protocols import CanFrame
from tactemu.base.clock import RealClock, VirtualClock
from tactemu.base.errors import TactemuError, TransportError
from tactemu.emulator.replay import Replay, connector_for, line_note, record
from tactemu.transports import create
from tactemu.truth.recorder import Recorder
from tactemu.truth.recording import Recording, load
from tactemu.wire.wire import Wire
from tests.truth.telling import passed

STREAM = Recording([passed(k * 20_000_000, bytes([k]) * 10) for k in range(20)])


def replay(recording, port, **options):
    clock = options.pop("clock", None) or VirtualClock()
    wire = Wire(create(port), connector_for(recording), pacing=False, faults=options.pop("faults", ()))
    wire.open()
    return Replay(recording, wire, clock=clock, **options), wire, clock


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0, math.inf])
def test_speed(speed):
    player, wire, _ = replay(STREAM, "memory:", speed=speed)
    seen = []
    while not player.is_done:
        player.step()
        seen += [(player.now_ns, frame) for frame in wire.transport.driver.read()]
    assert [frame for _, frame in seen] == [entry.frame for entry in STREAM.entries]
    assert [t for t, _ in seen] == [round(entry.t_ns / speed) for entry in STREAM.entries]


def test_a_late_loop_sends_what_it_owes_and_loses_nothing():
    """Stall the machine for 300 ms: fifteen frames are overdue at once."""
    player, wire, _ = replay(STREAM, "memory:")
    player.turn(0)
    player.turn(300_000_000)
    assert wire.transport.driver.read() == [entry.frame for entry in STREAM.entries[:16]]
    assert not wire.counters["dropped_readings"]


def test_stepwise():
    player, wire, _ = replay(STREAM, "memory:")
    wire.receive(0)
    for entry in STREAM.entries:
        assert player.send_next(7) == entry
        wire.flush(7)
        assert wire.transport.driver.read() == [entry.frame]
    assert player.send_next(7) is None and player.is_done


def test_looping_and_only_the_drivers_side():
    recording = Recording([passed(0, b"a"), passed(1_000_000, b"request", "rx"), passed(2_000_000, b"b")])
    player, wire, _ = replay(recording, "memory:", loop=True)
    player.run(seconds=0.0101)
    got = wire.transport.driver.read()
    assert got[:4] == [b"a", b"b", b"a", b"b"] and set(got) == {b"a", b"b"}
    with pytest.raises(TactemuError, match="nothing that goes to a driver"):
        replay(Recording([passed(0, b"x", "rx")]), "memory:")


def test_faults_apply_to_a_replay():
    player, wire, _ = replay(STREAM, "memory:", faults=["drop every 2"])
    player.run()
    assert wire.transport.driver.read() == [entry.frame for entry in STREAM.entries[::2]]


def test_true_time_on_a_pty_from_the_moment_the_driver_opens_it():
    player, wire, _ = replay(STREAM, "pty:", clock=RealClock())
    thread = threading.Thread(target=player.run)
    thread.start()
    try:
        time.sleep(0.1)
        with serial.Serial(wire.transport.address, 115_200, timeout=30) as driver:
            start = time.monotonic()
            got = driver.read(190)
            took = time.monotonic() - start
            driver.timeout = 0.3
            got += driver.read(10)
        whole = b"".join(entry.frame for entry in STREAM.entries)
        assert whole.endswith(got) and len(got) >= 190, "pyserial throws away what is there when it opens"
        assert took > 0.33, "no machine is so busy that time passes faster"
        thread.join(30)
        assert not thread.is_alive()
    finally:
        player.stop()
        thread.join()
        wire.close()


class CountingRecorder(Recorder):
    """Knows how many bytes it has: how the kernel cuts them into entries is its own affair."""

    bytes = 0

    def add(self, entry):
        self.bytes += len(entry.frame)
        super().add(entry)


def test_what_a_port_sends_is_recorded(tmp_path):
    """Record from the port that a replay feeds: the copy has the same bytes and about the same timing."""
    player, wire, clock = replay(STREAM, "pty:", clock=RealClock())
    thread = threading.Thread(target=player.run)
    size = sum(len(entry.frame) for entry in STREAM.entries)

    def stop(_):
        """Start the thread on the first call, when pyserial has opened the port and discarded its data."""
        if thread.ident is None:
            thread.start()
        return recorder.bytes >= size

    try:
        with CountingRecorder(tmp_path / "x.jsonl", line="baud 115200") as recorder:
            record(wire.transport.address, recorder, clock=clock, stop=stop)
        copy = load(tmp_path / "x.jsonl")
        assert b"".join(e.frame for e in copy.entries) == b"".join(e.frame for e in STREAM.entries)
        late = [entry.t_ns - 20_000_000 * entry.frame[-1] for entry in copy.entries]
        assert np.median(late) - min(late) < 50e6, "not all at once, nor at another pace; it may be late"
    finally:
        player.stop()
        if thread.ident is not None:
            thread.join()
        wire.close()


def test_what_a_bus_carries_is_recorded(tmp_path):
    frames = [CanFrame(arbitration_id=0x100 + k, data=bytes([k])) for k in range(10)]
    bus = can.Bus(interface="virtual", channel="recorded")

    def send():
        time.sleep(0.1)
        for frame in frames:
            bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False))

    thread = threading.Thread(target=send)
    thread.start()
    with Recorder(tmp_path / "x.blf") as recorder:
        record("can:virtual:recorded", recorder, clock=RealClock(), stop=lambda n: n >= 10)
    thread.join()
    bus.shutdown()
    assert [entry.frame for entry in load(tmp_path / "x.blf").entries] == frames


@pytest.mark.parametrize(
    ("source", "baud", "line"),
    [
        ("/dev/ttyUSB0", None, "baud 115200"),
        ("/dev/ttyS3", 9600, "baud 9600"),
        ("/dev/ttyACM0", None, "usb"),
        ("socket://10.0.0.1:4000", None, "usb"),
        ("/dev/ttyACM0", 460_800, "baud 460800"),
        ("can:socketcan:can0", None, ""),
    ],
)
def test_only_a_uart_has_a_speed(source, baud, line, tmp_path):
    assert line_note(source, baud) == line
    with Recorder(tmp_path / "x.mcap", line=line) as recorder:
        recorder.add(passed(0, b"frame"))
    assert connector_for(load(tmp_path / "x.mcap")).usb is not line.startswith("baud")


def test_a_full_disk_blames_the_file_not_the_source(tmp_path):
    """Record to the kernel's own full disk."""
    (tmp_path / "x.jsonl").symlink_to("/dev/full")
    port, far = os.openpty()
    tty.setraw(far)

    def stop(_):
        os.write(port, bytes(1000))
        return time.monotonic() > deadline

    deadline = time.monotonic() + 20
    try:
        with (
            pytest.raises(TactemuError, match=r"x\.jsonl: cannot write the recording: No space left on device"),
            Recorder(tmp_path / "x.jsonl") as recorder,
        ):
            record(os.ttyname(far), recorder, clock=RealClock(), stop=stop)
    finally:
        os.close(port)
        os.close(far)


@pytest.mark.parametrize("suffix", [".mcap", ".jsonl", ".log", ".asc"])
def test_a_disk_that_is_full_at_the_end(tmp_path, suffix, caplog):
    """Record so little that it is written when the file is closed."""
    (tmp_path / f"x{suffix}").symlink_to("/dev/full")
    recorder = Recorder(tmp_path / f"x{suffix}")
    with pytest.raises(TactemuError, match="cannot write the recording: No space left on device"):
        recorder.add(passed(0, CanFrame(arbitration_id=1)))
        recorder.close()
    assert not caplog.records, "an error that is raised is not said twice"
    recorder.close()


def test_a_source_that_is_not_there(tmp_path):
    def attempt(name):
        with Recorder(tmp_path / name) as recorder, pytest.raises(TransportError, match="check its name"):
            record("/dev/no-such-tty", recorder, clock=RealClock(), stop=lambda n: False)

    attempt("new.jsonl")
    (tmp_path / "old.jsonl").write_text(hour := '{"kind": "an hour of work"}\n')
    attempt("old.jsonl")
    assert [path.name for path in tmp_path.iterdir()] == ["old.jsonl"]
    assert (tmp_path / "old.jsonl").read_text() == hour


def test_timing_of_random_entries_is_kept_to_the_nanosecond():
    times = np.cumsum(np.random.default_rng(4).integers(1, 10**7, 50))
    recording = Recording([passed(int(t), bytes([k])) for k, t in enumerate(times)])
    player, wire, _ = replay(recording, "memory:")
    seen = []
    while not player.is_done:
        player.step()
        seen += [player.now_ns] * len(wire.transport.driver.read())
    assert seen == [int(t) for t in times]
