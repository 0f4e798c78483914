"""Unmodified drivers that count: each fault is seen exactly as often as it was injected.

What all ten do under every fault is ``docs/drivers-under-faults.md``, by ``python -m tests.judge.cards``.
"""

import struct
import time
from collections import Counter

import pytest

from tests.drivers.live import Live, served, until
from tests.drivers.rig import run_driver
from tests.drivers.test_ability_hand import documented_force
from tests.drivers.test_flexitac_optoforce import SCALE
from tests.drivers.test_inspire_rh56dftp import PALM

pytestmark = [pytest.mark.driver, pytest.mark.timeout(180)]


def inject(live, fault, seconds=0.8):
    """Switch a fault on for a while, in the middle of a stream; how often it was injected."""
    wire, truth = live.dev.emulator.channels[0].wire, live.dev.truth
    before, added = truth.injected.total(), []
    live.dev.emulator.call(lambda: added.append(wire.add_fault(fault)))
    time.sleep(seconds)
    assert until(lambda: truth.injected.total() > before, 5), f"{fault}: nothing was injected"
    live.dev.emulator.call(lambda: wire.remove_fault(added[0]))
    assert live.settles(), f"{fault}: {live.notes[-3:]}"
    return truth.injected.total() - before


HARMLESS = ("length 10%", "garbage 10%", "split 10% by 5ms", "merge 10%", "latency 16ms")
COUNTED = {
    "drop 10%": ("lost",), "checksum 10% bytes 2": ("marked", "lost"), "duplicate 10%": ("again",),
    "stray 10%": ("older",), "reorder 10%": ("older",),
}  # fmt: skip


def test_optoforce_counts_every_fault(tmp_path):
    """It has a counter and a sum in every packet."""
    with (
        served(tmp_path, "optoforce", noise=20.0) as dev,
        Live("optoforce", dev.port, dev, lambda counts: (counts * SCALE).ravel()) as live,
    ):
        assert live.settles()
        for fault in (*HARMLESS, *COUNTED):
            since = len(live.rows)
            n = inject(live, fault)
            assert live.story(since) == dict.fromkeys(COUNTED.get(fault, ()), n), fault
        assert not live.notes


@pytest.mark.parametrize("fault", ["checksum 10%", "checksum every 7", "flip 10%"])
def test_optoforce_rejects_the_very_frames_that_were_damaged(fault, tmp_path):
    """Not only as many: the packets' counter aligns what the driver says of each with the log of what left.

    A flipped bit in the four bytes of the head makes a packet invisible, elsewhere the sum is wrong.
    """
    with served(tmp_path, "optoforce", noise=20.0) as dev:
        dev.emulator.call(lambda: dev.emulator.wires[0].add_fault(fault))
        packets = run_driver("optoforce", "optoforce_read.py", dev.port, "OptoForce16")
    left = [frame for _, _, frame in dev.truth.frames if len(frame) == 16]  # all of them: nothing runs any more
    head = Counter(frame[:4] for frame in left).most_common(1)[0][0]
    frames = [frame for frame in left if frame[:4] == head]
    sent = [struct.unpack(">H", frame[4:6])[0] for frame in frames]
    first, last = (sent.index(packets[k]["count"]) for k in (0, -1))
    damaged = [sum(frame[:-2]) & 0xFFFF != struct.unpack(">H", frame[-2:])[0] for frame in frames]
    injected = dev.truth.injected.total() - (len(left) - len(frames))
    assert injected - sum(damaged) in (0, 1), "the last may find the port closed"
    assert [not packet["valid_checksum"] for packet in packets] == damaged[first : last + 1]
    assert sum(damaged[first : last + 1]) > 5


def test_ability_hand_logs_every_failed_checksum(tmp_path):
    """A bit of the first byte that neither selects the packet nor escapes: another sum, in the same frame.

    A damaged sum, or end of the frame, would not do: one in 256 escapes the next byte, or makes the longer frame valid.
    """
    force = [documented_force(count) for count in range(4096)]
    with (
        served(tmp_path, "ability_hand", rate_hz=250, noise=1.0) as dev,
        Live("ability-hand", dev.port, dev, lambda counts: [force[count] for count in counts.ravel()]) as live,
    ):
        assert live.settles()
        since, said = len(live.rows), len(live.notes)
        n = inject(live, "flip 10% byte 1 bit 7")
        assert sum("Checksum failed" in note for note in live.notes[said:]) == n
        assert "wrong" not in live.story(since)


def test_pymodbus_raises_for_every_fault_and_hands_out_no_wrong_register(tmp_path):
    with (
        served(tmp_path, "inspire_rh56dftp", noise=0.5) as dev,
        Live("pymodbus", dev.port, dev, lambda counts: counts[PALM].ravel()) as live,
    ):
        assert live.settles()
        for fault in ("drop 10%", "drop 10% from_driver", "flip 10%"):
            for _ in range(3):  # an answer that a busy machine sends too late is one error more
                since, said = len(live.rows), len(live.notes)
                n = inject(live, fault, 1.5)
                assert not {"wrong", "older"} & live.story(since).keys(), fault
                if len(live.notes) - said == n:
                    break
            assert len(live.notes) - said >= n, (fault, live.notes[said:])  # none of the faults goes unnoticed
