"""Every device's name alone runs: its default scene builds, presses its taxels, and starts untouched."""

import numpy as np
import pytest

import firmware_protocols
from tactemu.assembly import Wishes, assemble
from tactemu.clock import VirtualClock
from tactemu.scene.default import scene_for
from tactemu.scene.file import load, load_device


def felt(loaded) -> np.ndarray:
    """Largest reading at each sample of the first three seconds."""
    emulator = assemble(loaded, Wishes(port="memory:", rate_hz=25)).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(3)
    return np.array([np.abs(sample.ideal).max() for sample in emulator.truth.samples])


@pytest.mark.parametrize("name", firmware_protocols.names())
def test_the_scene_of_every_device_presses_it(name):
    peaks = felt(load(name))
    assert peaks[0] == 0.0, "not touched at the start"
    assert peaks.max() > 0.0, "touched later"


@pytest.mark.parametrize("name", ["anyskin", "linker_hand_o6"])
def test_a_device_without_a_scene_gets_one(name):
    device = load_device(name)
    loaded = scene_for(name, device)
    assert len(loaded.tables.body) == 1 + len(device().layout.patches)
    peaks = felt(loaded)
    assert peaks[0] == 0.0
    assert peaks.max() > 0.0
