"""Frames that are kept together leave as they would one by one: in the same order, at the same times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import Can, CanFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.transports.memory import MemoryTransport
from tactemu.wire.can_bits import frame_ns, run_ns
from tactemu.wire.wire import Wire


@pytest.mark.parametrize("size", [0, 1, 5, 8])
def test_times_are_those_of_each_frame(size):
    rng = np.random.default_rng(size)
    data = rng.integers(0, 256, (2000, size), dtype=np.uint8)
    data[:1000] = rng.choice([0x00, 0xFF, 0x0F, 0xF8, 0x1F], (1000, size))  # long runs of equal bits
    frames = CanFrames.of(rng.integers(0, 0x800, 2000), data)
    assert run_ns(frames, 800_000) == [frame_ns(frame, 800_000) for frame in frames]


def test_frames_of_an_array_are_indexed_as_a_sequence():
    frames = CanFrames.of([1, 2, 3], np.arange(12, dtype=np.uint8).reshape(3, 4))
    assert [frames[k] for k in range(-3, 3)] == 2 * list(frames)
    assert frames[::2] == [frames[0], frames[2]] and frames[::2][1] == frames[2]
    for index in (-4, 3):
        with pytest.raises(IndexError, match="below 3"):
            frames[index]


def play(plan, steps, as_runs, **options):
    """Return frames, counters and times of a bus on which nodes offer readings and the loop runs at ``steps`` [us]."""
    wire = Wire(MemoryTransport(), Can(bitrate=1_000_000), seed=3, **options)
    wire.open()
    wire.receive(0)
    for node in {node for _, node, _, _ in plan}:
        wire.attach(f"node {node}", Can())
    plan = sorted(plan)
    for now_us in steps:
        while plan and plan[0][0] <= now_us:
            at_us, node, ident, count = plan.pop(0)
            data = np.random.default_rng([at_us, node]).integers(0, 256, (count, 8), dtype=np.uint8)
            frames = CanFrames.of(ident + np.arange(count) % 3, data)
            wire.send(frames if as_runs else list(frames), at_us * 1000, f"node {node}", sample=at_us)
        if now_us % 7 == 0:
            wire.transport.driver.write(CanFrame(arbitration_id=0x150, data=b"\1\2"))
        wire.receive(now_us * 1000)
        wire.flush(now_us * 1000)
    return wire.truth.frames, wire.counters, wire.line.free_ns, wire.line.busy_ns


readings = st.tuples(st.integers(0, 9_000), st.integers(0, 3), st.integers(0x100, 0x200), st.integers(1, 20))


@given(
    st.lists(readings, max_size=8, unique_by=lambda reading: reading[:2]),
    st.lists(st.integers(1, 4_000), min_size=10, max_size=60),
    st.sampled_from([(), ("drop 20%",), ("unplug at 3ms for 2ms",), ("busoff at 2ms for 1ms",), ("load 30%",)]),
)
def test_nodes_that_offer_runs_and_a_driver_that_talks_between(plan, pauses, faults):
    steps = np.cumsum(pauses).tolist()
    together, alone = (play(plan, steps, as_runs, faults=faults) for as_runs in (True, False))
    assert together == alone
