"""Through the whole loop on a virtual clock: jitter as it was asked for, and the order of frames."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.base.clock import RealClock, VirtualClock
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.transports.memory import MemoryTransport
from tactemu.truth import Truth
from tactemu.wire.wire import Wire
from tests.emulator.test_delay_live import Numbered
from tests.emulator.test_loop import Ramp

MS = 1_000_000


def leave(frames: int, **clock) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of the frames as they leave at 1 kHz, and how long after its sample each does [ns]."""
    device = Numbered()
    truth = Truth()
    wire = Wire(MemoryTransport(), device.ports[0], truth=truth)
    sampling = SampleClock(period_ns=device.period_ns, name="a", seed=4, **clock)
    channel = Channel("a", device, Ramp(), {"": wire}, sampling)
    emulator = Emulator(None, [channel], clock=VirtualClock(), truth=truth)
    numbers, late = [], []

    def note(t_ns, _device, frame, sample=None, _late_ns=0):
        (number,) = struct.unpack("<I", frame)
        numbers.append(number)
        late.append(t_ns - number * device.period_ns)

    truth.wrote = note
    with emulator:
        while len(numbers) < frames:
            emulator.run(1.0)
            wire.transport.driver.read()
    return np.array(numbers[:frames]), np.array(late[:frames])


def test_delay_and_jitter_to_the_nanosecond():
    from scipy.stats import kstest

    numbers, late = leave(10_000, delay_ns=3_700_000, jitter_ns=900_000)
    assert np.array_equal(numbers, np.arange(1, 10_001))
    assert late.min() >= 3_700_000 and late.max() <= 4_600_000
    assert kstest((late - 3_700_000) / 900_000, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("reorder", [False, True])
def test_frames_keep_their_order_unless_asked(reorder):
    numbers, late = leave(10_000, delay_ns=3_700_000, jitter_ns=5 * MS, reorder=reorder)
    assert late.min() >= 3_700_000
    assert bool((np.diff(numbers) < 0).any()) is reorder
    if not reorder:
        assert np.array_equal(numbers, np.arange(1, 10_001)), "none lost, none twice"


@pytest.mark.parametrize("real", [False, True])
def test_boards_that_sample_together_take_turns_with_those_of_other_buses(real):
    """In real time, so that each bus has something to carry while the next samples are taken."""
    channels = []
    for name in "ab":
        device = fp.create("icub_skin", part="torso", triangles=14, triangles_per_board=7)
        channels.append(
            Channel(
                name, device, Ramp(), {"": Wire(MemoryTransport(), device.ports[0])}, SampleClock(period_ns=50 * MS)
            )
        )
    emulator = Emulator(None, channels, clock=RealClock() if real else VirtualClock())
    for channel in channels:
        channel.begin(0)
    order = [(channel.name, stream[-1]) for channel, stream in emulator._due(50 * MS)]
    in_turn, device_by_device = [("a", "1"), ("b", "1"), ("a", "2"), ("b", "2")], [(n, k) for n in "ab" for k in "12"]
    assert order == (in_turn if real else device_by_device)
