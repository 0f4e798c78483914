"""A wire has a speed: when frames leave, what does not fit, and how the driver's data share the line."""

from types import SimpleNamespace

import numpy as np
import pytest

from firmware_protocols import USB, Can, CanFrame, Rs485, Sent, Serial
from tactemu.transports.memory import MAX_WAITING_CHUNKS, MemoryTransport
from tactemu.transports.transport import DROPPED, MAX_CHUNK_BYTES, RAISED, Closed, Opened
from tactemu.truth import Truth
from tactemu.truth.entries import Passage
from tactemu.tune.speed.wire import run
from tactemu.wire.can_bits import frame_ns
from tactemu.wire.line import Line
from tactemu.wire.line_models.serial import SerialLine
from tactemu.wire.wire import DRIVER, ReceivedData, Wire

UART = Serial(baud=115_200)
FRAME = bytes(range(82))
FRAME_NS = round(82 * 10 * 1e9 / 115_200)


def plugged(spec, **options):
    wire = Wire(MemoryTransport(), spec, **options)
    wire.open()
    assert wire.receive(0) == [Opened(), RAISED]
    return wire, wire.transport.driver


def run_until(wire, end_ns):
    """Play the loop: go from one due time to the next; returns ``(time, frame)`` as the driver sees them."""
    seen, now = [], 0
    while True:
        wire.receive(now)
        wire.flush(now)
        seen += [(now, frame) for frame in wire.transport.driver.read()]
        due = wire.next_due_ns()
        if due is None or due > end_ns:
            return seen
        now = max(now, due)


@pytest.mark.parametrize("usb", [False, USB(0x10C4, 0xEA60, node="ttyUSB")], ids=["uart", "bridge"])
def test_a_frame_is_there_when_its_last_bit_is(usb):
    wire, driver = plugged(Serial(baud=115_200, usb=usb))
    wire.send([FRAME], 1_000_000)
    wire.flush(1_000_000)
    assert wire.next_due_ns() == 1_000_000 + FRAME_NS
    wire.flush(1_000_000 + FRAME_NS - 1)
    assert driver.read() == []
    assert wire.flush(1_000_000 + FRAME_NS) == 1
    assert driver.read() == [FRAME]


@pytest.mark.parametrize("spec", [UART, Can(bitrate=1_000_000)], ids=["uart", "can"])
def test_a_frame_tells_by_how_much_the_loop_was_late(spec):
    """Count neither the line's time nor a fault's delay as lateness."""
    frame = FRAME if spec is UART else CanFrame(arbitration_id=0x123, data=b"12345678")
    told, truth = [], Truth()
    truth.tap(SimpleNamespace(put=told.append))
    wire = Wire(MemoryTransport(), spec, truth=truth, faults=["late frame 2 by 9ms"])
    wire.open()
    for k, late_ns in enumerate((0, 0, 3_000_000)):
        now = 100_000_000 * k
        wire.send([frame], now)
        wire.flush(now)
        while (due := wire.next_due_ns()) is not None:
            now = due + late_ns
            wire.flush(now)
    assert [entry.late_ns for entry in told if isinstance(entry, Passage)] == [0, 0, 3_000_000]


@pytest.mark.parametrize("pacing", [True, "strict"])
def test_after_a_stall_a_strict_line_keeps_its_bit_time(pacing):
    wire, driver = plugged(UART, pacing=pacing)
    for k in range(3):
        wire.send([b"%d" % k], k * 1_000_000)
    late = 4_000_000
    wire.flush(late)
    if pacing is True:
        assert driver.read() == [b"0", b"1", b"2"], "all that the line had time for"
        return
    byte = round(10e9 / 115_200)
    assert driver.read() == [b"0"]
    for k in (1, 2):
        assert wire.next_due_ns() == late + k * byte
        wire.flush(late + k * byte)
        assert driver.read() == [b"%d" % k]


@pytest.mark.parametrize(("spec", "bits"), [(UART, 10), (Serial(baud=115_200, parity="E", stopbits=2), 12)])
def test_bits_per_byte(spec, bits):
    wire, _ = plugged(spec)
    wire.send([b"x"], 0)
    wire.flush(0)
    assert wire.next_due_ns() == round(bits * 1e9 / 115_200)


@pytest.mark.parametrize("spec", [Serial(baud=115_200, usb=True), UART])
def test_usb_and_an_unpaced_line_take_no_time(spec):
    wire, driver = plugged(spec, pacing=spec.usb)
    wire.send([FRAME, FRAME], 5)
    assert wire.flush(5) == 2
    assert driver.read() == [FRAME, FRAME]


def test_a_reading_that_does_not_fit_is_dropped_whole_and_nothing_queues_without_bound():
    wire, driver = plugged(UART)  # 140 frames/s fit
    reading = [FRAME, FRAME]
    sent = []
    for now in range(0, 2_000_000_000, 5_000_000):
        wire.send(reading, now)
        while (due := wire.next_due_ns()) is not None and due <= now + 5_000_000:
            wire.flush(due)
            sent += driver.read()
    rate = 115_200 / 820
    assert wire.counters["dropped_readings"] == pytest.approx(400 - 2 * rate / 2, abs=5)
    assert wire.counters["dropped_frames"] == 2 * wire.counters["dropped_readings"]
    assert len(sent) == pytest.approx(2 * rate, abs=1)
    assert wire.next_due_ns() - 2_000_000_000 < 2 * FRAME_NS


def test_a_stall_of_the_loop_makes_no_burst():
    wire, driver = plugged(UART, backlog_ns=10**12)
    for _ in range(100):
        wire.send([FRAME], 0)
    wire.flush(0)
    wire.flush(500_000_000)  # 70 frames late
    assert len(driver.read()) <= 2


@pytest.mark.parametrize("spec", [Serial(baud=115_200, usb=True), Can()])
def test_readings_that_a_stalled_loop_owes_are_not_dropped(spec):
    """Stall a loop for 300 ms with 15 readings due, of a device with a long delay, while the line is idle."""
    wire, driver = plugged(spec)
    wire.is_real_time = True
    wire.flush(0)
    frames = [CanFrame(arbitration_id=k, data=b"x") if isinstance(spec, Can) else bytes([k]) for k in range(15)]
    for k, frame in enumerate(frames):
        wire.send([frame], (k + 1) * 20_000_000, "pad")
    wire.flush(300_000_000)
    wire.flush(310_000_000)
    assert driver.read() == frames and not wire.counters["dropped_readings"]


def test_a_delayed_answer_does_not_hold_up_what_comes_after_it():
    wire, _ = plugged(UART)
    wire.send([Sent(b"late", delay_ns=50_000_000)], 0)
    wire.send([b"soon"], 1_000_000)
    times = {frame: now for now, frame in run_until(wire, 10**9)}
    byte_ns = 10 * 1e9 / 115_200
    assert times[b"soon"] == round(1_000_000 + 4 * byte_ns)
    assert times[b"late"] == round(50_000_000 + 4 * byte_ns)


def test_requests_take_their_time_too():
    wire, driver = plugged(UART)
    driver.write(b"12345678")
    assert wire.receive(0) == []
    assert wire.next_due_ns() == round(80e9 / 115_200)
    assert wire.receive(wire.next_due_ns()) == [ReceivedData(b"12345678")]
    driver.write(b"bye")
    driver.close()
    assert wire.receive(10**9) == [ReceivedData(b"bye"), Closed(), DROPPED]


def test_on_a_half_duplex_line_too_the_last_bytes_of_a_driver_are_received():
    wire, driver = plugged(Rs485(baud=115_200))
    wire.send([FRAME], 0)
    driver.write(b"first")
    assert wire.receive(0) == []
    driver.write(b"bye")
    driver.close()
    heard = wire.receive(1000)
    assert [event.data for event in heard if isinstance(event, ReceivedData)] == [b"first", b"bye"]
    assert heard[-2:] == [Closed(), DROPPED] and wire.next_due_ns() is None
    assert wire.counters["unheard"] == 1, "what the device was about to say"


def test_a_line_that_has_settled_is_free_at_once():
    """Settle a line while a frame of 7 ms is on it, as a request to a paused device does: the next starts then."""
    line = Line(SerialLine(UART))
    for frame in (FRAME, b"x"):
        line.put(frame, 0, "pad")
    assert line.take(0) is None and line.next_ns() == FRAME_NS
    assert [(each.frame, each.end_ns) for each in line.settle(1_000_000)] == [(FRAME, 1_000_000), (b"x", 1_000_000)]
    assert line.next_ns() is None and line.waiting_ns("pad") == 0
    line.put(FRAME, 1_000_000, "pad")
    assert line.take(1_000_000) is None and line.next_ns() == 1_000_000 + FRAME_NS


def test_nobody_listens():
    wire, driver = plugged(UART)
    wire.send([FRAME] * 3, 0)
    driver.close()
    assert wire.receive(1) == [Closed(), DROPPED]
    wire.send([FRAME], 2)
    assert wire.counters["unheard"] == 4 and wire.next_due_ns() is None


# -- CAN -------------------------------------------------------------------------------------------------------------


def random_frames(rng, base, count):
    return [CanFrame(arbitration_id=base + int(rng.integers(64)), data=rng.bytes(8)) for _ in range(count)]


def test_frames_leave_at_exact_bit_time_and_never_overlap():
    rng = np.random.default_rng(1)
    wire, _ = plugged(Can())
    frames = random_frames(rng, 0x100, 50)
    wire.send(frames, 1000)
    seen = run_until(wire, 10**9)
    assert [frame for _, frame in seen] == frames
    assert [now for now, _ in seen] == list(1000 + np.cumsum([frame_ns(frame, 1_000_000) for frame in frames]))
    assert wire.line.busy_ns == seen[-1][0] - 1000


def test_the_lowest_identifier_wins_whenever_the_bus_falls_idle():
    """Let three nodes send; the low one is ready only while the high one's first frame is on the bus."""
    wire, _ = plugged(Can())
    high, low, middle = (CanFrame(arbitration_id=i, data=bytes(8)) for i in (0x700, 0x001, 0x400))
    wire.send([high, high], 0, "high")
    wire.flush(0)  # an idle bus: it starts at once
    wire.send([middle], 10_000, "middle")
    wire.send([low], 20_000, "low")
    assert [frame for _, frame in run_until(wire, 10**9)] == [high, low, middle, high]


def test_a_saturated_bus_is_full_and_starves_the_highest_identifier():
    rng = np.random.default_rng(2)
    wire, _ = plugged(Can())
    ids = {"a": 0x100, "b": 0x300, "c": 0x500}
    times = []
    for now in range(0, 1_000_000_000, 1_000_000):
        for node, base in ids.items():
            wire.send(random_frames(rng, base, 4), now, node)
        while (due := wire.next_due_ns()) is not None and due < now + 1_000_000:
            wire.flush(due)
            times += [due] * len(wire.transport.driver.unread)
            seen = wire.transport.driver.read()
            assert all(isinstance(frame, CanFrame) for frame in seen)
    assert wire.line.busy_ns / 1e9 == pytest.approx(1.0, abs=0.01)
    assert wire.counters["sent"] == pytest.approx(1e6 / 114.3, rel=0.01)
    assert np.diff(sorted(times)).min() >= 111_000
    assert wire.counters["dropped_readings"] > 700


def test_requests_of_the_driver_share_the_bus():
    wire, driver = plugged(Can())
    request = CanFrame(arbitration_id=0x28, data=b"\xb1\xc6")
    answer = CanFrame(arbitration_id=0x28, data=bytes(8))
    wire.send([answer], 0)
    wire.flush(0)
    driver.write(request)
    assert wire.receive(10_000) == []
    first = frame_ns(answer, 1_000_000)
    assert wire.flush(first) == 1
    assert wire.next_due_ns() == first + frame_ns(request, 1_000_000)
    assert wire.receive(wire.next_due_ns() - 1) == []
    assert wire.receive(wire.next_due_ns()) == [ReceivedData(request)]


def test_a_driver_that_floods_the_bus_starves_no_lower_identifier():
    """Send ten times what the bus carries; a device's frame that wins arbitration waits for one frame only."""
    wire, driver = plugged(Can())
    ours = CanFrame(arbitration_id=0x10, data=bytes(8))
    waits, heard = [], 0
    for now in range(0, 500_000_000, 1_000_000):
        for _ in range(90):
            driver.write(CanFrame(arbitration_id=0x400, data=bytes(8)))
        heard += sum(isinstance(event, ReceivedData) for event in wire.receive(now))
        wire.send([ours], now, "pad")
        wire.flush(now)
        while (due := wire.next_due_ns()) is not None and due < now + 1_000_000:
            heard += sum(isinstance(event, ReceivedData) for event in wire.receive(due))
            wire.flush(due)
            waits += [due - now for _ in driver.read()]
    assert len(waits) >= 499 and max(waits) < 3 * frame_ns(ours, 1_000_000)
    assert heard == pytest.approx(0.5e9 / frame_ns(ours, 1_000_000) - 500, rel=0.05)
    assert wire.counters["overrun"] == 0, "what has not been read waits with the driver"


def test_a_loop_that_is_late_receives_all_frames_of_an_idle_bus_in_order():
    wire, driver = plugged(Can())
    heard = []
    for turn in range(20):
        now = turn * 25_000_000
        for k in range(4):
            driver.write(CanFrame(arbitration_id=0x400, data=bytes([turn, k])))
        heard += [event.data.data for event in wire.receive(now) if isinstance(event, ReceivedData)]
        wire.flush(now + 50_000)
    while (due := wire.next_due_ns()) is not None:
        heard += [event.data.data for event in wire.receive(due) if isinstance(event, ReceivedData)]
        wire.flush(due)
    assert heard == [bytes([turn, k]) for turn in range(20) for k in range(4)]
    assert wire.counters["overrun"] == 0


def test_a_request_takes_the_time_of_the_speed_that_the_driver_has_set():
    wire, driver = plugged(UART)
    driver.set_serial(baud=9600)
    driver.write(b"12345678")
    assert wire.receive(0)[0].setting.baud == 9600
    assert wire.next_due_ns() == round(80e9 / 9600)


def test_a_driver_that_floods_a_serial_line_is_held_up_and_loses_nothing():
    wire, driver = plugged(UART)
    taken = [driver.write(bytes([k % 256]) * 100) for k in range(3000)]
    assert taken == [True] * MAX_WAITING_CHUNKS + [False] * (3000 - MAX_WAITING_CHUNKS)
    heard = b""
    for now in range(0, 1_000_000_000, 1_000_000):
        heard += b"".join(event.data for event in wire.receive(now) if isinstance(event, ReceivedData))
        assert wire.inbound.waiting_ns(DRIVER) <= 50_000_000 + (MAX_CHUNK_BYTES + 100) * 10e9 / 115_200
    assert len(heard) == pytest.approx(11_520, abs=100)
    assert heard == b"".join(bytes([k % 256]) * 100 for k in range(200))[: len(heard)]
    assert wire.counters["overrun"] == 0


def test_what_a_driver_leaves_behind_keeps_nobody_waiting():
    wire, driver = plugged(Serial(baud=100))
    driver.write(bytes(500))
    wire.receive(0)
    driver.close()
    assert Closed() in wire.receive(1_000_000)
    driver.open()
    driver.write(b"?")
    wire.receive(2_000_000)
    assert ReceivedData(b"?") in wire.receive(2_000_000 + 100_000_000)


def test_every_stage_is_measured():
    lines = []
    figures = run(lines.append, repeats=1)
    assert {"can bits", "wire serial", "wire can", "pty write and read", "whole serial on a pty"} <= set(figures)
    assert all(figure > 0 for figure in figures.values()) and len(lines) == len(figures)
